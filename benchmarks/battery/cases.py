"""Cases of the battery: which effects are hidden, how strongly, and behind how much noise.

A case is determined by its name, family/effects/severity/noise/seed, such as `single/piston_seal_friction/2.0/0.02/s1`.

Severity is the gap that each effect makes alone: sqrt(1 + (d/floor)^2) in the analog output where it is largest. d is the root
mean square, over the five runs, of the difference between simulations with and without the effect, at the same voltage and
without noise. Encoder columns do not count: the encoder has no noise, and the motor's integrator turns any change of
torque into an angle of thousands of counts.

Noise is the standard deviation of each analog channel as a share of a typical value of the rig. Typical are 3.4 bar and 17 Nm,
at which the thesis measures most (Janssens 2010, ch. 6), and 10 K, by which a run of 24 s heats the oil.
"""

import json
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.battery import excitation
from benchmarks.battery.truth_laws import CATALOGUE_LAWS, LAWS, UNKNOWN_LAWS, Law
from benchmarks.battery.truth_rig import BAR, draw_rig, list_changes
from benchmarks.battery.truth_simulation import (
    ANALOG_COUNT,
    COLUMNS,
    OPEN,
    PERIOD,
    PRESSURE,
    TORQUE,
    HiddenEffects,
    Inputs,
    Response,
    simulate,
)
from protocols.errors import InputError, closest
from protocols.files.run import Run
from protocols.files.runs import write_run

SEVERITIES = 1.3, 2.0, 4.0
NOISES = 0.005, 0.02, 0.05
UNITS = ("bar", "degC", "Nm", "Nm", "rad", "rad/s")
_TYPICAL = np.array([3.4, 10.0, 17.0, 17.0])  # bar, K, Nm, Nm: what noise is a share of, see above
_SI = np.array([BAR, 1.0, 1.0, 1.0])
_ADC_STEPS = np.array(
    [20 / 4096 / 1.0, 20 / 4096 / 0.05, 20 / 4096 / 0.2, 20 / 65536 / 0.2]
)  # of the converters: docs/rig.md, eq. 9
_ENCODER_COUNT = 2.0 * np.pi / 163840  # rad, of the encoder
_STRENGTH_TOLERANCE = 0.01  # relative error of the difference that a strength is to make: ours
_MOST_TRIES = 25  # simulations of the five runs to find a strength
_WARM_SPREAD = 20.0  # K: the oil of warm cases starts at 55..95 degC, that of others at 65..85
_ENGAGE_TIME = 0.3  # s after contact: slip and motor speed have settled by then
_MOVING_RATE = 0.2  # bar/s: a pressure that changes more slowly has no direction
# severity and noise of pairs and triples: two of four combinations, to save time
_MIXED_LEVELS = (2.0, 0.02), (4.0, 0.005)
FAMILIES = ("single", "null", "unknown", "pair", "triple", "warm", "closed")
_FIRST_SEED = {"development": 1, "evaluation": 101}


@dataclass(frozen=True)
class Case:
    """A case: family, names of the hidden effects, severity [-], noise [-], seed."""

    family: str
    effects: tuple[str, ...]
    severity: float
    noise: float
    seed: int

    @property
    def name(self) -> str:
        """Unique name; also the folder that the case is written to."""
        return f"{self.family}/{'+'.join(self.effects) or 'none'}/{self.severity}/{self.noise}/s{self.seed}"

    @classmethod
    def of(cls, name: str) -> "Case":
        """Parse the name of a case. Raises InputError for another form or an unknown effect."""
        parts = name.split("/")
        try:
            family, effects, severity, noise, seed = parts
            hidden = () if effects == "none" else tuple(effects.split("+"))
            case = cls(family, hidden, float(severity), float(noise), int(seed.removeprefix("s")))
        except ValueError:
            raise InputError(f"case {name!r} is not of the form family/effects/severity/noise/sN") from None
        if unknown := [effect for effect in case.effects if effect not in LAWS]:
            raise InputError(f"case {name!r}: the truth has no effect {unknown[0]!r}")
        return case

    @property
    def split(self) -> str:
        """Split that the seed belongs to: development or evaluation."""
        return "evaluation" if self.seed >= _FIRST_SEED["evaluation"] else "development"

    def random(self, purpose: int) -> np.random.Generator:
        """Random generator of the case; another one for each `purpose`."""
        return np.random.default_rng([zlib.crc32(self.name.encode()), purpose])


def noise_floors(noise: float) -> np.ndarray:
    """Floor of each of COLUMNS (6,) in its unit: standard deviation of noise and rounding."""
    analog = np.hypot(noise * _TYPICAL, _ADC_STEPS / np.sqrt(12.0))
    return np.concatenate([analog, [_ENCODER_COUNT / np.sqrt(12.0), _ENCODER_COUNT / np.sqrt(6.0) / PERIOD]])


def gap_in_floors(rms: np.ndarray, noise: float) -> float:
    """Gap [-] in units of the floor: sqrt(1 + (d/floor)^2), largest of the analog columns. rms: d of COLUMNS (6,)."""
    return float(np.sqrt(1.0 + np.max((rms / noise_floors(noise))[:ANALOG_COUNT]) ** 2))


class Truth:
    """The hidden part of a case: its rig, its runs, and its effects at the strengths that give the severity."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self.plant = draw_rig(int(case.random(1).integers(2**31)))
        seed = int(case.random(2).integers(2**31))
        self.inputs, self.held_out = excitation.draw_runs(
            seed, closed_loop=case.family == "closed", spread=_WARM_SPREAD if case.family == "warm" else 10.0
        )
        self.severities: dict[str, float] = {}  # severity that each effect reaches alone
        self._baselines: dict[int, np.ndarray] = {}

    @cached_property
    def hidden(self) -> HiddenEffects:
        """All effects of the case, each at the strength that gives the severity alone."""
        alone = [self.scale_effect(name) for name in self.case.effects]
        return HiddenEffects(
            *(dict(chain.from_iterable(getattr(one, part).items() for one in alone)) for part in _PARTS)
        )

    def scale_effect(self, name: str) -> HiddenEffects:
        """One effect at the strength that gives the severity, or at the largest possible one."""
        law = LAWS[name]
        random = np.random.default_rng([zlib.crc32(self.case.name.encode()), 3, zlib.crc32(name.encode())])
        sign = -1.0 if law.signed and random.random() < 0.5 else 1.0
        second = int(self.case.split == "evaluation" and law.variants > 1)
        unit = HiddenEffects({name: sign}, {name: float(random.uniform(-1.0, 1.0))}, {name: second})
        target = np.sqrt(self.case.severity**2 - 1.0)

        def size(strength: float) -> float:
            rms = self.rms_difference(replace(unit, strengths={name: sign * strength * law.si}))
            return float(np.sqrt(gap_in_floors(rms, self.case.noise) ** 2 - 1.0))

        start = law.usual * target * self.case.noise / _USUAL_SIZE
        strength, reached = _solve_strength(size, target, law, start)
        self.severities[name] = float(np.sqrt(1.0 + reached**2))
        return replace(unit, strengths={name: sign * strength * law.si})

    def rms_difference(self, hidden: HiddenEffects) -> np.ndarray:
        """Root mean square (6,) of the difference with and without effects of COLUMNS, over the five runs, without noise.

        Both simulations of a run have the same voltage.
        """
        squares = []
        for k, inputs in enumerate(self.inputs):
            response = simulate(inputs, hidden, self.plant)
            squares.append(
                np.mean((response.rows - self._simulate_without(k, inputs, response))[:, : len(COLUMNS)] ** 2, axis=0)
            )
        return np.sqrt(np.mean(squares, axis=0))

    def _simulate_without(self, k: int, inputs: Inputs, response: Response) -> np.ndarray:
        if inputs.mode != OPEN:
            return simulate(inputs.with_voltage(response.voltage), plant=self.plant).rows
        if k not in self._baselines:
            self._baselines[k] = simulate(inputs, plant=self.plant).rows
        return self._baselines[k]


_PARTS = "strengths", "forms", "laws"
# difference (over the floor) times noise that the usual strength of a law makes: a gap of 2 at 2 % noise
_USUAL_SIZE = np.sqrt(2.0**2 - 1.0) * 0.02


def _solve_strength(size: Callable[[float], float], target: float, law: Law, start: float) -> tuple[float, float]:
    """Find the strength at which `size` is `target`; return the strength and its size.

    Strengths are in the unit of the law, and at most its largest one. The search starts at `start`. It is regula falsi in
    logarithms, because the size is nearly a power of the strength.
    """
    below, above = (0.0, 0.0), None  # (strength, size) on either side of the target
    next_strength = min(start, law.most)
    for _ in range(_MOST_TRIES):
        strength = next_strength
        reached = size(strength)
        if abs(reached - target) <= _STRENGTH_TOLERANCE * target:
            break
        if reached < target:
            if strength >= law.most:
                break
            below = strength, reached
        else:
            above = strength, reached
        if above is None:
            growth = min(max(target / reached, 1.05), 10.0) if reached > 0.0 else 10.0
            next_strength = min(strength * growth, law.most)
        elif below[0] == 0.0:
            next_strength = above[0] * max(min(target / above[1], 0.95), 0.05)
        else:
            slope = np.log(above[1] / max(below[1], 1e-9)) / np.log(above[0] / below[0])
            share = np.log(target / max(below[1], 1e-9)) / slope / np.log(above[0] / below[0]) if slope > 0.0 else 0.5
            next_strength = below[0] * (above[0] / below[0]) ** min(max(share, 0.1), 0.9)
        if above is not None and above[0] - below[0] < 1e-6 * above[0]:
            break
    return strength, reached


def list_cases(split: str = "development", families: Sequence[str] = FAMILIES) -> list[Case]:
    """List the cases of a split, development or evaluation. Raises InputError for an unknown split or family.

    The splits have different seeds, and different laws where an effect has two. Single effects have three seeds where
    each severity is possible behind each noise, the others one: an answer takes a minute of CPU time or more, and two
    CPUs are to answer all cases within a day.
    """
    if split not in _FIRST_SEED:
        raise InputError(f"split {split!r} is unknown; {closest(split, _FIRST_SEED)}")
    if unknown := [family for family in families if family not in FAMILIES]:
        raise InputError(f"family {unknown[0]!r} is unknown; {closest(unknown[0], FAMILIES)}")
    first = _FIRST_SEED[split]
    names = [law.name for law in CATALOGUE_LAWS]
    always_possible = [
        name for name in names if all(map(_is_possible, _cross_cases("single", [(name,)], SEVERITIES, NOISES, [first])))
    ]
    # the evaluation has more unknown effects: thresholds set on some of them must hold for others
    unknown_names = [law.name for law in (UNKNOWN_LAWS if split == "evaluation" else UNKNOWN_LAWS[:6])]
    random = np.random.default_rng(first)
    pairs, triples = _draw_effect_sets(random, 2, 40), _draw_effect_sets(random, 3, 20)
    listed = [
        *_cross_cases("single", [(name,) for name in names], SEVERITIES, NOISES, [first]),
        *_cross_cases("single", [(name,) for name in always_possible], SEVERITIES, NOISES, range(first + 1, first + 3)),
        *_cross_cases("null", [()], (1.0,), NOISES, range(first, first + 40)),
        *_cross_cases("unknown", [(name,) for name in unknown_names], (2.0, 4.0), NOISES, [first]),
        *(c for s, n in _MIXED_LEVELS for c in _cross_cases("pair", pairs, (s,), (n,), [first])),
        *(c for s, n in _MIXED_LEVELS for c in _cross_cases("triple", triples, (s,), (n,), [first])),
        *_cross_cases("warm", [(name,) for name in names], (2.0, 4.0), (0.02,), [first]),
        *_cross_cases("warm", [()], (1.0,), (0.02,), range(first, first + 10)),
        *_cross_cases("closed", [(name,) for name in names], (2.0, 4.0), (0.02,), [first]),
        *_cross_cases("closed", [()], (1.0,), (0.02,), range(first, first + 10)),
    ]
    return [case for case in listed if case.family in families and _is_possible(case)]


def _cross_cases(
    family: str,
    effects: Sequence[tuple[str, ...]],
    severities: Sequence[float],
    noises: Sequence[float],
    seeds: Sequence[int],
) -> list[Case]:
    return [Case(family, *values) for values in product(effects, severities, noises, seeds)]


def _draw_effect_sets(random: np.random.Generator, size: int, count: int) -> list[tuple[str, ...]]:
    """Draw `count` sets of `size` effects of the catalogue, all effects of a set from different blocks."""
    sets: list[tuple[str, ...]] = []
    while len(sets) < count:
        drawn = tuple(sorted(random.choice([law.name for law in CATALOGUE_LAWS], size, replace=False).tolist()))
        if len({LAWS[name].block for name in drawn}) == size and drawn not in sets:
            sets.append(drawn)
    return sets


def _is_possible(case: Case) -> bool:
    """Whether physically possible strengths reach the severity. The gap over the floor is in proportion to 1/noise."""
    return all(
        case.severity**2 - 1.0 <= (LAWS[name].reach ** 2 - 1.0) * (0.02 / case.noise) ** 2 for name in case.effects
    )


@dataclass(frozen=True)
class RecordedRun:
    """A recorded run.

    `columns`: measured columns (n,) as in docs/rig.md, by name. `difference` (n, 6): with minus without effects of
    COLUMNS, without noise, at the recorded voltage. `regimes`: masks (n,) by name.
    """

    title: str
    columns: Mapping[str, np.ndarray]
    difference: np.ndarray
    regimes: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class GeneratedCase:
    """A generated case: runs, held-out runs, and the truth as a JSON object."""

    runs: Sequence[RecordedRun]
    held_out: Sequence[RecordedRun]
    truth: Mapping[str, Any]


def generate_case(case: Case) -> GeneratedCase:
    """Simulate the runs of a case and describe its truth."""
    truth = Truth(case)
    hidden = truth.hidden
    random = case.random(4)
    records = [record_run(inputs, hidden, truth.plant, case.noise, random) for inputs in truth.inputs + truth.held_out]
    runs, held_out = records[: len(truth.inputs)], records[len(truth.inputs) :]
    return GeneratedCase(runs, held_out, _describe_truth(case, truth, hidden, runs, held_out))


def record_further_run(
    truth: Mapping[str, Any], title: str, pressure: np.ndarray, speed: np.ndarray, celsius: float
) -> RecordedRun:
    """Record one more run of the case whose truth is `truth`.

    pressure, speed (n,): demands [bar], [rad/s]. celsius: oil temperature at the start [degC].
    """
    case, hidden = Case.of(truth["name"]), HiddenEffects({}, {}, {})
    for effect in truth["effects"]:
        name = effect["name"]
        hidden = HiddenEffects(
            {**hidden.strengths, name: effect["strength"] * LAWS[name].si},
            {**hidden.forms, name: effect["form"]},
            {**hidden.laws, name: effect["law"]},
        )
    inputs = Inputs(title, PRESSURE, pressure, speed, celsius, np.zeros(len(speed)))
    return record_run(inputs, hidden, draw_rig(int(case.random(1).integers(2**31))), case.noise, case.random(5))


def write_case(case: Case, folder: Path) -> tuple[list[Path], list[Path]]:
    """Write a case to disk; return the paths of its runs and of its held-out runs. Raises InputError.

    Runs are below `folder`/runs. The truth is below `folder`/truth, so that the engine cannot see it.
    """
    generated = generate_case(case)
    run_folder = folder / "runs" / case.name
    paths = [
        [run_folder / f"{kind}-{k}.parquet" for k in range(1, len(records) + 1)]
        for kind, records in (("run", generated.runs), ("holdout", generated.held_out))
    ]
    for path, record in zip(chain(*paths), (*generated.runs, *generated.held_out), strict=True):
        metadata = {"rig": "wet_clutch", "sample_rate_hz": round(1.0 / PERIOD), "notes": record.title}
        write_run(Run(record.columns, metadata), path)
    truth_file = folder / "truth" / case.name / "truth.json"
    truth_file.parent.mkdir(parents=True, exist_ok=True)
    truth_file.write_text(json.dumps(generated.truth, indent=1), encoding="utf-8")
    return paths[0], paths[1]


def record_run(
    inputs: Inputs, hidden: HiddenEffects, plant: np.ndarray, noise: float, random: np.random.Generator
) -> RecordedRun:
    """Simulate and record one run, with noise drawn from `random`. noise: share of the typical values."""
    n = len(inputs.command)
    noise_values = random.standard_normal((n, ANALOG_COUNT)) * noise * _TYPICAL * _SI
    response = simulate(inputs, hidden, plant, noise_values)
    held = inputs.with_voltage(response.voltage)
    without = simulate(held, plant=plant)
    difference = np.zeros((n, len(COLUMNS)))
    if hidden.strengths:
        difference = (simulate(held, hidden, plant).rows - without.rows)[:, : len(COLUMNS)]
    measured = dict(zip(COLUMNS, response.rows.T, strict=False))
    columns = {
        "time_s": PERIOD * np.arange(n),
        "valve_voltage_v": response.voltage,
        "motor_speed_demand_rad_s": inputs.speed,
    }
    columns |= {name: measured[name].copy() for name in _OUTPUT_ORDER}
    if inputs.mode == TORQUE:
        columns["torque_demand_nm"] = inputs.command
    return RecordedRun(inputs.title, columns, difference, _mark_regimes(without))


_OUTPUT_ORDER = (  # of the measured columns: docs/rig.md
    "cylinder_pressure_bar", "slip_speed_rad_s", "shaft_angle_rad", "oil_temperature_degc", "clutch_torque_nm",
    "motor_torque_nm",
)  # fmt: skip


def _mark_regimes(response: Response) -> dict[str, np.ndarray]:
    """Mark the regimes of a run: masks (n,) by name.

    Each sample has one phase. Pressed samples have a direction of the pressure. All have a direction of the slip.
    """
    commanded, pressed = response.voltage > 0.0, response["normal_force"] > 0.0
    n = np.arange(len(commanded))
    contact_start = np.maximum.accumulate(np.where(pressed & ~np.roll(pressed, 1), n, -len(n)))
    settling = n - contact_start < _ENGAGE_TIME / PERIOD
    displaced = response["position"] > 1e-6  # m
    rate = np.gradient(response["pressure"], PERIOD)
    return {
        "phase=open": ~commanded & ~pressed & ~displaced,
        "phase=fill": commanded & ~pressed,
        "phase=engage": commanded & pressed & settling,
        "phase=slip": commanded & pressed & ~settling,
        "phase=release": ~commanded & (pressed | displaced),
        "direction=apply": pressed & (rate > _MOVING_RATE),
        "direction=release": pressed & (rate < -_MOVING_RATE),
        "slip=forward": response["slip"] > 0.0,
        "slip=backward": response["slip"] < 0.0,
    }


def _rms_difference(records: Sequence[RecordedRun]) -> np.ndarray:
    return np.sqrt(np.mean([np.mean(record.difference**2, axis=0) for record in records], axis=0))


def _describe_truth(
    case: Case, truth: Truth, hidden: HiddenEffects, runs: Sequence[RecordedRun], held_out: Sequence[RecordedRun]
) -> dict[str, Any]:
    floor, rms, held_out_rms = noise_floors(case.noise), _rms_difference(runs), _rms_difference(held_out)
    difference = np.concatenate([record.difference for record in runs])
    masks = {name: np.concatenate([record.regimes[name] for record in runs]) for name in runs[0].regimes}
    whole = np.sum(difference**2, axis=0)
    return {
        "name": case.name,
        "split": case.split,
        "effects": [
            {
                "name": name, "block": LAWS[name].block, "in_catalogue": LAWS[name] in CATALOGUE_LAWS,
                "strength": hidden.strengths[name] / LAWS[name].si, "unit": LAWS[name].unit,
                "form": hidden.forms[name], "law": hidden.laws[name],
                "severity": truth.severities[name],
            }
            for name in case.effects
        ],
        "severity": case.severity,
        "noise": case.noise,
        "gap": gap_in_floors(rms, case.noise),
        "celsius": float(np.mean([record.columns["oil_temperature_degc"].mean() for record in runs])),
        "baseline": list_changes(truth.plant),
        "runs": [record.title for record in (*runs, *held_out)],
        "outputs": {
            column: {
                "unit": unit, "floor": floor[i], "rms": rms[i], "times_floor": rms[i] / floor[i],
                "holdout_rms": held_out_rms[i],
                "regimes": {
                    name: {
                        "rms": (size := float(np.sqrt(np.mean(difference[mask, i] ** 2)))),
                        "times_floor": size / floor[i],
                        "share": float(np.sum(difference[mask, i] ** 2) / whole[i]),
                    }
                    for name, mask in masks.items() if mask.any() and whole[i] > 0.0
                },
            }
            for i, (column, unit) in enumerate(zip(COLUMNS, UNITS, strict=True))
        },
    }  # fmt: skip
