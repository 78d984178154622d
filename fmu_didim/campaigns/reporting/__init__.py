"""Results of a campaign: tables, quality, charts, page."""
