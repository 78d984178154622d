"""The noise of the torque, and the weights that follow from it."""
