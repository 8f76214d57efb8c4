"""Monte Carlo on the ground, around the step that flies."""
