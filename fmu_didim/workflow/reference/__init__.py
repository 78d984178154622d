"""Reference: codes of diagnostics, effects, schemas of documents."""
