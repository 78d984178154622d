"""Blind cases: made by a simulator of their own, given to discovery without their truth, and scored."""
