"""HDF5 files: how one is opened within limits, its channels, and the times, labels and packing of their numbers."""
