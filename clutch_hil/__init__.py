"""What people use: the bench, live views, the discrepancy workflow, results of the thesis, and the command."""

from pathlib import Path

from protocols.kernels.compiled import drop_stale, place_cache

place_cache(Path(__file__).parent)
drop_stale(Path(__file__).parent, *map(Path(__file__).parent.with_name, ("protocols", "plant_sim")))
