"""What the monitor shows of a running bench in a terminal."""
