"""What everything stands on: errors, documents, files, cache, terminal, version."""
