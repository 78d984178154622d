"""The description of an FMU as text, and trials of how it behaves."""
