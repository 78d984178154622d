"""Basics: errors, documents, files, cache, terminal, version."""
