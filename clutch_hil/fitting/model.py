"""Model: what the discrepancy workflow must know of a rig. Any class with these attributes will do (docs/discrepancy.md)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from clutch_hil.recordings.checks.knowledge import Implied, Limits
from plant_sim.effects.effect import Effect, Shape, Strength
from protocols.files.parameters import Parameter, ParameterSet

Columns = Mapping[str, np.ndarray]  # by name, each (n,), one row a sample at a constant rate, with time_s
Values = Mapping[str, float]  # parameters by dotted name, each in its declared unit

_AT_BOUND = 1e-6  # of the width between bounds: fits are clipped to them, so this is rounding


@dataclass(frozen=True)
class Output:
    """A measured column that the model predicts, in `unit`.

    block: which part of the rig answers for it first. resolution: standard deviation of noise and rounding by the data sheet,
    in `unit`; the floor found in the runs is not below it. 0 where nothing is known. beginning: standard deviation, in floors,
    to which the value at a run's start is known, where the model is told it: a constant offset of a run of that size is no
    disagreement.
    """

    column: str
    unit: str
    block: str
    resolution: float = 0.0
    beginning: float = 0.0


@dataclass(frozen=True)
class Candidate:
    """An effect that may be missing: its block, its title, equation and parameters, dotted `name.parameter`.

    It is off where every Strength is at its `off`.
    """

    name: str
    block: str
    title: str
    equation: str
    parameters: tuple[Strength | Shape, ...]
    excludes: tuple[str, ...] = ()

    @property
    def strengths(self) -> tuple[Strength, ...]:
        """The parameters that switch it on."""
        return tuple(p for p in self.parameters if isinstance(p, Strength))

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """The parameters that only shape it."""
        return tuple(p for p in self.parameters if isinstance(p, Shape))

    def list_off_values(self) -> dict[str, float]:
        """Values of its parameters while it is off, by dotted name."""
        return {f"{self.name}.{p.name}": p.off for p in self.parameters}

    def is_off(self, values: Values) -> bool:
        """Whether `values`, by dotted name, switch it off."""
        return all(values[f"{self.name}.{s.name}"] == s.off for s in self.strengths)

    def list_at_bounds(self, values: Values) -> list[str]:
        """Its strengths by dotted name that rest at a bound in `values`: the runs ask for more than is physically possible.

        A bound at which the strength is off is none of these: there the effect, or a part of it, is absent. Nor is a bound of a
        shape: it is mostly a limit case (a time constant of next to nothing, no spread), which many real rigs are near to.
        """
        at_bounds = []
        for s in self.strengths:
            name = f"{self.name}.{s.name}"
            reach = _AT_BOUND * (s.bounds[1] - s.bounds[0])
            if any(bound != s.off and abs(values[name] - bound) <= reach for bound in s.bounds):
                at_bounds.append(name)
        return at_bounds

    def list_typical_values(self) -> dict[str, float]:
        """Typical values by dotted name."""
        return {f"{self.name}.{p.name}": p.typical for p in self.parameters}

    def declare_parameters(self) -> dict[str, Parameter]:
        """Its parameters, switched off."""
        return {
            f"{self.name}.{p.name}": Parameter(f"{self.name}.{p.name}", p.off, p.unit, 0.0, p.bounds, p.source)
            for p in self.parameters
        }

    @classmethod
    def of(cls, effect: Effect) -> "Candidate":
        """The candidate that is a plug-in of the simulator."""
        return cls(effect.name, effect.block, effect.title, find_equation(effect), effect.parameters, effect.excludes)


def find_equation(effect: Effect) -> str:
    """The section `Equation` of an effect's docstring."""
    lines = effect.text.split("\nEquation", 1)[1].split("\nAssumptions", 1)[0].splitlines()
    return "\n".join(line.strip() for line in lines).strip()


class Model(Protocol):
    """A rig that can be simulated for given inputs.

    name: as `--rig` has it. inputs: columns of a run that drive it. outputs: those it predicts. parameters: of the
    baseline, by dotted name; those with an uncertainty are re-fitted within it. candidates: effects that may be missing.
    """

    name: str
    inputs: tuple[str, ...]
    outputs: tuple[Output, ...]
    parameters: ParameterSet
    candidates: tuple[Candidate, ...]

    def simulate(self, run: Columns, parameters: Values, effects: Values) -> Columns:
        """Predicted outputs (n,) by column, free of noise, for the inputs of `run`; its outputs may only give the beginning.

        parameters: every one of the baseline; effects: parameters of the candidates that are on, {} for none. Must be pure,
        deterministic, and leave other threads running where it takes long. Raises InputError for what cannot be simulated.
        """
        ...


@runtime_checkable
class Blockwise(Protocol):
    """A model that also simulates one block behind its measured inputs, so that a disagreement can be located."""

    blocks: Mapping[
        str, tuple[str, ...]
    ]  # columns that a block, or chain of blocks, answers for, driven by measured ones

    def simulate_block(self, block: str, run: Columns, parameters: Values, effects: Values) -> Columns:
        """Predicted outputs (n,) of `block` alone, by column, driven by the measured columns of `run`."""
        ...


class RunSource(NamedTuple):
    """What a block may be blamed for in an output `column` in one run, in means over `sources.MEAN`.

    `power` (n,), in the output's unit squared: its mean is the mean square. `tested` (n, k): the same, later, of mean 0 where
    the block is right. `residual` (n,), in the output's unit, in which it shows.
    """

    block: str
    column: str
    power: np.ndarray
    tested: np.ndarray
    residual: np.ndarray


@runtime_checkable
class Locating(Protocol):
    """A model that tells which block an error is of by what several channels have in common."""

    def locate(
        self,
        number: int,
        run: Columns,
        shown: Columns,
        residuals: Columns,
        floors: Values,
        parameters: Values,
        effects: Values,
    ) -> list[RunSource]:
        """The sources in the run of this `number`, the same ones in each run: `shown` are the outputs simulated with
        `parameters` and `effects`, `residuals` measured less simulated, `floors` the noise of the outputs, all by column."""
        ...


@runtime_checkable
class Demanding(Protocol):
    """A model that needs more of a run than its inputs and outputs.

    run_columns: the columns that a run must have, all of them, with time_s.
    """

    run_columns: tuple[str, ...]


@runtime_checkable
class Partial(Protocol):
    """A model that says nothing of some rows of a run, which then count for no fit."""

    def find_unseen(self, run: Columns) -> Mapping[str, np.ndarray]:
        """By output, whether the model says nothing of each row, (n,)."""
        ...


@runtime_checkable
class Timed(Protocol):
    """A model that knows the times of a run's events less exactly than its simulation does.

    doubtful_timing, most_timing [s]: beyond the first a sound rig may seem to need another calibration or an effect; beyond
    the second it seems to lack something, and such runs are refused.
    """

    doubtful_timing: float
    most_timing: float

    def estimate_timing(self, run: Columns) -> float:
        """To which they are known [s]; 0 where exactly."""
        ...


@runtime_checkable
class Completing(Protocol):
    """A model that can do without a column, as others give it."""

    def complete_run(self, run: Columns) -> Columns:
        """`run`, with the columns that others give and that it lacks."""
        ...

    def find_derived(self, run: Columns) -> Mapping[str, str]:
        """Columns of a whole run that are no measurement of their own, each with the one that gives it."""
        ...


def simulate_seen(model: Model, run: Columns, parameters: Values, effects: Values) -> dict[str, np.ndarray]:
    """Outputs (n,) of a run, in their units; no number in rows of which the model says nothing (`Partial`)."""
    shown = dict(model.simulate(run, parameters, effects))
    for column, unseen in (model.find_unseen(run) if isinstance(model, Partial) else {}).items():
        shown[column] = np.where(unseen, np.nan, shown[column])
    return shown


@runtime_checkable
class Ranged(Protocol):
    """A model that knows what its rig can do, so that a recording in another unit, or of a fault, is told before any fit."""

    def list_limits(self) -> Mapping[str, Limits]:
        """Limits by column; of a column without an entry nothing is known."""
        ...


@runtime_checkable
class Redundant(Protocol):
    """A model some of whose columns follow from other measured ones, without any parameter: an angle from a speed."""

    def from_others(self, run: Columns) -> Mapping[str, tuple[str, np.ndarray]]:
        """By such a column the measured one that it follows from, and what it should be, (n,)."""
        ...


@runtime_checkable
class Implying(Protocol):
    """A model whose output tells of its inputs, so that one that is late, frozen or off its zero is told before any fit."""

    def imply_inputs(self, run: Columns, floors: Mapping[str, float]) -> Mapping[str, Implied]:
        """By input, what the outputs tell of it. floors: noise of the outputs by column, in their units."""
        ...


@runtime_checkable
class Calibrated(Protocol):
    """A model whose baseline is known better than its parameters' stated uncertainties say: it may be off by `calibration`
    times as much; 1 for any other model."""

    calibration: float


def find_calibration(model: Model) -> float:
    """How far the baseline of a model may be re-fitted, in stated uncertainties."""
    return model.calibration if isinstance(model, Calibrated) else 1.0


@runtime_checkable
class Readable(Protocol):
    """A model whose equations can be read in several ways, none of which is an effect: the runs tell which holds.

    readings: by name, as it is told to people, the parameters of the baseline that make it. None of them is re-fitted.
    """

    readings: Mapping[str, Values]


def list_readings(model: Model) -> Mapping[str, Values]:
    """The ways in which a model's equations can be read; one for any other model."""
    return model.readings if isinstance(model, Readable) else {"": {}}


@runtime_checkable
class Hinting(Protocol):
    """A model that reads from residuals where to begin the fit of an effect that is not smooth in its parameters."""

    def suggest_starts(self, candidate: Candidate, run: Columns, residuals: Columns) -> list[dict[str, float]]:
        """Parameters to begin from, by dotted name; [] for the typical ones. `residuals`: measured less predicted (n,)."""
        ...


@dataclass(frozen=True)
class Evident:
    """An effect that recorded values show by themselves: intervals (value, low, high) of its parameters by dotted name, the
    rounding [root mean square, in the output's unit] that it adds by column, and `why` in one sentence."""

    intervals: Mapping[str, tuple[float, float, float]]
    rounding: Mapping[str, float]
    why: str


@runtime_checkable
class Witnessing(Protocol):
    """A model that sees some effects in the recorded values themselves, without any simulation."""

    def find_evident_effects(self, runs: Sequence[Columns]) -> Mapping[str, Evident]:
        """Effects that the values of `runs` show, by name of the candidate."""
        ...
