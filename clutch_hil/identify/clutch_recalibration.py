"""Recalibration of a clutch: parameters that fit the runs best. It is faster than identification, and gives no intervals.

Equation        as the joint fit (joint_fit.py), with the model's own integration step: first one-sided sensitivities, then
                  central ones where more than the floor is left
                times first known to TIMING, because events within a sample could mislead the start; then exactly, as in the
                  test of effects
                where more than the floor is left, a second fit starts with all pressures of the clutch shifted by the best of
                  several shifts. In a run without a ramp the steps of the thesis cannot find the pressures, and a fit from
                  far away ends in a wrong minimum: for a contact pressure of 2.80 bar, a start at 2.35 ended at 2.53, with 6
                  times the floor's power
"""

from contextlib import suppress
from typing import NamedTuple

import numpy as np

from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.fit import FreeParameter, LinearModel
from clutch_hil.fitting.model import Model, Values
from clutch_hil.fitting.recalibration import FLOOR, LEAST_GAIN, fit_to_end
from clutch_hil.identify.clutch_effects import SENSORS, correct_offsets, declare_effects, estimate_effects
from clutch_hil.identify.clutch_parameters import FITTED, HELD, NEEDS, FittedModel, from_fit, shift_pressures, to_fit
from clutch_hil.identify.free_parameters import AS_DECLARED, TIMING, as_fitted, free_parameter, know_roughly
from clutch_hil.identify.joint_fit import settle
from clutch_hil.identify.starting_values import estimate_start
from clutch_hil.identify.stepwise import take_samples
from protocols.errors import InputError

# Shares of the contact pressure: for rigs 30 % and more away, in steps small enough for a fit
_SHIFTS = np.linspace(-0.35, 0.35, 15)


def recalibrate_clutch(model: Model, evidence: Evidence, near: Values) -> dict[str, float]:
    """Fit all parameters of `model` within their declared bounds. Return them by dotted name.

    Up to three starts: `near`, `near` with shifted pressures, and the steps of the thesis; the best fit is returned. Parameters
    that identification holds keep their values; hardly excited ones have a prior, as in identification. Offsets of sensors are
    fitted if they are parameters of the model, that is, if their uncertainty is stated.
    """
    runs, floors = evidence.runs, evidence.floors
    shown, silent = estimate_effects(runs)
    stated = [name for name in SENSORS if name in model.parameters and name not in silent]
    begin = {name: shown[name] if name in stated else p.value for name, p in declare_effects().items()}
    samples = take_samples(correct_offsets(runs, begin))
    free = [free_parameter(model.parameters, name, None) for name in (*FITTED, *stated) if name not in HELD]
    declared = {name: p.value for name, p in model.parameters.items()}
    held = {name: value for name, value in near.items() if name not in {f.name for f in free}}
    timed, exact = (
        Evidence(FittedModel(model, {}), runs, floors, evidence.rounding, t).take_as_independent()
        for t in (TIMING, 0.0)
    )

    def begin_at(start: Values) -> _Fit:
        unmet = {name for need in NEEDS if need.warn(samples, start) for name in need.parameters}
        begun = {**start, **{name: near[name] for name in unmet if name in AS_DECLARED}}
        values = to_fit(begun)
        fitted = [as_fitted(f, begun, declared) for f in free]
        fitted = [know_roughly(f, values[f.name]) if f.name in unmet else f for f in fitted]
        at = fit_to_end(timed, (values, {}), fitted)
        return _Fit(timed.compute_excess(at.residual), at.point, fitted)

    fit = begin_at(near)
    if fit.left > FLOOR:
        shifted = [shift_pressures(near, share * near["piston.contact_pressure"]) for share in _SHIFTS]
        residuals = timed.compute_residuals([(to_fit(values), {}) for values in shifted])
        best = int(np.nanargmin([timed.compute_excess(r) for r in residuals]))
        if _SHIFTS[best] != 0.0:
            fit = min(fit, begin_at(shifted[best]), key=lambda one: one.left)
    if fit.left > FLOOR:
        with suppress(InputError):  # raised if the runs do not suffice for these steps
            steps, _ = estimate_start(model, runs, samples, floors, free, held, {}, TIMING, lambda share: None)
            fit = min(fit, begin_at({**steps, **{name: shown[name] for name in stated}}), key=lambda one: one.left)
    point = fit.point
    for each in (timed, exact):
        point = _fit_closely(each, point, fit.free)
    return from_fit(point[0])


class _Fit(NamedTuple):
    """A fit: power `left` above the floor, its point, and the free parameters."""

    left: float
    point: Point
    free: list[FreeParameter]


def _fit_closely(evidence: Evidence, point: Point, free: list[FreeParameter]) -> Point:
    """Continue the fit where more than the floor is left, as long as a round gains enough."""

    def is_done(before: LinearModel, after: LinearModel) -> bool:
        then, now = (evidence.compute_excess(at.residual) for at in (before, after))
        return now <= FLOOR or then - now < LEAST_GAIN * now

    left = evidence.compute_excess(evidence.compute_residuals([point])[0])
    return settle(evidence, point, free, is_done).point if left > FLOOR else point
