"""Identify first: check whether a calibration beyond the stated uncertainty explains the disagreement without any effect.

Equation        e(x) = (|r(x)|^2 - N)/N:  power above the noise floor, as a share of the N residuals, without any tolerance for
                  errors of the laws
                identify first:  e(base) > DISAGREEMENT, e(recalibrated) <= max(DISAGREEMENT, e(effects)/10), and
                  e(effects) > e(recalibrated) + m,  m: DISAGREEMENT beside a single effect, CLOSED_EXCESS beside several
                or, beside several effects or alternatives:  e(recalibrated) <= CLOSED_EXCESS, and sum ((x - x_0)/s)^2 is not
                  rare, s: stated uncertainty; then a calibration within its stated distribution explains everything
Assumptions     a rig that has the model's equations can be fitted to the floor. These runs cannot distinguish a missing effect
                from a calibration that imitates it. Effects that explain as much with fewer parameters stay named beside a
                calibration that contradicts the stated uncertainties; a single effect without equals stays named beside any
                calibration. With a wrong calibration, a missing effect is found only after the rig is identified
"""

from collections.abc import Sequence
from math import isfinite

import numpy as np
from scipy.special import chdtri

from clutch_hil.discrepancy.decision import CLOSED_EXCESS, DISAGREEMENT
from clutch_hil.discrepancy.recalibration import Moved, Recalibration
from clutch_hil.discrepancy.result import Estimate
from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.fit import LinearModel
from clutch_hil.fitting.model import Model, find_calibration
from clutch_hil.fitting.recalibration import Identifiable, recalibrate
from protocols.files.units import space_unit

_MUCH_LESS = 0.5  # of what the effects leave: a re-calibration that leaves at most this share is reported
_FAR = 1.0  # stated uncertainties: a parameter that moved less is not reported
_LEAST_TOLD = 3  # parameters reported where none moved far: many small errors together
_RARE = 0.01  # of the rigs: a rarer calibration contradicts the stated uncertainties
# Share of the excess. Sensitivities hold near the baseline, so a calibration that explains everything may seem to leave some.
_LEFT_BY_SENSITIVITIES = 0.5
_AT_LIMIT = 0.99  # of the allowed change of a parameter: from here on the parameter is at its limit


def look_for_calibration(
    evidence: Evidence, base: LinearModel, best: Point, single: bool, doubtful: bool
) -> Recalibration | None:
    """Re-calibrate the model of `evidence` without tolerance; None where no calibration can change the answer.

    That is so where the baseline explains everything, and where one effect does and its gap is not like a calibration's.

    base: the baseline, re-fitted within its uncertainty. best: with the effects that explain most. single: whether `best` has
    one effect that may be named, whose law may be slightly wrong; False for several effects and for one that explains too
    little. doubtful: whether several effects, or alternatives, would be named.
    """
    model, margin = evidence.model, DISAGREEMENT if single else CLOSED_EXCESS
    before, effects = (evidence.compute_excess(r) for r in evidence.compute_residuals([base.point, best]))
    if not doubtful and (before <= DISAGREEMENT or (effects <= margin and not _can_explain(base))):
        return None
    values, after = recalibrate(evidence, base.point)
    if not isfinite(after):  # the model cannot be simulated there
        return None
    moved = [
        Moved(n, p.value, float(values[n]), p.unit, p.uncertainty)
        for n, p in model.parameters.items()
        if values[n] != p.value
    ]
    farthest = sorted(moved, key=lambda m: (m.uncertainty == 0.0, -m.sigmas))
    far = [m for m in farthest if m.sigmas > _FAR] or farthest[:_LEAST_TOLD]
    command = model.identification if isinstance(model, Identifiable) else None
    likely = doubtful and is_as_stated(moved)
    return Recalibration(tuple(far), before, after, effects, margin, command, likely)


def _can_explain(base: LinearModel) -> bool:
    """Return whether a calibration without limits could explain the residual of `base`, by its sensitivities alone.

    This costs no simulation. The re-calibration itself may take a third of a search.
    """
    size = base.residual.size
    left = base.residual - base.jacobian @ np.linalg.lstsq(base.jacobian, base.residual, rcond=None)[0]
    return bool(left @ left - size <= _LEFT_BY_SENSITIVITIES * (base.residual @ base.residual - size))


def is_as_stated(moved: Sequence[Moved]) -> bool:
    """Return whether a calibration is no rarer than one rig in a hundred whose parameters are as uncertain as stated."""
    return bool(sum(m.sigmas**2 for m in moved) <= chdtri(len(moved), _RARE))


def note_limits(model: Model, baseline: Sequence[Estimate], recalibration: Recalibration | None) -> list[str]:
    """Return notes on uncertainties that are stated too small.

    These are the uncertainties that an explaining re-calibration exceeds; otherwise those that limit the re-fitted baseline.
    baseline: re-fitted within its uncertainty.
    """
    share = find_calibration(model)
    if recalibration and recalibration.explains:
        needed = [
            f"{m.name} {abs(m.value - m.nominal) / share:.2g}{space_unit(m.unit)}"
            for m in recalibration.moved
            if m.uncertainty > 0.0 and abs(m.value - m.nominal) > share * m.uncertainty
        ]
        limits = "; ".join(needed)
        text = (
            f"uncertainties that would allow the calibration ({share:g} of each is used): {limits}; state"
            " them, or identify"
        )
        return [text] if needed else []
    notes = []
    for e in baseline:
        if e.uncertainty > 0.0 and abs(e.value - e.nominal) >= _AT_LIMIT * share * e.uncertainty:
            unit = space_unit(e.unit)
            remedy = (
                "check this sensor" if e.name.startswith("sensors.") else "state a larger uncertainty, or identify it"
            )
            notes.append(
                f"{e.name} ends at the limit of its uncertainty: {e.value:.4g}{unit} where {e.nominal:.4g} +-"
                f" {e.uncertainty:.2g} is stated and a share of {share:g} of it is allowed; {remedy}"
            )
    return notes


def note_rest(recalibration: Recalibration, named: bool) -> list[str]:
    """Return a note where the re-calibration explains as much as the effects, or more but not everything.

    named: whether effects, or alternatives, are named.
    """
    if recalibration.explains:
        left = (
            f"even after re-calibration the model leaves {recalibration.after:.2g} times the power of the noise floor"
        )
        return (
            [] if recalibration.is_complete else [f"{left}: an effect may also be missing; identify, then search again"]
        )
    much_less = recalibration.after <= _MUCH_LESS * recalibration.effects and not recalibration.is_complete
    if named and recalibration.equals and not much_less:
        return [
            f"a calibration beyond the stated uncertainty explains as much as what is named: {recalibration}. These runs"
            f" cannot tell which is right. If this rig was never identified, {recalibration.advice}"
        ]
    if not much_less:
        return []
    return [
        f"a calibration beyond the stated uncertainty explains {recalibration.closed:.1%} of the disagreement by itself,"
        f" more than these effects do, but not all of it: {recalibration}. If this rig was never identified,"
        f" {recalibration.advice}"
    ]
