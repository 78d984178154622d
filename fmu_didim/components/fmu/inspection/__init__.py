"""What an FMU says of itself, and how it behaves."""
