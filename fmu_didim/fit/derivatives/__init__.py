"""Derivatives of the closed loop by its free parameters."""
