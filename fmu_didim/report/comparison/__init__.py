"""A saved comparison of two results as a report."""
