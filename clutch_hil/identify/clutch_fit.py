"""ClutchFit: start values and joint fit of a clutch, according to a plan."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from clutch_hil.fitting.evidence import Evidence
from clutch_hil.fitting.fit import FreeParameter
from clutch_hil.fitting.model import Columns, Values
from clutch_hil.identify.calibration import Identified
from clutch_hil.identify.clutch_effects import (
    EFFECTS,
    choose_absent,
    correct_offsets,
    declare_effects,
    estimate_effects,
)
from clutch_hil.identify.clutch_parameters import (
    NEEDS,
    FittedModel,
    compute_viscous_scale,
    from_fit,
    tie,
    to_fit,
)
from clutch_hil.identify.fit_plan import FitPlan, Subject
from clutch_hil.identify.free_parameters import (
    TIMING,
    as_fitted,
    choose_hardly_excited,
    is_viscous,
    know_roughly,
)
from clutch_hil.identify.joint_fit import JointFit, fit_jointly
from clutch_hil.identify.starting_values import estimate_start
from clutch_hil.identify.stepwise import take_samples
from clutch_hil.identify.thesis_quantities import (
    as_covariance,
)
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet

FINE_STEP = 1.25e-4  # s, step of the accurate integration: a quarter of the fast one's
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class ClutchFit:
    """Result of the joint fit of a clutch: `values` of all parameters and effects.

    excited, hardly: fitted parameters that the runs excite well, or hardly. unmet: a sentence on what the runs lack, by
    parameter. absent: effects found absent and held off. means: number of block means in the evidence.
    """

    joint: JointFit
    values: Values
    excited: Sequence[FreeParameter]
    hardly: Sequence[FreeParameter]
    unmet: Mapping[str, str]
    absent: Sequence[Identified]
    means: int

    @property
    def free(self) -> Sequence[FreeParameter]:
        return [*self.excited, *self.hardly]

    def compute_covariance(self) -> np.ndarray:
        """Return the covariance (p, p) of the rig's free parameters; C_v = K/omega_r^gamma by its derivatives in K and
        gamma."""
        names = [f.name for f in self.free]
        change = np.eye(len(names))
        scale = compute_viscous_scale(self.values)
        for k, name in enumerate(names):
            if is_viscous(name):
                change[k, k] = 1.0 / scale
                if "clutch.viscous_exponent" in names:
                    change[k, names.index("clutch.viscous_exponent")] = -self.values[name] * np.log(10.0)
        return np.asarray(change @ as_covariance(self.joint.half, self.joint.correlation) @ change.T)


def fit_clutch(
    subject: Subject, plan: FitPlan, columns: Sequence[Columns], floors: Mapping[str, float], progress: Progress
) -> ClutchFit:
    """Estimate start values step by step, then fit all parameters of the plan jointly. Raises InputError if none is excited."""
    model, off = subject.make(subject.nominal), {name: p.value for name, p in declare_effects().items()}
    effects, silent = estimate_effects(columns)
    effects = {
        name: value if name in subject.effects or name not in EFFECTS else off[name] for name, value in effects.items()
    }
    samples = take_samples(correct_offsets(columns, effects))
    effects |= {name: value for name, value in plan.given.items() if name in effects}
    progress("starting values", 0.0)
    begin = estimate_start(
        model, columns, samples, floors, plan.free, {n: v for n, v in plan.given.items() if n in model.parameters}, effects,
        TIMING, lambda share: progress("starting values", 0.2 * share),
    )  # fmt: skip
    start = dict(begin[0])
    outputs = {output.column for output in model.outputs}
    needs = [n for n in NEEDS if set(n.parameters) & set(subject.fitted) and (not n.of or n.of in outputs)]
    unmet = {name: text for need in needs if (text := need.warn(samples, start)) for name in need.parameters}
    unmet |= {name: text for name, text in silent.items() if name in subject.effects}
    hardly = [f for f in plan.free if f.name in unmet]
    excited = [f for f in plan.free if f.name not in unmet]
    if not excited:
        raise InputError(f"these runs excite no parameter of the clutch: {'; '.join(dict.fromkeys(unmet.values()))}")
    start |= choose_hardly_excited(hardly, start, plan.declared)
    begun = to_fit(tie(start, plan.ratios))
    known_roughly = {**begun, **begin[1]}
    fitted = [as_fitted(f, start, plan.declared) for f in excited]
    fitted += [know_roughly(as_fitted(f, start, plan.declared), known_roughly[f.name]) for f in hardly]
    coarse, fine = (
        Evidence(FittedModel(one, plan.ratios), columns, floors, timing=TIMING)
        for one in (model, subject.make(subject.nominal, step=FINE_STEP))
    )
    joint = fit_jointly(coarse, fine, (begun, begin[1]), fitted, lambda share: progress("joint fit", 0.2 + 0.7 * share))
    absent, joint = _hold_absent(joint, off, plan.known, [f.name for f in excited])
    present = [f for f in excited if f.name not in {a.name for a in absent}]
    values = from_fit(joint.at.point[0], plan.ratios) | dict(joint.at.point[1])
    return ClutchFit(joint, values, present, hardly, unmet, absent, fine.size)


def _hold_absent(
    joint: JointFit, off: Values, known: ParameterSet, excited: Sequence[str]
) -> tuple[list[Identified], JointFit]:
    """Return the absent effects among the names `excited` with their intervals, and the fit with these effects off."""
    values = np.array([joint.at.find_value(f) for f in joint.at.free])
    names = [f.name for f in joint.at.free]
    count = len(excited)  # the hardly excited ones come last
    absent = choose_absent(names[:count], values[:count], joint.half[:count], joint.correlation[:count, :count])
    intervals = [
        Identified(name, float(values[k]), float(joint.half[k]), known[name].unit, off[name])
        for name, k in ((name, names.index(name)) for name in absent)
    ]
    return intervals, joint.hold(absent, ({}, off)) if absent else joint
