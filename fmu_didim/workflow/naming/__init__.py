"""Name the law of a controller that nobody knows, from reference, torque log and measured positions."""
