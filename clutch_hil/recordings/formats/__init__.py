"""Formats of recordings, one file each, found by the entry points `clutch_hil.recording_formats`."""
