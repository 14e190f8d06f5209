"""Rigs: how blocks and effects are assembled."""
