"""Numbers by which a run is judged, and checks of a controller's parameters and of its demands."""
