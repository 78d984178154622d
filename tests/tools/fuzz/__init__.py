"""Inputs that nobody would write, by the thousand: each is refused in the project's own words, or taken, and soon."""
