"""The controller: estimator, feedforward, regulator, phases, limits and the real-time loop they run in."""
