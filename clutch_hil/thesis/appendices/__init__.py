"""Appendices C, D and E."""
