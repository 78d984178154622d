"""One run: from its entry in a case to an experiment, with all that was measured in it."""
