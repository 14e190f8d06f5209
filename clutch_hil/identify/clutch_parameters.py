"""Clutch parameters: which ones of a wet clutch are identified, which cannot be, and what its runs must excite.

Equation        C_v is fitted as the viscous torque K = C_v omega_r^gamma at omega_r = 10 rad/s: C_v itself varies with gamma
                  as 10^gamma, along a curved valley of the cost
                volumes: for any factor s, clearance, conductance and capacity times s, with damping and stack stiffness
                  divided by s, give the same pressures and torques (docs/rig.md, 2 to 4). So the clearance is held, and
                  these parameters are relative to it
                oil: mu(T)/mu(70 degC) - 1 (eq. 6.3) has one scale, A/mu(70 degC). So A and B are held, and the viscous gain is
                  fitted
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from clutch_hil.fitting.model import Columns, Model, Output, Partial, Timed, Values
from clutch_hil.identify.stepwise import Samples

FITTED = (
    "valve.gain", "valve.frequency", "valve.damping", "hydraulics.conductance", "hydraulics.capacity",
    "piston.contact_pressure", "piston.preload_pressure", "piston.clearance", "piston.stack_stiffness", "piston.damping",
    "clutch.coulomb_slope", "clutch.coulomb_intercept", "clutch.viscous_slope", "clutch.viscous_intercept", "clutch.beta_inf",
    "clutch.beta_onset", "clutch.beta_scale", "clutch.stribeck_speed", "clutch.viscous_exponent", "clutch.attraction",
    "oil.viscous_gain", "oil.heat_capacity", "oil.heat_transfer", "oil.sump_temperature", "motor.inertia",
    "motor.proportional_gain", "motor.integral_gain",
)  # fmt: skip
HELD: Mapping[str, str] = {  # held by default, with the reason
    "piston.clearance": "pressures and torques alone do not show a volume: conductance, capacity, damping and stack"
    " stiffness are relative to it; --hold NAME=VALUE gives that of the drawing",
}
HYDRAULIC = (
    "valve.frequency", "valve.damping", "hydraulics.conductance", "hydraulics.capacity", "piston.contact_pressure",
    "piston.preload_pressure", "piston.damping",
)  # fmt: skip
# Shifted directly by shift_pressures, like the lines
_PRESSURES = ("piston.contact_pressure", "piston.preload_pressure", "clutch.beta_onset")
_VISCOUS = ("clutch.viscous_slope", "clutch.viscous_intercept")
_EXPONENT, _REFERENCE_SLIP = "clutch.viscous_exponent", 10.0  # rad/s: in the middle of the maps' logarithmic range

Ties = Mapping[str, tuple[str, float]]  # parameter -> (other parameter, ratio to it)
NO_TIES: Ties = {}


def compute_viscous_scale(values: Values) -> float:
    """Compute omega_r^gamma, the factor from C_v to the viscous torque at the reference slip."""
    return float(_REFERENCE_SLIP ** values[_EXPONENT])


def tie(values: Values, ties: Ties) -> dict[str, float]:
    """Return `values` with each tied parameter set to its ratio times the other one."""
    return {**values, **{name: ratio * values[other] for name, (other, ratio) in ties.items()}}


def to_fit(values: Values) -> dict[str, float]:
    """Convert the rig's parameters to the fitted ones: C_v becomes the viscous torque at the reference slip."""
    return {**values, **{name: values[name] * compute_viscous_scale(values) for name in _VISCOUS}}


def from_fit(values: Values, ties: Ties = NO_TIES) -> dict[str, float]:
    """Convert the fitted parameters to those of the rig, in which `ties` hold: the ratios are those of C_v, not of K."""
    known = tie(values, ties)  # a tied gamma changes C_v
    return tie({**known, **{name: known[name] / compute_viscous_scale(known) for name in _VISCOUS}}, ties)


def shift_pressures(values: Values, shift: float) -> dict[str, float]:
    """Return `values` of a clutch with all characteristic pressures increased by `shift` [bar]."""
    lines = {
        f"clutch.{line}_intercept": values[f"clutch.{line}_intercept"] - shift * values[f"clutch.{line}_slope"]
        for line in ("coulomb", "viscous")
    }
    return {**values, **{name: values[name] + shift for name in _PRESSURES}, **lines}


class FittedModel:
    """The `model` of a clutch as a function of the fitted parameters."""

    def __init__(self, model: Model, ties: Ties) -> None:
        self._model, self._ties = model, dict(ties)
        self.name, self.inputs, self.outputs = model.name, model.inputs, model.outputs
        self.parameters, self.candidates = model.parameters, model.candidates
        if isinstance(model, Partial):
            self.find_unseen = model.find_unseen
        if isinstance(model, Timed):
            self.estimate_timing = model.estimate_timing
            self.doubtful_timing, self.most_timing = model.doubtful_timing, model.most_timing

    def simulate(self, run: Columns, parameters: Values, effects: Values) -> Columns:
        """See `Model`."""
        return self._model.simulate(run, from_fit(parameters, self._ties), effects)


class HydraulicModel:
    """The hydraulics of a clutch's `model` alone: cylinder pressure from valve voltage."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self.name, self.inputs, self.parameters, self.candidates = (
            model.name,
            model.inputs,
            model.parameters,
            model.candidates,
        )
        self.outputs: tuple[Output, ...] = tuple(o for o in model.outputs if o.column == "cylinder_pressure_bar")
        if isinstance(model, Timed):
            self.estimate_timing = model.estimate_timing
            self.doubtful_timing, self.most_timing = model.doubtful_timing, model.most_timing

    def simulate(self, run: Columns, parameters: Values, effects: Values) -> Columns:
        """See `Model`."""
        return self._model.simulate_block("hydraulics", run, parameters, effects)  # type: ignore[attr-defined]


@dataclass(frozen=True)
class Need:
    """A condition on the runs for fitting `parameters`: `value` of samples and parameters must be at least `least`.

    sentence: warning, with the fields shown and least. of: output column that must be compared for the need to apply, "" for
    several outputs.
    """

    parameters: tuple[str, ...]
    value: Callable[[Samples, Values], float]
    least: float
    sentence: str
    of: str = ""

    def warn(self, samples: Samples, values: Values) -> str:
        """Return the warning sentence where the condition is not met, else "". values: parameters of the rig."""
        shown = self.value(samples, values)
        return "" if shown >= self.least else self.sentence.format(shown=shown, least=self.least)


def _find_sliding(s: Samples) -> np.ndarray:
    """Return a mask (n,) of the samples with sliding plates: the calm ones, or all if none is calm, as in short engagements."""
    return s.sliding if np.any(s.sliding) else s.slipping


def _measure_span(values: np.ndarray) -> float:
    return float(np.quantile(values, 0.98) - np.quantile(values, 0.02)) if len(values) else 0.0


def _compute_low_slip(s: Samples, v: Values) -> float:
    """Compute V_S over the 2 % quantile of the slips in contact."""
    slips = np.abs(s.slip[_find_sliding(s)])
    return v["clutch.stribeck_speed"] / float(np.quantile(slips, 0.02)) if len(slips) else 0.0


def _compute_slip_ratio(s: Samples, v: Values) -> float:
    slips = np.abs(s.slip[_find_sliding(s)])
    return float(np.quantile(slips, 0.98) / np.quantile(slips, 0.02)) if len(slips) else 0.0


def _count_fills(s: Samples, v: Values) -> float:
    """Count how often the pressure rises in a run from below half the preload to above the contact pressure."""
    empty, count = False, 0
    for pressure, last in zip(s.pressure, s.last, strict=True):
        if pressure < 0.5 * v["piston.preload_pressure"]:
            empty = True
        elif empty and pressure > v["piston.contact_pressure"]:
            empty, count = False, count + 1
        if last:  # an empty cylinder at the end of a run is not filled at the beginning of the next
            empty = False
    return float(count)


NEEDS: tuple[Need, ...] = (
    Need(("clutch.stribeck_speed", "clutch.beta_inf"), _compute_low_slip, 1.3,
         "V_S and beta need slips well below V_S; V_S is {shown:.2g} times the lowest slip of these runs, {least:g} times is"
         " needed"),
    Need(("clutch.viscous_exponent",), _compute_slip_ratio, 3.0,
         "gamma needs slips that differ; the highest is {shown:.2g} times the lowest in these runs, {least:g} times is needed"),
    Need(("clutch.coulomb_slope", "clutch.coulomb_intercept", *_VISCOUS),
         lambda s, v: _measure_span(s.pressure[_find_sliding(s)]), 0.5,
         "M_C(p) and C_v(p) need pressures that differ in contact; these runs span {shown:.2g} bar, {least:g} bar is needed"),
    Need(("clutch.beta_onset", "clutch.beta_scale"), lambda s, v: _measure_span(s.pressure[_find_sliding(s)]), 0.5,
         "beta(p) needs pressures from contact on; these runs span {shown:.2g} bar in contact, {least:g} bar is needed"),
    Need(("clutch.attraction",), lambda s, v: float(np.quantile(np.abs(s.slip_rate[s.loaded]), 0.99))
         if np.any(s.loaded) else 0.0, 30.0,
         "C needs a slip that changes fast in contact; these runs reach {shown:.2g} rad/s^2, {least:g} rad/s^2 is needed"),
    Need(("oil.viscous_gain",), lambda s, v: _measure_span(s.temperature[_find_sliding(s)]), 8.0,
         "the temperature law needs several temperatures; these runs span {shown:.2g} K in contact, {least:g} K is needed",
         "oil_temperature_degc"),
    Need(("oil.heat_capacity", "oil.heat_transfer", "oil.sump_temperature"), lambda s, v: _measure_span(s.temperature), 4.0,
         "the heat balance needs a heating run; the oil moves by {shown:.2g} K, {least:g} K is needed",
         "oil_temperature_degc"),
    Need(("piston.preload_pressure", "piston.damping", "hydraulics.conductance", "hydraulics.capacity"), _count_fills, 1.0,
         "springs, piston and oil volumes need a fill from an empty cylinder; these runs have {shown:g}, {least:g} is needed"),
    Need(("motor.inertia", "motor.proportional_gain", "motor.integral_gain"),
         lambda s, v: float(np.quantile(np.abs(s.slip_rate), 0.99)), 30.0,
         "inertia and drive need a speed that changes; these runs reach {shown:.2g} rad/s^2, {least:g} rad/s^2 is needed"),
)  # fmt: skip
