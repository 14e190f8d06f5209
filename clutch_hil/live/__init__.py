"""Live: what an operator sees of a bench, on a screen or in a terminal, during a run and afterwards."""
