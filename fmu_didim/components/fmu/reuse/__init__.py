"""How an FMU is run again, found out by trials in other processes."""
