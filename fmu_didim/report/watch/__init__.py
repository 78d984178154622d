"""The history of a machine over many logs as a report."""
