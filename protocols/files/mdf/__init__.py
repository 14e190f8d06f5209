"""MDF 3 and 4 files: their blocks, checked before a library reads them, channels and frames."""
