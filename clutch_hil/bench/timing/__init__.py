"""How punctual the loop is on this machine: measurement, phases, report."""
