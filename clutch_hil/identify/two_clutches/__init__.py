"""Identification of the power-shift rig: both clutches, driveline and hand-over."""
