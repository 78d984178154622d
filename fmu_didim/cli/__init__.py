"""The command line: ``fmu-didim``."""
