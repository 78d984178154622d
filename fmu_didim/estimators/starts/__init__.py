"""Where an estimation begins: values from a motion that was not simulated, from the description or from the case."""
