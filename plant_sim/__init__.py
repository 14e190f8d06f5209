"""The rig: physics, effects, sensors and data acquisition, and the bench that runs it with a controller."""

from pathlib import Path

from protocols.compiled import drop_stale, place_cache

place_cache(Path(__file__).parent)
drop_stale(Path(__file__).parent, Path(__file__).parent.with_name("protocols"))
