"""Experiments played on a bench: one that separates two explanations, sets that identify a clutch, blind plants."""
