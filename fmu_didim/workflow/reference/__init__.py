"""What a reader can look up: codes of diagnostics, effects, schemas of documents."""
