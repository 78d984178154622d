"""Campaigns: plan, identity, validation, runs, store, results."""
