"""Changes of a running bench: parameters, effects, faults, a calibration."""
