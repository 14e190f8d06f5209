"""The controller: estimator, feedforward, regulator, phases, guard, and the real-time loop that runs them."""

from pathlib import Path

from protocols.kernels.kernel_cache import prepare_cache

prepare_cache(Path(__file__).parent, Path(__file__).parent.with_name("protocols"))
