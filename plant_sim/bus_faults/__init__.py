"""Bus faults: changes to the frames between plant and controllers by the bus or another sender on it."""
