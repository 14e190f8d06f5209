"""Chapter 2: asperities, the Generic model and the Rayleigh step."""
