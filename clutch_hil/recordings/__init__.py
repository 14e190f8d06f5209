"""Recordings: files of other tools, recognised by content, as channels with units and times, and their conversion to runs."""
