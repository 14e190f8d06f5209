"""Pictures of runs, and the colours of everything that is drawn."""
