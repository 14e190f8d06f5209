"""Rig: one object with everything that bench, live views and discrepancy engine need of a rig (docs/add_a_rig.md).

Rigs are found by entry point, in the group `clutch_hil.rigs`. A part given as "module:name" is loaded at its first use, because
a plant service needs neither pictures nor a discrepancy model.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, wraps
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np

from clutch_hil.bench.judgement.measures import Columns, Measure
from plant_sim.node.plant_rig import PlantRig
from protocols.entry_points import list_entries, load_entry
from protocols.errors import InputError, suggest_closest
from protocols.files.run import Run
from protocols.renamed_methods import refuse_old_methods
from protocols.user_code import describe_error

GROUP = "clutch_hil.rigs"
DEFAULT_RIG = "wet_clutch"  # rig of scenarios, runs and commands that name none


@dataclass(frozen=True)
class Rig:
    """A rig.

    plant               its plant: name, node, parameters, profiles, clutches
    measures_at         "module:name" of its measures by name; one of them is `fault`
    sheet_at            "module:name" of the function that draws the columns of a run, see `make_sheet`
    judge_at            "module:name" of the function that judges and draws a run file, see `judge`
    status_at           "module:name" of the class of its status line, see `status`
    figures             measures that summarise a run in a sweep; the first is NaN where the run missed its aim
    missed              text for such runs after their number, such as "handed no torque over"
    model_at            "module:name" of its model for the discrepancy engine; empty if it has none
    clutch_model_at     "module:name" of the model of one clutch driven by its measured slip, see `clutch_model`; empty if none
    identify_at         "module:name" of the function that identifies it from runs, see `identify`; empty if it is identified as
                        one clutch, or not at all
    """

    plant: PlantRig
    measures_at: str
    sheet_at: str
    judge_at: str
    status_at: str
    figures: tuple[str, ...]
    missed: str
    model_at: str = ""
    clutch_model_at: str = ""
    identify_at: str = ""

    @property
    def name(self) -> str:
        """Return its name in scenarios, metadata of runs and options of commands."""
        return self.plant.name

    @property
    def measures(self) -> Mapping[str, Measure]:
        """Return its measures by name. Raises InputError."""
        measures: Mapping[str, Measure] = self._load_part(self.measures_at)
        if not isinstance(measures, Mapping) or not all(isinstance(one, Measure) for one in measures.values()):
            raise InputError(
                f"rig {self.name}: {self.measures_at} is not a table of measures by name, each a Measure(...)"
            )
        return measures

    def make_sheet(self, columns: Columns, title: str, injected: Sequence[float] = ()) -> Any:
        """Draw the `columns` (n,) of a run by name, with a line at each time [s] in `injected`; return the `sheet.Sheet`.

        Raises InputError, also where the function of `sheet_at` fails or needs a column that the run lacks.
        """
        with self._tell_failure(f"the picture ({self.sheet_at})", columns):
            return self._load_callable(self.sheet_at)(columns, title, injected)

    def judge(self, path: Path, read: str, limits: Sequence[Any] = (), timing: dict[str, Any] | None = None) -> Any:
        """Judge the run file at `path`, and draw its picture; return the `result.Result`.

        `read` describes the input. `limits` are those of the scenario. `timing` has the summaries of the services; None for a
        simulation. Raises InputError, which names the run file, also where the function of `judge_at` fails.
        """
        try:
            with self._tell_failure(self.judge_at):
                return self._load_callable(self.judge_at)(path, read, limits, timing)
        except InputError as error:
            raise InputError(f"{error}; the run is complete, in {path}") from error

    @property
    def status(self) -> Callable[..., Any]:
        """Return the class of its status line: `status.StatusLine` or a subclass that overrides `_format`."""
        refuse_old_methods(self._load_part(self.status_at), f"status line of the rig {self.name}", {"_text": "_format"})
        return self._guard(self.status_at)

    @property
    def model(self) -> Callable[..., Any]:
        """Return the class of its discrepancy model. Raises InputError if it has none."""
        if not self.model_at:
            raise InputError(f"rig {self.name}{self.of_two} has no discrepancy model")
        return self._guard(self.model_at)

    @property
    def clutch_model(self) -> Callable[..., Any]:
        """Return the class of the model of a clutch driven by its measured slip, for identification."""
        return self._guard(self.clutch_model_at)

    @property
    def identify(self) -> Callable[..., Any]:
        """Return its identification: identify(runs, hold=, bounds=, ties=, force=, progress=), as `identify_clutch`.

        The function returns an `identification.Identification`.
        """
        return self._guard(self.identify_at)

    @property
    def of_two(self) -> str:
        """Return the text of an error message after the name of a rig with two clutches; otherwise empty."""
        return ", whose run is a run of two clutches," if self.plant.clutches else ""

    def measure(self, name: str) -> Measure:
        """Return a measure by name. Raises InputError, which lists the closest names."""
        if name not in (known := self.measures):
            raise InputError(f"measure {name!r} is unknown on the rig {self.name}; {suggest_closest(name, known)}")
        return known[name]

    def compute_measure(self, name: str, columns: Columns) -> float | str:
        """Return a measure of the `columns` of a run. Raises InputError, also where the function of a user's measure fails."""
        measure = self.measure(name)
        with self._tell_failure(f"measure {name}", columns):
            value = measure.of(columns)
        if not isinstance(value, str if measure.words else (int, float, np.number)):
            kind = "a word" if measure.words else f"a number in {measure.unit}"
            raise InputError(f"rig {self.name}: measure {name} returns {value!r}; {kind} is needed")
        return value

    def check(self, name: str) -> None:
        """Raise InputError if this cannot be the rig of the entry point `name`: wrong name, measures or figures."""
        if self.name != name:
            raise InputError(f"rig {name} is called {self.name!r} in its PlantRig; allowed is the entry point's name")
        for one in ("fault", *self.figures):
            self.measure(one)
        if not self.figures:
            raise InputError(f"rig {name} has no figures; one or more of its measures are needed")

    def check_parts(self) -> None:
        """Load what shows, draws and judges a run, so that an InputError occurs before the run and not after it."""
        for place in (self.sheet_at, self.judge_at, self.status_at):
            self._load_callable(place)

    @contextmanager
    def _tell_failure(self, what: str, columns: Collection[str] = ()) -> Iterator[None]:
        """Raise an InputError that names `what` for an error raised within, as a user's function may raise anything.

        `columns` are those of the run that the function reads; the message names one that is missing.
        """
        try:
            yield
        except InputError:
            raise
        except Exception as error:
            lacking = error.args[0] if isinstance(error, KeyError) and error.args else None
            if columns and isinstance(lacking, str) and lacking not in columns:
                raise InputError(
                    f"the run has no column {lacking!r}, which {what} of the rig {self.name} needs"
                ) from error
            raise InputError(f"rig {self.name}: {what} raises {describe_error(error)}") from error

    def _guard(self, place: str) -> Callable[..., Any]:
        """Return the function or class at `place`; any error of a call is an InputError."""
        part = self._load_callable(place)

        @wraps(part, updated=())
        def call(*arguments: Any, **options: Any) -> Any:
            with self._tell_failure(place):
                return part(*arguments, **options)

        return call

    def _load_callable(self, place: str) -> Callable[..., Any]:
        part = self._load_part(place)
        if not callable(part):
            raise InputError(f"rig {self.name}: {place} is {part!r}; a function or class is needed")
        loaded: Callable[..., Any] = part
        return loaded

    def _load_part(self, place: str) -> Any:
        if not place:
            raise InputError(f'rig {self.name} has an empty text as one of its parts; "module:name" is needed')
        try:
            return resolve_name(place)
        except (Exception, SystemExit) as error:  # a user's module may raise anything
            raise InputError(f"rig {self.name}: {place} cannot be loaded: {describe_error(error)}") from None


def list_rigs() -> tuple[str, ...]:
    """Return the names of the installed rigs."""
    return list_entries(GROUP)


def list_rigs_with_model() -> tuple[str, ...]:
    """Return the names of the rigs with a discrepancy model, whose experiments their benches can play."""
    return tuple(name for name in list_rigs() if find_rig(name).model_at)


def find_rig_of_run(run: Run) -> Rig:
    """Return the rig named in the metadata of a run; the wet clutch where none is named, as in a CSV. Raises InputError."""
    name = run.metadata.get("rig", DEFAULT_RIG)
    if not isinstance(name, str):
        raise InputError(f"the metadata of the run have rig = {name!r}; the name of a rig is needed")
    return find_rig(name)


@cache
def find_rig(name: str) -> Rig:
    """Return a rig by name. Raises InputError."""
    rig = load_entry(GROUP, "rig", name)
    if not isinstance(rig, Rig):
        raise InputError(f"rig {name} is {rig!r}; a Rig(...) is needed")
    if not isinstance(rig.plant, PlantRig):
        raise InputError(f"rig {name} has the plant {rig.plant!r}; a PlantRig(...) is needed")
    rig.check(name)
    return rig
