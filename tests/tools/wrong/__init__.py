"""Wrong inputs of a case, drawn at random over its keys and files: each is told with a next step, or harmless."""
