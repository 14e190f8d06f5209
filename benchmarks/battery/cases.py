"""Cases of the battery: which effects are hidden, how strongly, behind how much noise; deterministic by name.

A name is family/effects/severity/noise/seed, such as `single/piston_seal_friction/2.0/0.02/s1`. Severity is the gap
that each effect makes alone: root of 1 + (d/floor)^2, d the root mean square of (with - without) over the five runs,
inputs held, free of noise, in the most affected analog output. The encoder has no noise of its own to be a share of,
and the motor's integrator turns any change of torque into an angle of thousands of its counts, so its columns do not
count as most affected.

Noise is the standard deviation of each analog channel as a share of what is typical for the rig: 3.4 bar and 17 Nm (the
pressure and torque at which the thesis measures most), 10 K (what a run of 24 s heats the oil).
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
from benchmarks.battery.truth import ANALOG, COLUMNS, OPEN, PERIOD, PRESSURE, TORQUE, Answer, Hidden, Inputs, simulate
from benchmarks.battery.truth_laws import CATALOGUE, LAWS, UNKNOWN, Law
from benchmarks.battery.truth_rig import BAR, changes, rig
from protocols.errors import InputError, closest
from protocols.files.run import Run
from protocols.files.runs import write_run

SEVERITIES = 1.3, 2.0, 4.0
NOISES = 0.005, 0.02, 0.05
UNITS = ("bar", "degC", "Nm", "Nm", "rad", "rad/s")
_RANGE = np.array([3.4, 10.0, 17.0, 17.0])  # bar, K, Nm, Nm
_SI = np.array([BAR, 1.0, 1.0, 1.0])
_STEPS = np.array([20 / 4096 / 1.0, 20 / 4096 / 0.05, 20 / 4096 / 0.2, 20 / 65536 / 0.2])  # of the converters: rig.md 9
_COUNT = 2.0 * np.pi / 163840  # rad, of the encoder
_CLOSE = 0.01  # of the difference asked for: what a strength is found to
_MOST_TRIES = 25
_WARM = 20.0  # K: oil that begins at 55..95 degC, else 65..85
_ENGAGING = 0.3  # s after touch: the slip and the motor's speed control have settled then
_MOVING = 0.2  # bar/s: a pressure that changes less has no direction
_MIXED = (2.0, 0.02), (4.0, 0.005)  # severity and noise of pairs and triples
FAMILIES = ("single", "null", "unknown", "pair", "triple", "warm", "closed")
_FIRST_SEED = {"development": 1, "evaluation": 101}


@dataclass(frozen=True)
class Case:
    """Family, names of the effects hidden, severity, noise as a share, seed."""

    family: str
    effects: tuple[str, ...]
    severity: float
    noise: float
    seed: int

    @property
    def name(self) -> str:
        """Unique; also the folder it is written to."""
        return f"{self.family}/{'+'.join(self.effects) or 'none'}/{self.severity}/{self.noise}/s{self.seed}"

    @classmethod
    def of(cls, name: str) -> "Case":
        """The case of that name. Raises InputError."""
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
        """The split that its seed belongs to."""
        return "evaluation" if self.seed >= _FIRST_SEED["evaluation"] else "development"

    def random(self, purpose: int) -> np.random.Generator:
        """Random numbers for one purpose."""
        return np.random.default_rng([zlib.crc32(self.name.encode()), purpose])


def floors(noise: float) -> np.ndarray:
    """Floor of each of COLUMNS (6,), in its unit: noise and rounding."""
    analog = np.hypot(noise * _RANGE, _STEPS / np.sqrt(12.0))
    return np.concatenate([analog, [_COUNT / np.sqrt(12.0), _COUNT / np.sqrt(6.0) / PERIOD]])


def gap(rms: np.ndarray, noise: float) -> float:
    """Gap, times the floor, of differences `rms` (6,) of COLUMNS."""
    return float(np.sqrt(1.0 + np.max((rms / floors(noise))[:ANALOG]) ** 2))


class Truth:
    """What a case hides: its rig, runs and effects at the strengths that give the severity."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self.plant = rig(int(case.random(1).integers(2**31)))
        seed = int(case.random(2).integers(2**31))
        self.inputs, self.held_out = excitation.runs(
            seed, closed_loop=case.family == "closed", spread=_WARM if case.family == "warm" else 10.0
        )
        self.reached: dict[str, float] = {}  # severity of each effect alone
        self._baselines: dict[int, np.ndarray] = {}

    @cached_property
    def hidden(self) -> Hidden:
        """All effects, each as strong as it must be alone."""
        alone = [self.scaled(name) for name in self.case.effects]
        return Hidden(*(dict(chain.from_iterable(getattr(one, part).items() for one in alone)) for part in _PARTS))

    def scaled(self, name: str) -> Hidden:
        """One effect, as strong as the severity asks, or as is physically possible."""
        law = LAWS[name]
        random = np.random.default_rng([zlib.crc32(self.case.name.encode()), 3, zlib.crc32(name.encode())])
        sign = -1.0 if law.signed and random.random() < 0.5 else 1.0
        second = int(self.case.split == "evaluation" and law.variants > 1)
        unit = Hidden({name: sign}, {name: float(random.uniform(-1.0, 1.0))}, {name: second})
        wanted = np.sqrt(self.case.severity**2 - 1.0)

        def size(strength: float) -> float:
            rms = self.difference(replace(unit, strengths={name: sign * strength * law.si}))
            return float(np.sqrt(gap(rms, self.case.noise) ** 2 - 1.0))

        first = law.usual * wanted * self.case.noise / _USUAL
        strength, found = _solved(size, wanted, law, first)
        self.reached[name] = float(np.sqrt(1.0 + found**2))
        return replace(unit, strengths={name: sign * strength * law.si})

    def difference(self, hidden: Hidden) -> np.ndarray:
        """Root mean square (6,) of (with - without) of COLUMNS over the five runs, free of noise, inputs held."""
        squares = []
        for k, inputs in enumerate(self.inputs):
            shown = simulate(inputs, hidden, self.plant)
            squares.append(np.mean((shown.rows - self._without(k, inputs, shown))[:, : len(COLUMNS)] ** 2, axis=0))
        return np.sqrt(np.mean(squares, axis=0))

    def _without(self, k: int, inputs: Inputs, shown: Answer) -> np.ndarray:
        if inputs.mode != OPEN:
            return simulate(inputs.held(shown.voltage), plant=self.plant).rows
        if k not in self._baselines:
            self._baselines[k] = simulate(inputs, plant=self.plant).rows
        return self._baselines[k]


_PARTS = "strengths", "forms", "laws"
_USUAL = np.sqrt(2.0**2 - 1.0) * 0.02  # a law's usual strength gives about a gap of 2 at 2 % noise


def _solved(size: Callable[[float], float], wanted: float, law: Law, first: float) -> tuple[float, float]:
    """Strength in the law's unit at which `size` is `wanted`, sought from `first` on, at most the law's; and its size.

    Regula falsi in logarithms: sizes go nearly with a power of the strength.
    """
    low, high = (0.0, 0.0), None  # strength and size below, above
    following = min(first, law.most)
    for _ in range(_MOST_TRIES):
        strength = following
        found = size(strength)
        if abs(found - wanted) <= _CLOSE * wanted:
            break
        if found < wanted:
            if strength >= law.most:
                break
            low = strength, found
        else:
            high = strength, found
        if high is None:
            growth = min(max(wanted / found, 1.05), 10.0) if found > 0.0 else 10.0
            following = min(strength * growth, law.most)
        elif low[0] == 0.0:
            following = high[0] * max(min(wanted / high[1], 0.95), 0.05)
        else:
            slope = np.log(high[1] / max(low[1], 1e-9)) / np.log(high[0] / low[0])
            share = np.log(wanted / max(low[1], 1e-9)) / slope / np.log(high[0] / low[0]) if slope > 0.0 else 0.5
            following = low[0] * (high[0] / low[0]) ** min(max(share, 0.1), 0.9)
        if high is not None and high[0] - low[0] < 1e-6 * high[0]:
            break
    return strength, found


def cases(split: str = "development", families: Sequence[str] = FAMILIES) -> list[Case]:
    """The cases of a split, development or evaluation: other seeds, and other laws where there are two. Raises
    InputError.

    Single effects come with three seeds where each severity is possible behind each noise, the others with one: an answer
    takes a minute of a CPU or more, and two CPUs are to answer all within a day.
    """
    if split not in _FIRST_SEED:
        raise InputError(f"split {split!r} is unknown; {closest(split, _FIRST_SEED)}")
    if unknown := [family for family in families if family not in FAMILIES]:
        raise InputError(f"family {unknown[0]!r} is unknown; {closest(unknown[0], FAMILIES)}")
    first = _FIRST_SEED[split]
    known = [law.name for law in CATALOGUE]
    everywhere = [
        name for name in known if all(map(_possible, _crossed("single", [(name,)], SEVERITIES, NOISES, [first])))
    ]
    # thresholds set on some unknown effects must hold for others, too
    strangers = [law.name for law in (UNKNOWN if split == "evaluation" else UNKNOWN[:6])]
    random = np.random.default_rng(first)
    pairs, triples = _mixed(random, 2, 40), _mixed(random, 3, 20)
    found = [
        *_crossed("single", [(name,) for name in known], SEVERITIES, NOISES, [first]),
        *_crossed("single", [(name,) for name in everywhere], SEVERITIES, NOISES, range(first + 1, first + 3)),
        *_crossed("null", [()], (1.0,), NOISES, range(first, first + 40)),
        *_crossed("unknown", [(name,) for name in strangers], (2.0, 4.0), NOISES, [first]),
        *(c for s, n in _MIXED for c in _crossed("pair", pairs, (s,), (n,), [first])),
        *(c for s, n in _MIXED for c in _crossed("triple", triples, (s,), (n,), [first])),
        *_crossed("warm", [(name,) for name in known], (2.0, 4.0), (0.02,), [first]),
        *_crossed("warm", [()], (1.0,), (0.02,), range(first, first + 10)),
        *_crossed("closed", [(name,) for name in known], (2.0, 4.0), (0.02,), [first]),
        *_crossed("closed", [()], (1.0,), (0.02,), range(first, first + 10)),
    ]
    return [case for case in found if case.family in families and _possible(case)]


def _crossed(
    family: str,
    effects: Sequence[tuple[str, ...]],
    severities: Sequence[float],
    noises: Sequence[float],
    seeds: Sequence[int],
) -> list[Case]:
    return [Case(family, *values) for values in product(effects, severities, noises, seeds)]


def _mixed(random: np.random.Generator, size: int, count: int) -> list[tuple[str, ...]]:
    """Sets of `size` effects of the catalogue from different blocks."""
    sets: list[tuple[str, ...]] = []
    while len(sets) < count:
        drawn = tuple(sorted(random.choice([law.name for law in CATALOGUE], size, replace=False).tolist()))
        if len({LAWS[name].block for name in drawn}) == size and drawn not in sets:
            sets.append(drawn)
    return sets


def _possible(case: Case) -> bool:
    """Whether the severity is reached with strengths that are physically possible. Differences over floors go with 1/noise."""
    return all(
        case.severity**2 - 1.0 <= (LAWS[name].reach ** 2 - 1.0) * (0.02 / case.noise) ** 2 for name in case.effects
    )


@dataclass(frozen=True)
class Record:
    """A run as recorded, `columns` of rig.md, and what its differences, free of noise, are: `regimes` of each
    sample.
    """

    title: str
    columns: Mapping[str, np.ndarray]
    difference: np.ndarray  # (n, 6), with - without, of COLUMNS
    regimes: Mapping[str, np.ndarray]  # masks (n,) by name


@dataclass(frozen=True)
class Generated:
    """What a case gives: runs, held-out runs, and the truth as JSON takes it."""

    runs: Sequence[Record]
    held_out: Sequence[Record]
    truth: Mapping[str, Any]


def generate(case: Case) -> Generated:
    """The runs of a case and its truth."""
    truth = Truth(case)
    hidden = truth.hidden
    random = case.random(4)
    records = [recorded(inputs, hidden, truth.plant, case.noise, random) for inputs in truth.inputs + truth.held_out]
    runs, held_out = records[: len(truth.inputs)], records[len(truth.inputs) :]
    return Generated(runs, held_out, _told(case, truth, hidden, runs, held_out))


def further(told: Mapping[str, Any], title: str, pressure: np.ndarray, speed: np.ndarray, celsius: float) -> Record:
    """One more run of a case of which `told` is the truth: demands `pressure` [bar], `speed` [rad/s] (n,), oil at `celsius`."""
    case, hidden = Case.of(told["name"]), Hidden({}, {}, {})
    for effect in told["effects"]:
        name = effect["name"]
        hidden = Hidden(
            {**hidden.strengths, name: effect["strength"] * LAWS[name].si},
            {**hidden.forms, name: effect["form"]},
            {**hidden.laws, name: effect["law"]},
        )
    inputs = Inputs(title, PRESSURE, pressure, speed, celsius, np.zeros(len(speed)))
    return recorded(inputs, hidden, rig(int(case.random(1).integers(2**31))), case.noise, case.random(5))


def write(case: Case, folder: Path) -> tuple[list[Path], list[Path]]:
    """Write a case: runs and held-out runs below FOLDER/runs, its truth, apart from them, below FOLDER/truth.

    Returns the paths of the runs and of the held-out runs. Raises InputError.
    """
    made = generate(case)
    place = folder / "runs" / case.name
    paths = [
        [place / f"{kind}-{k}.parquet" for k in range(1, len(records) + 1)]
        for kind, records in (("run", made.runs), ("holdout", made.held_out))
    ]
    for path, record in zip(chain(*paths), (*made.runs, *made.held_out), strict=True):
        metadata = {"rig": "wet_clutch", "sample_rate_hz": round(1.0 / PERIOD), "notes": record.title}
        write_run(Run(record.columns, metadata), path)
    told = folder / "truth" / case.name / "truth.json"
    told.parent.mkdir(parents=True, exist_ok=True)
    told.write_text(json.dumps(made.truth, indent=1), encoding="utf-8")
    return paths[0], paths[1]


def recorded(inputs: Inputs, hidden: Hidden, plant: np.ndarray, noise: float, random: np.random.Generator) -> Record:
    """One run as recorded, with noise drawn from `random`, and its differences."""
    n = len(inputs.command)
    drawn = random.standard_normal((n, ANALOG)) * noise * _RANGE * _SI
    shown = simulate(inputs, hidden, plant, drawn)
    held = inputs.held(shown.voltage)
    without = simulate(held, plant=plant)
    difference = np.zeros((n, len(COLUMNS)))
    if hidden.strengths:
        difference = (simulate(held, hidden, plant).rows - without.rows)[:, : len(COLUMNS)]
    measured = dict(zip(COLUMNS, shown.rows.T, strict=False))
    columns = {
        "time_s": PERIOD * np.arange(n),
        "valve_voltage_v": shown.voltage,
        "motor_speed_demand_rad_s": inputs.speed,
    }
    columns |= {name: measured[name].copy() for name in _ORDER}
    if inputs.mode == TORQUE:
        columns["torque_demand_nm"] = inputs.command
    return Record(inputs.title, columns, difference, _regimes(without))


_ORDER = (  # of rig.md
    "cylinder_pressure_bar", "slip_speed_rad_s", "shaft_angle_rad", "oil_temperature_degc", "clutch_torque_nm",
    "motor_torque_nm",
)  # fmt: skip


def _regimes(shown: Answer) -> dict[str, np.ndarray]:
    """Masks (n,): one phase for each sample, the direction of the pressure while pressed, and that of the slip."""
    asked, pressed = shown.voltage > 0.0, shown["normal_force"] > 0.0
    n = np.arange(len(asked))
    begun = np.maximum.accumulate(np.where(pressed & ~np.roll(pressed, 1), n, -len(n)))
    settling = n - begun < _ENGAGING / PERIOD
    away = shown["position"] > 1e-6  # m
    rate = np.gradient(shown["pressure"], PERIOD)
    return {
        "phase=open": ~asked & ~pressed & ~away,
        "phase=fill": asked & ~pressed,
        "phase=engage": asked & pressed & settling,
        "phase=slip": asked & pressed & ~settling,
        "phase=release": ~asked & (pressed | away),
        "direction=apply": pressed & (rate > _MOVING),
        "direction=release": pressed & (rate < -_MOVING),
        "slip=forward": shown["slip"] > 0.0,
        "slip=backward": shown["slip"] < 0.0,
    }


def _rms(records: Sequence[Record]) -> np.ndarray:
    return np.sqrt(np.mean([np.mean(record.difference**2, axis=0) for record in records], axis=0))


def _told(
    case: Case, truth: Truth, hidden: Hidden, runs: Sequence[Record], held_out: Sequence[Record]
) -> dict[str, Any]:
    floor, rms, unseen = floors(case.noise), _rms(runs), _rms(held_out)
    difference = np.concatenate([record.difference for record in runs])
    masks = {name: np.concatenate([record.regimes[name] for record in runs]) for name in runs[0].regimes}
    whole = np.sum(difference**2, axis=0)
    return {
        "name": case.name,
        "split": case.split,
        "effects": [
            {
                "name": name, "block": LAWS[name].block, "in_catalogue": LAWS[name] in CATALOGUE,
                "strength": hidden.strengths[name] / LAWS[name].si, "unit": LAWS[name].unit,
                "form": hidden.forms[name], "law": hidden.laws[name],
                "severity": truth.reached[name],
            }
            for name in case.effects
        ],
        "severity": case.severity,
        "noise": case.noise,
        "gap": gap(rms, case.noise),
        "celsius": float(np.mean([record.columns["oil_temperature_degc"].mean() for record in runs])),
        "baseline": changes(truth.plant),
        "runs": [record.title for record in (*runs, *held_out)],
        "outputs": {
            column: {
                "unit": unit, "floor": floor[i], "rms": rms[i], "times_floor": rms[i] / floor[i],
                "holdout_rms": unseen[i],
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
