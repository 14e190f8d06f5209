"""Physical effects that the baseline lacks: one file each. With all of them off, the rig equals the baseline bit by bit."""
