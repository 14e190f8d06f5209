"""Physical effects beside the baseline: one file each. With all of them off the rig is bit-identical to the baseline."""
