"""What may be said of the outputs of a model that has neither controller nor torque."""
