"""Bounds of what a recording may make this program allocate: those of run files."""

from protocols.files.bounds import MOST_BYTES, MOST_ROWS, check_bytes, check_rows

__all__ = ["MOST_BYTES", "MOST_ROWS", "check_bytes", "check_rows"]
