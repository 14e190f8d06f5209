"""The bench: runs a plant with a controller, records, judges and draws what happened."""
