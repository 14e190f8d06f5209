"""Recorders of a running bench: its telemetry, written to run files."""
