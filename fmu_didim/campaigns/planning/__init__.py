"""What a campaign runs: its file, the combinations of values, the identity of each run."""
