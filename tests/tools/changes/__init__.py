"""How often a comparison of two logs of a machine is right: drawn pairs, what is said of them, and the score."""
