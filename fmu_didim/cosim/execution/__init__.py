"""How a system is run: in Python, in C, in this process or in another."""
