"""Chapters 3 and 4: the tribometer and its contact."""
