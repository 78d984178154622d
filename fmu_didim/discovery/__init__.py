"""Discovery: the effects that a model lacks, and the model with them."""
