"""The plant: physics, effects, sensors and data acquisition, and the service that plays them on a bus."""

from pathlib import Path

from protocols.kernels.kernel_cache import prepare_cache

prepare_cache(Path(__file__).parent, Path(__file__).parent.with_name("protocols"))
