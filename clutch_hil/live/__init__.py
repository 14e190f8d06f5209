"""Live: what an operator sees of a bench, on a screen or in a terminal, during and after a run."""
