"""Discovery: where simulation and measurement disagree, what is missing, and the model with it."""
