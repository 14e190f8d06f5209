"""Start values of the joint fit: the steps of the thesis (stepwise.py), then a fit of the hydraulics from many starts."""

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

# Starts of the hydraulic fit: preload over contact pressure; damping and conductance over their declared values. From the best
# of these, rigs drawn within +-30 % all reached the same minimum
_PRELOADS, _DAMPINGS, _CONDUCTANCES = (0.6, 0.7, 0.8, 0.9), (0.6, 1.0, 1.6), (0.7, 1.0, 1.4)
_FITTED_STARTS = 2  # number of starts that are fitted: those with the least cost
# Number of runs of a first fit where no start has reached the noise: in `experiment identify` a staircase, and a run that moves
# pressure and speed. Fills of many runs have local minima: on one rig with a contact pressure that was 4 % wrong
_FIRST_RUNS = 2
_AT_END = 0.01  # largest share of rows at the largest value: noise reaches its own extreme once
_MOST_COST = 1.5  # largest mean square of residual over noise of a fit that has reached the noise
_MOST_COUNTED = 50.0  # noise floors: larger residuals are clipped to this in the comparison of starts
_ZERO_OF_LINE = 1.01  # ratio of contact pressure to the zero of the line of Table 6.3: 2.35 over 2.324 bar, Table 6.4


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
    """Estimate start values of all model parameters by dotted name, and of the effects.

    samples: of the runs with offsets subtracted. given: held values. effects: first estimates of the effects. timing [s]: see
    Evidence.

    Raises InputError where the runs show no torque that rises with the pressure, or a slope out of bounds.
    """
    declared = model.parameters
    values = {name: p.value for name, p in declared.items()} | dict(given)
    line = estimate_contact(samples)
    if line is None:
        raise InputError(
            "the runs show no torque that rises with the pressure at sliding plates; a staircase or a ramp of"
            f" pressures in contact, at a slip above 1 rad/s, is needed{_describe_ends(runs)}"
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


# Follows the question whether a clutch torque that keeps one value was measured
_WITHOUT_TORQUE = "leave it out of the import map: the motor's torque takes its place, if its speed demand was recorded"


def _describe_ends(runs: Sequence[Columns]) -> str:
    """Return a text on constant or saturated channels of voltage, pressure and torque, to be appended to a sentence."""
    sentences = []
    for name in ("valve_voltage_v", "cylinder_pressure_bar", "clutch_torque_nm"):
        size = np.abs(np.concatenate([run[name] for run in runs]))
        if np.ptp(size) == 0.0:
            instead = f" if not, {_WITHOUT_TORQUE}" if name == "clutch_torque_nm" else ""
            sentences.append(f"; {name} is {size[0]:.4g} throughout: was this channel connected?{instead}")
        elif name != "valve_voltage_v" and (rows := np.count_nonzero(size == size.max())) > _AT_END * len(size):
            sentences.append(f"; {name} is {size.max():.4g} at most, in {rows} rows: was it saturated?")
    return "".join(sentences)


def _fit_hydraulics(
    model: Model, runs: Sequence[Columns], floors: Values, free: Sequence[FreeParameter], start: Point, timing: float
) -> Point:
    """Return `start` with the hydraulic parameters fitted to the pressure alone."""
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
