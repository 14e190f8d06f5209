"""Identify: from recordings of a rig to the calibration that its controller and its model run on."""
