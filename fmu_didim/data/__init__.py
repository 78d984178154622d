"""Data: trajectories, tables, signals, units, excitation."""
