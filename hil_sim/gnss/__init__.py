"""Fixes from the recorded observations of a real receiver: files, satellites, and the solution of each epoch."""
