"""The periodic motion on which the parameters of a model are known best."""
