"""Physical effects beside the baseline: one file each. With the parameters of `off` each leaves the rig bit-identical."""
