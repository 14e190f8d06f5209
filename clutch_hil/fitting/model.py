"""Model: interface of a rig for the discrepancy workflow. Any class with these attributes is allowed (docs/own_model.md)."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from clutch_hil.recordings.checks.knowledge import Implied, Limits
from plant_sim.effects.effect import Effect, Shape, Strength
from protocols.files.parameters import Parameter, ParameterSet
from protocols.files.run import Run

Columns = Mapping[str, np.ndarray]  # columns by name, each (n,), one row per sample at a constant rate, with time_s
Values = Mapping[str, float]  # parameters by dotted name, each in its declared unit

_AT_BOUND = 1e-6  # tolerance as a share of the width between bounds: fits are clipped to them, so this is rounding


@dataclass(frozen=True)
class Output:
    """A measured column that the model predicts, in `unit`.

    block: part of the rig to which an error of this output is attributed first. resolution: standard deviation of noise and
    rounding according to the data sheet, in `unit`, the lower limit of the noise floor; 0 if unknown. beginning: standard
    deviation, in floors, of the initial value where the model takes it from the run: a constant offset of this size in a run is
    no disagreement. accuracy: root mean square error of simulation and converter in
    means over 4 ms, in `unit`, for recordings with very little noise: the lower limit of the noise of such means.
    """

    column: str
    unit: str
    block: str
    resolution: float = 0.0
    beginning: float = 0.0
    accuracy: float = 0.0


@dataclass(frozen=True)
class Candidate:
    """An effect that may be missing: block, title, equation, and parameters, which have the dotted names `name.parameter`.

    The effect is off where every Strength has its `off` value.
    """

    name: str
    block: str
    title: str
    equation: str
    parameters: tuple[Strength | Shape, ...]
    excludes: tuple[str, ...] = ()

    @property
    def strengths(self) -> tuple[Strength, ...]:
        """Parameters that switch the effect on."""
        return tuple(p for p in self.parameters if isinstance(p, Strength))

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Parameters that only change its shape."""
        return tuple(p for p in self.parameters if isinstance(p, Shape))

    def list_off_values(self) -> dict[str, float]:
        """Return the parameter values of the switched-off effect, by dotted name."""
        return {f"{self.name}.{p.name}": p.off for p in self.parameters}

    def is_off(self, values: Values) -> bool:
        """Return whether the effect is off for `values`, by dotted name."""
        return all(values[f"{self.name}.{s.name}"] == s.off for s in self.strengths)

    def list_at_bounds(self, values: Values) -> list[str]:
        """Return the strengths by dotted name that are at a bound in `values`: the fit asks for more than is possible.

        A bound that is the off value does not count: the effect, or a part of it, is absent there. Nor does one that is the
        typical value: a filter is in the line or not. Bounds of shapes do not count either: most are limit cases (a very small
        time constant, no spread) that many real rigs are close to.
        """
        at_bounds = []
        for s in self.strengths:
            name = f"{self.name}.{s.name}"
            reach = _AT_BOUND * (s.bounds[1] - s.bounds[0])
            if any(bound not in (s.off, s.typical) and abs(values[name] - bound) <= reach for bound in s.bounds):
                at_bounds.append(name)
        return at_bounds

    def list_typical_values(self) -> dict[str, float]:
        """Return the typical parameter values by dotted name."""
        return {f"{self.name}.{p.name}": p.typical for p in self.parameters}

    def declare_parameters(self) -> dict[str, Parameter]:
        """Return the parameters, with the effect switched off."""
        return {
            f"{self.name}.{p.name}": Parameter(f"{self.name}.{p.name}", p.off, p.unit, 0.0, p.bounds, p.source)
            for p in self.parameters
        }

    @classmethod
    def of(cls, effect: Effect) -> "Candidate":
        """Return the candidate for an effect plug-in of the simulator."""
        return cls(effect.name, effect.block, effect.title, find_equation(effect), effect.parameters, effect.excludes)


def find_equation(effect: Effect) -> str:
    """Return the section `Equation` of an effect's docstring."""
    lines = effect.text.split("\nEquation", 1)[1].split("\nAssumptions", 1)[0].splitlines()
    return "\n".join(line.strip() for line in lines).strip()


class Model(Protocol):
    """A rig that can be simulated for given inputs.

    name: as for `--rig`. inputs: columns of a run that drive the rig. outputs: columns that it predicts. parameters: of the
    baseline, by dotted name; those with an uncertainty are re-fitted within it. candidates: effects that may be missing.
    """

    name: str
    inputs: tuple[str, ...]
    outputs: tuple[Output, ...]
    parameters: ParameterSet
    candidates: tuple[Candidate, ...]

    def simulate(self, run: Columns, parameters: Values, effects: Values) -> Columns:
        """Return the predicted outputs (n,) by column, without noise, for the inputs of `run`.

        The outputs of `run` may be used for the initial state only. parameters: all of the baseline. effects: parameters of the
        candidates that are on, {} for none. Must be pure and deterministic, and release the interpreter lock if it takes long.
        Raises InputError where a simulation is not possible.
        """
        ...


@runtime_checkable
class Blockwise(Protocol):
    """A model that can also simulate one block from its measured inputs, so that a disagreement can be located."""

    blocks: Mapping[str, tuple[str, ...]]  # output columns of a block, or chain of blocks, with measured inputs

    def simulate_block(self, block: str, run: Columns, parameters: Values, effects: Values) -> Columns:
        """Return the predicted outputs (n,) of `block` alone, by column, with measured columns of `run` as inputs."""
        ...


class RunSource(NamedTuple):
    """Error of an output `column` in one run that may be due to a block, in means over `sources.MEAN`.

    power (n,): in the output's unit squared; its mean is the mean square. tested (n, k): the same as products with k later
    means, which have mean 0 for a correct block. residual (n,): in the output's unit.
    """

    block: str
    column: str
    power: np.ndarray
    tested: np.ndarray
    residual: np.ndarray


@runtime_checkable
class Locating(Protocol):
    """A model that locates the block of an error from the correlation of several channels."""

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
        """Return the error sources in the run with index `number`, the same ones for each run.

        shown: outputs simulated with `parameters` and `effects`. residuals: measured minus simulated. floors: noise of the
        outputs. All by column.
        """
        ...


@runtime_checkable
class Demanding(Protocol):
    """A model that needs further columns of a run besides inputs and outputs.

    run_columns: all columns that a run must have, with time_s.
    """

    run_columns: tuple[str, ...]


@runtime_checkable
class Partial(Protocol):
    """A model that does not predict some rows of a run, which are then left out of fits."""

    def find_unseen(self, run: Columns) -> Mapping[str, np.ndarray]:
        """Return by output a mask (n,) of the rows that the model does not predict."""
        ...


@runtime_checkable
class Reducible(Protocol):
    """A model that can be compared with runs that lack some of its outputs.

    may_lack: columns of these outputs.
    """

    may_lack: tuple[str, ...]

    def without(self, missing: Collection[str]) -> "Model":
        """Return the model without the outputs `missing`, some of `may_lack`."""
        ...


@runtime_checkable
class PartOfRig(Protocol):
    """A model of a part of a rig, such as one of its clutches, whose runs and parameters are those of the whole rig.

    Columns and parameters of the model have names of its own. whole: name of the rig. `list_nominal_parameters` returns the
    parameters of the whole rig, and the class takes them.
    """

    whole: str

    def take_run(self, run: Run) -> Run:
        """Return a run of the rig with the columns of the model.

        Raises InputError for a run without these columns; the sentence begins after the name of the run.
        """
        ...

    def name_in_whole(self, name: str) -> str:
        """Return the name in the rig of the model's parameter `name`."""
        ...


@runtime_checkable
class Timed(Protocol):
    """A model that knows the times of a run's events less accurately than it simulates them.

    doubtful_timing, most_timing [s]: above the first, a correct rig may seem to need another calibration or an effect; above
    the second, an effect seems to be missing, and such runs are refused.
    """

    doubtful_timing: float
    most_timing: float

    def estimate_timing(self, run: Columns) -> float:
        """Return the uncertainty of the times of events [s]; 0 if they are exact."""
        ...


@runtime_checkable
class Completing(Protocol):
    """A model that can compute a missing column from others, or correct one."""

    def complete_run(self, run: Columns) -> Columns:
        """Return `run` with missing columns computed from others."""
        ...

    def describe_completed(self, run: Columns) -> Mapping[str, str]:
        """Return the columns of a complete run that are not as recorded, each with a sentence that begins after its name."""
        ...


def simulate_seen(model: Model, run: Columns, parameters: Values, effects: Values) -> dict[str, np.ndarray]:
    """Simulate the outputs (n,) of a run, in their units; NaN in rows that the model does not predict (`Partial`)."""
    shown = dict(model.simulate(run, parameters, effects))
    for column, unseen in (model.find_unseen(run) if isinstance(model, Partial) else {}).items():
        shown[column] = np.where(unseen, np.nan, shown[column])
    return shown


@runtime_checkable
class Ranged(Protocol):
    """A model that knows the possible range of its rig, so that a wrong unit or a fault is detected before any fit."""

    def list_limits(self) -> Mapping[str, Limits]:
        """Return limits by column; a column without an entry has none."""
        ...


@runtime_checkable
class Redundant(Protocol):
    """A model with columns that follow from other measured ones without any parameter, such as an angle from a speed."""

    def from_others(self, run: Columns) -> Mapping[str, tuple[str, np.ndarray]]:
        """Return by redundant column the measured column from which it follows, and its computed values (n,)."""
        ...


@runtime_checkable
class Implying(Protocol):
    """A model that estimates inputs from its outputs, so that a late, frozen or offset input is detected before any fit."""

    def imply_inputs(self, run: Columns, floors: Mapping[str, float]) -> Mapping[str, Implied]:
        """Return by input what the outputs imply. floors: noise of the outputs by column, in their units."""
        ...


@runtime_checkable
class Calibrated(Protocol):
    """A model whose baseline is re-fitted within `calibration` times the stated uncertainties; 1 for any other model."""

    calibration: float


def find_calibration(model: Model) -> float:
    """Return how far the baseline of a model may be re-fitted, in stated uncertainties."""
    return model.calibration if isinstance(model, Calibrated) else 1.0


@runtime_checkable
class Readable(Protocol):
    """A model whose equations allow several readings, none of which is an effect; the runs decide between them.

    readings: name for the user -> baseline parameters of the reading, which are not re-fitted.
    """

    readings: Mapping[str, Values]


def list_readings(model: Model) -> Mapping[str, Values]:
    """Return the readings of a model's equations; a single empty one for any other model."""
    return model.readings if isinstance(model, Readable) else {"": {}}


@runtime_checkable
class Hinting(Protocol):
    """A model that derives start values from residuals for an effect that is not smooth in its parameters."""

    def suggest_starts(self, candidate: Candidate, run: Columns, residuals: Columns) -> list[dict[str, float]]:
        """Return start values by dotted name; [] for the typical ones. residuals: measured minus predicted (n,)."""
        ...


@dataclass(frozen=True)
class Evident:
    """An effect that is visible in the recorded values.

    intervals: (value, low, high) of its parameters by dotted name. rounding: root mean square that it adds by column, in the
    output's unit. why: the reason in one sentence.
    """

    intervals: Mapping[str, tuple[float, float, float]]
    rounding: Mapping[str, float]
    why: str


@runtime_checkable
class Witnessing(Protocol):
    """A model that detects some effects in the recorded values, without a simulation."""

    def find_evident_effects(self, runs: Sequence[Columns]) -> Mapping[str, Evident]:
        """Return the effects that are visible in the values of `runs`, by name of the candidate."""
        ...
