"""Models that the discrepancy workflow knows by name."""
