"""Measured logs of three public industrial arms, as their users would identify them."""
