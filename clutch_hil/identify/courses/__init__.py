"""Experiments that identify a clutch, as courses of demands."""
