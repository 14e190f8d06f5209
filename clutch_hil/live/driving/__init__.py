"""Demands to a controller over the bus: commands, keyboard and programs."""
