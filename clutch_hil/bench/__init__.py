"""The bench: run a plant with a controller, and record, judge and draw the run."""
