"""Faults of the bench during a run: its processes, the computer, and its network (docs/scenarios.md)."""
