"""Pulses that disturbed a real double pendulum, found from outside: cases from its repository, and their score."""
