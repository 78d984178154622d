"""The runs of a campaign: its file, the combinations of values, the identity of each run."""
