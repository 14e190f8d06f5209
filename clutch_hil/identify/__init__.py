"""Identify: from recordings of a rig to a calibration for its controller and its model."""
