"""What recorded runs show before a fit: usable rows, lags, missing sensors, limits, contradictions."""
