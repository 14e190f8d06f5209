"""clutch-hil from Python: `import clutch_hil as ch`. The names in `__all__` are public; everything else may change.

    run = ch.simulate("engagement", effects=["internal_leakage"], plant={"friction_level.level": 0.9})
    run["clutch_torque_nm"], run.units["clutch_torque_nm"], ch.measure_run(run)

simulate, sweep (grid, random, latin_hypercube), measure_run, draw_run, draw_sweep: runs in memory
start_bench: plant and controller as processes on a bus, driven by a program
read_run, write_run: run files
find_discrepancy, play_experiment: what a model lacks that recordings show
identify_clutch: the calibration of a clutch, from recordings
identify_friction, read_friction: a friction law from recordings of any rig
reproduce, friction: results and friction models of the thesis

docs/python.md has an example of each. A public name is loaded at its first use, because the services of a bench load this
package too and need none of these names.
"""

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from clutch_hil import friction
    from clutch_hil.bench.in_memory import measure_run, simulate
    from clutch_hil.bench.pictures.figures import draw_run, draw_sweep
    from clutch_hil.bench.run_file import read_run
    from clutch_hil.bench.sweeps.sampling import grid, latin_hypercube, random
    from clutch_hil.bench.sweeps.study import sweep
    from clutch_hil.discrepancy.experiments.laboratory import play_experiment
    from clutch_hil.discrepancy.outcome import Discrepancy, find_discrepancy
    from clutch_hil.identify.friction.identification import identify_friction
    from clutch_hil.identify.friction.result import IdentifiedFriction, read_friction
    from clutch_hil.identify.identification import Identification, identify_clutch
    from clutch_hil.live.live_bench import LiveBench, start_bench
    from clutch_hil.thesis.reproduction import reproduce
    from protocols.errors import InputError
    from protocols.files.run import Run
    from protocols.files.runs import write_run

_PARTS = ("protocols", "plant_sim", "rt_controller")  # the packages installed with this one


def _check_parts() -> None:
    """Raise ImportError where another package has the name of a package that this one needs."""
    home = Path(__file__).resolve().parents[1]
    for name in _PARTS:
        spec = find_spec(name)
        place = Path(spec.origin).resolve() if spec and spec.origin else None
        if place != home / name / "__init__.py":
            raise ImportError(
                f"clutch_hil needs the package {name} next to it in {home}; Python finds {place or 'none'}: rename that, if it"
                " is next to your script, or remove its folder from PYTHONPATH"
            )


_check_parts()

from protocols.kernels.kernel_cache import prepare_cache  # noqa: E402  # of a package that is checked

prepare_cache(Path(__file__).parent, *map(Path(__file__).parent.with_name, ("protocols", "plant_sim", "rt_controller")))

__all__ = [
    "Discrepancy", "Identification", "IdentifiedFriction", "InputError", "LiveBench", "Run", "draw_run", "draw_sweep",
    "find_discrepancy", "friction", "grid", "identify_clutch", "identify_friction", "latin_hypercube", "measure_run",
    "play_experiment", "random", "read_friction", "read_run", "reproduce", "simulate", "start_bench", "sweep", "write_run",
]  # fmt: skip
_PLACES = {
    "protocols.errors": ("InputError",),
    "protocols.files.run": ("Run",),
    "protocols.files.runs": ("write_run",),
    "clutch_hil.bench.pictures.figures": ("draw_run", "draw_sweep"),
    "clutch_hil.bench.in_memory": ("measure_run", "simulate"),
    "clutch_hil.bench.run_file": ("read_run",),
    "clutch_hil.bench.sweeps.sampling": ("grid", "latin_hypercube", "random"),
    "clutch_hil.bench.sweeps.study": ("sweep",),
    "clutch_hil.discrepancy.experiments.laboratory": ("play_experiment",),
    "clutch_hil.discrepancy.outcome": ("Discrepancy", "find_discrepancy"),
    "clutch_hil.identify.friction.identification": ("identify_friction",),
    "clutch_hil.identify.friction.result": ("IdentifiedFriction", "read_friction"),
    "clutch_hil.identify.identification": ("Identification", "identify_clutch"),
    "clutch_hil.live.live_bench": ("LiveBench", "start_bench"),
    "clutch_hil.thesis.reproduction": ("reproduce",),
}


def __getattr__(name: str) -> Any:
    if name == "friction":
        return import_module("clutch_hil.friction")
    for place, names in _PLACES.items():
        if name in names:
            return getattr(import_module(place), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
