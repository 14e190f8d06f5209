"""Bus faults: what a bus, or another sender on it, does to the frames between plant and controllers."""
