"""Recalibration of a clutch: the values with which its model fits runs best. It is quicker than identification, which gives
intervals too.

Equation        as the joint fit (joint_fit.py), with sensitivities to one side and the model's own integration
"""

from clutch_hil.fitting.evidence import Evidence
from clutch_hil.fitting.model import Model, Values
from clutch_hil.fitting.recalibration import FLOOR, fit_to_end
from clutch_hil.identify.clutch_effects import SENSORS, correct_offsets, declare_effects, estimate_effects
from clutch_hil.identify.clutch_parameters import FITTED, HELD, NEEDS, FittedModel, from_fit, to_fit
from clutch_hil.identify.free_parameters import AS_DECLARED, TIMING, as_fitted, free_parameter, know_roughly
from clutch_hil.identify.starting_values import estimate_start
from clutch_hil.identify.stepwise import take_samples
from protocols.errors import InputError


def recalibrate_clutch(model: Model, evidence: Evidence, near: Values) -> dict[str, float]:
    """Every parameter of `model`, fitted within declared bounds: from `near`, then from the steps of the thesis.

    The better fit counts. Parameters that identification holds stay as they are; what the runs hardly excite is known roughly,
    as there.
    Offsets of sensors are fitted where they are parameters of the model, that is where their uncertainty is stated.
    """
    runs, floors = evidence.runs, evidence.floors
    shown, silent = estimate_effects(runs)
    stated = [name for name in SENSORS if name in model.parameters and name not in silent]
    begin = {name: shown[name] if name in stated else p.value for name, p in declare_effects().items()}
    samples = take_samples(correct_offsets(runs, begin))
    free = [free_parameter(model.parameters, name, None) for name in (*FITTED, *stated) if name not in HELD]
    held = {name: value for name, value in near.items() if name not in {f.name for f in free}}
    timed = Evidence(FittedModel(model, {}), runs, floors, evidence.rounding, TIMING)

    def fit(start: Values) -> tuple[float, dict[str, float]]:
        unmet = {name for need in NEEDS if need.warn(samples, start) for name in need.parameters}
        begun = {**start, **{name: near[name] for name in unmet if name in AS_DECLARED}}
        values = to_fit(begun)
        fitted = [as_fitted(f, begun) for f in free]
        fitted = [know_roughly(f, values[f.name]) if f.name in unmet else f for f in fitted]
        at = fit_to_end(timed, (values, {}), fitted)
        return timed.compute_excess(at.residual), from_fit(at.point[0])

    best = fit(near)
    if best[0] > FLOOR:
        try:
            steps, _ = estimate_start(model, runs, samples, floors, free, held, {}, TIMING, lambda share: None)
        except InputError:  # the runs show too little for the steps
            return best[1]
        best = min(best, fit({**steps, **{name: shown[name] for name in stated}}), key=lambda one: one[0])
    return best[1]
