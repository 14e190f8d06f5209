"""The controller: estimator, feedforward, regulator, phases, guard, and the real-time loop that runs them."""

from pathlib import Path

from protocols.kernels.kernel_cache import drop_stale, place_cache

place_cache(Path(__file__).parent)
drop_stale(Path(__file__).parent, Path(__file__).parent.with_name("protocols"))
