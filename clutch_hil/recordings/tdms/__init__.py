"""TDMS files: how one is opened, and the times that its segments and properties tell."""
