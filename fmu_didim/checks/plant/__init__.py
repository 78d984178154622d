"""Checks of a plant: its agreement with the description, its parameters, its start, and when its outputs are read."""
