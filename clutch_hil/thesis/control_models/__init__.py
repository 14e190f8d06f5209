"""Chapter 5: friction models for control, and their fits to traces of other models and of a measured contact."""
