"""Small ripples at harmonics of a known motor, hidden in logs by the simulator of the blind cases."""
