"""Report of an identification: page and pictures."""
