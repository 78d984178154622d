"""The space that a robot needs: its links as capsules, boxes about it, and how far they are from each other."""
