"""What a campaign gave: tables, quality, charts, page."""
