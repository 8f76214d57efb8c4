"""Velocity and acceleration from positions: chains, a multiple-model filter, a smoother, a check of velocities."""
