"""The plant: physics, effects, sensors and data acquisition, and the service that plays them on a bus."""

from pathlib import Path

from protocols.kernels.kernel_cache import drop_stale, place_cache

place_cache(Path(__file__).parent)
drop_stale(Path(__file__).parent, Path(__file__).parent.with_name("protocols"))
