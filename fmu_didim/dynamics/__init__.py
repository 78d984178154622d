"""Dynamics: blocks, robots, effects, base parameters."""
