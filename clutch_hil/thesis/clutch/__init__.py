"""Chapter 6: the wet clutch and its control."""
