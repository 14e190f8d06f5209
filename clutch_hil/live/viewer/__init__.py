"""What rerun's viewer shows of a running bench or of a recorded run."""
