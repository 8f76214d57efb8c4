"""Derivative estimation on the ground: conditioning, the paper's scenario, tracks of any vehicle, a velocity check."""
