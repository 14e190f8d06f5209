"""Starting values of the joint fit: the steps of the thesis (stepwise.py), then the hydraulics from many starts."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.fit import FreeParameter
from clutch_hil.fitting.model import Columns, Model, Values
from clutch_hil.identify.clutch_effects import HYDRAULIC_EFFECTS
from clutch_hil.identify.clutch_parameters import HYDRAULIC, HydraulicModel
from clutch_hil.identify.joint_fit import fit_roughly
from clutch_hil.identify.stepwise import (
    Samples,
    estimate_contact,
    estimate_friction,
    estimate_motor,
    estimate_oil,
    estimate_valve_gain,
)
from protocols.errors import InputError

# Starts of the hydraulic fit: preload over contact pressure, damping and conductance over their declared values. Rigs drawn
# within +-30 % all came to the same minimum from the best of these
_PRELOADS, _DAMPINGS, _CONDUCTANCES = (0.6, 0.7, 0.8, 0.9), (0.6, 1.0, 1.6), (0.7, 1.0, 1.4)
_FITTED_STARTS = 2  # that are fitted: those with the least cost
# Runs from which it begins where no start has led to the noise: of `experiment identify` a staircase, and one that moves
# pressure and speed. Fills of many runs have minima of their own: on one rig with the contact pressure 4 % off
_FIRST_RUNS = 2
_AT_END = 0.01  # share of rows at the largest value: noise reaches its own extreme once
_MOST_COST = 1.5  # mean square of the residual over the noise, of a fit that has led there
_MOST_COUNTED = 50.0  # floors: a residual counts no more when starts are compared
_ZERO_OF_LINE = (
    1.01  # contact pressure over the pressure at which the line of Table 6.3 is 0: 2.35 over 2.324 bar, Table 6.4
)


def estimate_start(
    model: Model,
    runs: Sequence[Columns],
    samples: Samples,
    floors: Values,
    free: Sequence[FreeParameter],
    given: Values,
    effects: Values,
    timing: float,
    progress: Callable[[float], None],
) -> Point:
    """Every parameter of the model, by dotted name, near the runs; and the effects.

    samples: of the runs without their offsets. given: held values; effects: their first estimates; timing [s]: see Evidence.

    Raises InputError where the runs show no torque that rises with the pressure: then nothing of a clutch is in them.
    """
    declared = model.parameters
    values = {name: p.value for name, p in declared.items()} | dict(given)
    line = estimate_contact(samples)
    if line is None:
        raise InputError(
            "the runs show no torque that rises with the pressure at sliding plates; needed is a staircase or a ramp of"
            f" pressures in contact, at a slip above 1 rad/s{_describe_ends(runs)}"
        )
    slope, zero = line
    low, high = declared["clutch.coulomb_slope"].bounds
    if not low <= slope <= high:
        raise InputError(
            f"the torque at sliding plates rises by {slope:.4g} Nm/bar; allowed is {low:g} to {high:g}: check the units of"
            " clutch_torque_nm and cylinder_pressure_bar in the import map"
        )
    contact = _ZERO_OF_LINE * zero
    scale = contact / declared["piston.contact_pressure"].value
    estimates: dict[str, float | None] = {
        "valve.gain": estimate_valve_gain(samples),
        "piston.contact_pressure": contact,
        "piston.preload_pressure": scale * declared["piston.preload_pressure"].value,
        **estimate_friction(samples, (slope, zero), declared),
        **(estimate_oil(samples) or {}),
        **estimate_motor(samples, declared["motor.torque_limit"].value),
    }
    limits = {f.name: f for f in free}
    values |= {name: value for name, value in estimates.items() if value is not None and name in limits}
    values |= {n: float(np.clip(values[n], f.low, f.high)) for n, f in limits.items() if n in values}
    progress(0.3)
    hydraulic = [limits[name] for name in (*HYDRAULIC, *HYDRAULIC_EFFECTS) if name in limits]
    return _fit_hydraulics(model, runs, floors, hydraulic, (values, effects), timing)


def _describe_ends(runs: Sequence[Columns]) -> str:
    """What voltage, pressure and torque rest at, as a dead channel or a converter at its end, to be added to a sentence."""
    sentences = []
    for name in ("valve_voltage_v", "cylinder_pressure_bar", "clutch_torque_nm"):
        size = np.abs(np.concatenate([run[name] for run in runs]))
        if np.ptp(size) == 0.0:
            sentences.append(f"; {name} is {size[0]:.4g} throughout: was this channel connected?")
        elif name != "valve_voltage_v" and (rows := np.count_nonzero(size == size.max())) > _AT_END * len(size):
            sentences.append(f"; {name} is {size.max():.4g} at most, in {rows} rows: was it saturated?")
    return "".join(sentences)


def _fit_hydraulics(
    model: Model, runs: Sequence[Columns], floors: Values, free: Sequence[FreeParameter], start: Point, timing: float
) -> Point:
    """`start` with the hydraulics fitted to the pressure alone."""
    if not free:
        return start
    values, effects = start
    evidence = Evidence(HydraulicModel(model), runs, floors, timing=timing)
    names = {f.name for f in free}
    starts: list[Point] = []
    for preload, damping, conductance in product(_PRELOADS, _DAMPINGS, _CONDUCTANCES):
        moved = {
            "piston.preload_pressure": preload * values["piston.contact_pressure"],
            "piston.damping": damping * values["piston.damping"],
            "hydraulics.conductance": conductance * values["hydraulics.conductance"],
        }
        inside = {f.name: float(np.clip(moved[f.name], f.low, f.high)) for f in free if f.name in moved}
        starts.append(({**values, **{n: v for n, v in inside.items() if n in names}}, effects))
    costs = [
        float(np.sum(np.minimum(np.abs(np.nan_to_num(r, nan=_MOST_COUNTED)), _MOST_COUNTED)))
        for r in evidence.compute_residuals(starts)
    ]
    best = [starts[k] for k in np.argsort(costs)[:_FITTED_STARTS]]
    stepped = [replace(f, step=0.25 * f.step) for f in free]
    fits = [fit_roughly(evidence, point, stepped) for point in best]
    if len(runs) > _FIRST_RUNS and min(at.cost for at in fits) > _MOST_COST * evidence.size:
        first = _fit_hydraulics(model, runs[:_FIRST_RUNS], floors, free, start, timing)
        fits.append(fit_roughly(evidence, first, stepped))
    return min(fits, key=lambda at: at.cost).point
