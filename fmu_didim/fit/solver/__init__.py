"""Least squares of the closed loop."""
