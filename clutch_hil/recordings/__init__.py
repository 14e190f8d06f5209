"""Recordings: files of other tools, by content, as channels with units and times of their own; and how they become runs."""
