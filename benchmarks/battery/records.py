"""Records of a case: its simulated runs with noise, their regimes, and the description of its truth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.battery.cases import Case
from benchmarks.battery.floors import TYPICAL, compute_gap, compute_noise_floors
from benchmarks.battery.truth import Truth
from benchmarks.battery.truth_laws import CATALOGUE_LAWS, LAWS
from benchmarks.battery.truth_rig import BAR, draw_rig, list_changes
from benchmarks.battery.truth_simulation import (
    ANALOG_COUNT,
    COLUMNS,
    PERIOD,
    PRESSURE,
    TORQUE,
    HiddenEffects,
    Inputs,
    Response,
    simulate,
)

UNITS = ("bar", "degC", "Nm", "Nm", "rad", "rad/s")  # of COLUMNS
_SI = np.array([BAR, 1.0, 1.0, 1.0])  # Pa/bar, K/K, Nm/Nm, Nm/Nm: units of the analog columns in SI
_ENGAGE_TIME = 0.3  # s after contact; chosen: slip and motor speed have settled by then
# bar/s, below which a pressure has no direction; chosen: slower than any demand
_MOVING_RATE = 0.2


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
    random = case.make_generator(4)
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
    return record_run(
        inputs, hidden, draw_rig(int(case.make_generator(1).integers(2**31))), case.noise, case.make_generator(5)
    )


def record_run(
    inputs: Inputs, hidden: HiddenEffects, plant: np.ndarray, noise: float, random: np.random.Generator
) -> RecordedRun:
    """Simulate and record one run, with noise drawn from `random`. noise: share of the typical values."""
    n = len(inputs.command)
    noise_values = random.standard_normal((n, ANALOG_COUNT)) * noise * TYPICAL * _SI
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


def _compute_rms_difference(records: Sequence[RecordedRun]) -> np.ndarray:
    return np.sqrt(np.mean([np.mean(record.difference**2, axis=0) for record in records], axis=0))


def _describe_truth(
    case: Case, truth: Truth, hidden: HiddenEffects, runs: Sequence[RecordedRun], held_out: Sequence[RecordedRun]
) -> dict[str, Any]:
    floor, rms, held_out_rms = (
        compute_noise_floors(case.noise),
        _compute_rms_difference(runs),
        _compute_rms_difference(held_out),
    )
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
        "gap": compute_gap(rms, case.noise),
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
