"""clutch-hil from Python: `import clutch_hil as ch`. What `__all__` names is public; everything else may change.

    run = ch.simulate("engagement", effects=["internal_leakage"], plant={"friction_level.level": 0.9})
    run["clutch_torque_nm"], run.units["clutch_torque_nm"], ch.measure_run(run)
    table = ch.sweep(ch.latin_hypercube({"friction_level.level": (0.8, 1.2)}, 100))

A public name is loaded when it is first used: the services of a bench load this package, too, and need none of them.
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from protocols.kernels.kernel_cache import drop_stale, place_cache

if TYPE_CHECKING:
    from clutch_hil.bench.in_memory import measure_run, simulate
    from clutch_hil.bench.picture import draw_run
    from clutch_hil.bench.sampling import grid, latin_hypercube, random
    from clutch_hil.bench.study import sweep
    from protocols.errors import InputError
    from protocols.files.run import Run
    from protocols.files.runs import read_run, write_run

place_cache(Path(__file__).parent)
drop_stale(Path(__file__).parent, *map(Path(__file__).parent.with_name, ("protocols", "plant_sim")))

__all__ = [
    "InputError", "Run", "draw_run", "grid", "latin_hypercube", "measure_run", "random", "read_run", "simulate", "sweep",
    "write_run",
]  # fmt: skip
_PLACES = {
    "protocols.errors": ("InputError",),
    "protocols.files.run": ("Run",),
    "protocols.files.runs": ("read_run", "write_run"),
    "clutch_hil.bench.in_memory": ("measure_run", "simulate"),
    "clutch_hil.bench.picture": ("draw_run",),
    "clutch_hil.bench.sampling": ("grid", "latin_hypercube", "random"),
    "clutch_hil.bench.study": ("sweep",),
}


def __getattr__(name: str) -> Any:
    for place, names in _PLACES.items():
        if name in names:
            return getattr(import_module(place), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*globals(), *__all__]
