"""The report of a discovery."""
