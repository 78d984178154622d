"""The evidence ladder: where an effect was seen, and what would say more."""
