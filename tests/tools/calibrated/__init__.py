"""FMUs of other tools, calibrated from the command line as a new user would, beside scipy's fit of the same data."""
