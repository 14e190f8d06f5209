"""Calibration check: detect whether the parameters of a controller belong to another clutch than the one it controls.

Equation        d = mean of sign(slip) H (M - estimate) in slip control. H is the lag of the controller's slip observer
                  (rt_controller/law/lag.py), which also delays its accelerations
                one clutch: H M = H M_m - J alpha as the controller observes it
                two clutches: H M = H M_m - J alpha, alpha = (i_a s_b' - i_b s_a')/(i_a - i_b) from both observed slips
                another clutch: |d| > max(0.1 mean |M|, 0.5 Nm). The shipped calibration had up to 0.050 on the plants of
                  Table 6.6, which are its own clutch with small differences
                inaccurate: |d| > max(0.02 mean |M|, 0.1 Nm), on a rig with one clutch. A controller that knows its rig had at
                  most 0.0005 on 50 rigs drawn within 30 %; the shipped one has 0.014 on the nominal rig, because it does not
                  model the springs
Assumptions     the motor's torque is measured well; with two clutches, the controller knows inertia and ratios, and its slip
                  observers have the same bandwidth
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi

import numpy as np

from clutch_hil.bench.judgement.measures import is_in_phase
from protocols.can.two_clutches import CLUTCHES, CONTROLLERS
from protocols.errors import join_names
from rt_controller.law.valve_gains import Valve, scale_gains
from rt_controller.loop.parameter_sets import load_controller_parameters

_OTHER = (0.1, 0.5)  # of the mean torque of the motor, and Nm: limits for another clutch; see Equation
_OFF = (0.02, 0.1)  # the same: limits for an inaccurate calibration or sensor
# s in slip control: shorter contacts are not judged. A correct calibration was up to 0.044 Nm off in 0.17 to 0.23 s at 10 Nm
_LEAST_TIME = 0.2
_FORGOTTEN = 25.0  # time constants after which less than 1e-8 of an impulse response is left
# Parameters of the controller
_BANDWIDTH, _INERTIA, _ZERO = "slip.bandwidth", "model.motor_inertia", "model.motor_torque_zero"
_OR = "or the clutch has changed; see clutch-hil identify"
CONTACT, _VALVE = "model.contact_pressure", "pressure.valve_gain"  # expected contact pressure [bar]; bar/V
EXPECTED = (CONTACT, "phases.fill_pressure", _VALVE)  # parameters by which a controller finds the contact of the plates
# With a valve slower than the controller's the pressure overshoots at the end of a fill, and the regulator winds up
SLOW_VALVE = ("pressure.valve_frequency", "pressure.valve_damping", "pressure.valve_delay")
_INTEGRAL, _PRESSURE_FAULTS = "pressure.integral_gain", ("overpressure", "pressure lost", "fill timeout")
# A large piston in thick oil takes longer to arrive than the pressure takes to rise; the torque is estimated from the pressure
LATE_PISTON = ("phases.touch_band", "phases.touch_time", "phases.mismatch_dwell")
_FELT_SHARE, _AFTER_FILL = 0.1, 2.0  # -, s: chosen; the slowest fill that is allowed by default takes 1.5 s
_FROZEN_FAULTS = ("pressure lost", "sensor frozen")
_FROZEN_CHANGE, _FROZEN_VOLTAGE = "phases.frozen_change", "guard.frozen_voltage"
# Of the gain that suits the valve; chosen: below it the shipped gains suit a valve, too (valve_gains.py)
_TOO_HIGH = 1.25


@dataclass(frozen=True)
class _Gap:
    """Mean torque [Nm] from the source `what`, and its difference from the estimate, `off` [Nm]."""

    what: str
    off: float
    mean: float

    def exceeds(self, limit: tuple[float, float]) -> bool:
        """Return whether the difference exceeds both a share of the mean and a torque [Nm]."""
        return abs(self.off) > max(limit[0] * self.mean, limit[1])

    def __str__(self) -> str:
        return f"{self.what} gave {self.mean:.1f} Nm on average, {abs(self.off):.2g} Nm {'more' if self.off > 0.0 else 'less'}"


def describe_mismatch(columns: Mapping[str, np.ndarray], parameters: Mapping[str, float]) -> str | None:
    """Return a sentence where motor and estimate differ as with another clutch; None otherwise, or where this is unknown.

    `columns` of a run, each (samples,); `parameters` of its controller, in their units.
    """
    if _BANDWIDTH not in parameters:
        return None
    given = columns["controller_observed_torque_nm"]
    estimate = _lag(columns["controller_torque_estimate_nm"], parameters[_BANDWIDTH], _find_step(columns))
    sliding = is_in_phase(columns, "slip control")
    gap = _compare("motor and inertia", given, estimate, columns["slip_speed_rad_s"], sliding, _find_step(columns))
    if gap is None or not gap.exceeds(_OFF):
        return None
    if gap.exceeds(_OTHER):
        return f"{gap} than the controller estimated: its calibration belongs to another clutch, {_OR}"
    share = 100.0 * abs(gap.off) / gap.mean
    return (
        f"{gap} than the controller estimated, {share:.1f} %: its calibration or the torque sensor is off;"
        " see clutch-hil identify"
    )


def describe_failed_fill(fault: float | str, parameters: Mapping[str, float]) -> str | None:
    """Return advice on a fill that timed out, the `fault` of a run; None for another fault, and without these parameters."""
    if fault != "fill timeout" or not parameters.keys() >= {CONTACT, _VALVE}:
        return None
    return (
        f"the controller expects contact at {parameters[CONTACT]:g} bar and {parameters[_VALVE]:g} bar/V of the valve; for"
        f" another clutch give its {', '.join(EXPECTED)} by --controller-parameters or --calibration; see clutch-hil"
        " identify"
    )


def describe_slow_valve(
    fault: float | str,
    parameters: Mapping[str, float],
    plant: Mapping[str, float],
    clutch: str = "",
    poor: bool = False,
) -> str | None:
    """Return advice on a fault of the pressure on a simulated rig whose valve is slower than the gains allow; None otherwise.

    poor: advise also without a fault, as the torque followed poorly. parameters: of the controller; plant: of the rig, both
    in their units, `plant` with the prefix `clutch` of one of two.
    """
    frequency, damping = (plant.get(f"{clutch}valve.{name}") for name in ("frequency", "damping"))
    if not (fault in _PRESSURE_FAULTS or poor) or _INTEGRAL not in parameters or frequency is None or damping is None:
        return None
    shipped = load_controller_parameters()
    designed = Valve.of(shipped)
    valve = Valve(frequency, damping, 1e-3 * plant.get(f"{clutch}valve_delay.delay", 0.0), designed.line)
    needed = scale_gains(valve, designed).get(_INTEGRAL, 1.0) * shipped[_INTEGRAL].value
    if parameters[_INTEGRAL] <= _TOO_HIGH * needed:
        return None
    return (
        f"the gains of the pressure loop are those of another valve than the rig's, which has {frequency:.3g} rad/s"
        f" ({frequency / (2.0 * pi):.3g} Hz) and a damping of {damping:g}; give {join_names(SLOW_VALVE)} by"
        " --controller-parameters, or a --calibration"
    )


def describe_late_piston(fault: float | str, columns: Mapping[str, np.ndarray]) -> str | None:
    """Return advice on a torque that the motor does not feel soon after a fill, as the piston still moves; None otherwise.

    fault: of a run with these `columns`, each (samples,).
    """
    faulty = np.flatnonzero(columns["controller_fault"] > 0.0)
    if fault != "torque implausible" or not len(faulty) or not (last := int(faulty[0]) - 1) > 0:
        return None
    filling = np.flatnonzero(is_in_phase(columns, "fill")[:last])
    names = ("observed_torque_nm", "torque_estimate_nm")
    felt, estimate = (abs(float(columns[f"controller_{name}"][last])) for name in names)
    since = float(columns["time_s"][last] - columns["time_s"][filling[-1]]) if len(filling) else np.inf
    if not (felt < _FELT_SHARE * estimate and since < _AFTER_FILL):
        return None
    return (
        f"the motor felt {felt:.2g} Nm where the controller estimated {estimate:.3g} Nm, {since:.2g} s after the fill: the"
        f" piston has not reached the plates yet, or they touch at a higher pressure; raise {join_names(LATE_PISTON)}, or"
        f" {CONTACT}"
    )


def describe_coarse_pressure(
    fault: float | str, columns: Mapping[str, np.ndarray], parameters: Mapping[str, float]
) -> str | None:
    """Return advice on a pressure signal that seems frozen because its steps are as large as the limits of the check.

    fault: of a run with these `columns`, each (samples,); None for another fault, and for a signal with finer steps.
    parameters: of the controller and its guard.
    """
    if fault not in _FROZEN_FAULTS or not parameters.keys() >= {_FROZEN_CHANGE, _FROZEN_VOLTAGE, _VALVE}:
        return None
    levels = np.unique(columns["cylinder_pressure_bar"])
    step = float(np.min(np.diff(levels))) if len(levels) > 1 else 0.0
    least = min(parameters[_FROZEN_CHANGE], parameters[_FROZEN_VOLTAGE] * parameters[_VALVE])
    if step < least:
        return None
    return (
        f"the pressure signal has steps of {step:.3g} bar, and is taken for a frozen one if it does not move by one of them"
        f" when {least:.3g} bar more or less are asked for: use a sensor or a converter with finer steps, or raise"
        f" {_FROZEN_CHANGE} above {step:.3g} bar, and {_FROZEN_VOLTAGE} in limits.toml above"
        f" {step / parameters[_VALVE]:.3g} V"
    )


def describe_shift_mismatch(columns: Mapping[str, np.ndarray], parameters: Mapping[str, float]) -> str | None:
    """Return the sentence of `describe_mismatch` for a rig with two clutches, each judged while it alone is in slip control.

    `parameters` are those of clutch a's controller, which commands the motor.
    """
    ratios = [f"driveline.ratio_{clutch}" for clutch in CLUTCHES]
    if not parameters.keys() >= {_BANDWIDTH, _INERTIA, *ratios}:
        return None
    bandwidth, step = parameters[_BANDWIDTH], _find_step(columns)
    ratio_a, ratio_b = (parameters[name] for name in ratios)
    slip_a, slip_b = (columns[f"{name}_slip_acceleration_rad_s2"] for name in CONTROLLERS)
    acceleration = (ratio_a * slip_b - ratio_b * slip_a) / (ratio_a - ratio_b)
    motor = columns["motor_torque_nm"] - parameters.get(_ZERO, 0.0)  # a run of an older controller has no zero
    given = _lag(motor, bandwidth, step) - parameters[_INERTIA] * acceleration
    sliding = [is_in_phase(columns, "slip control", name) for name in CONTROLLERS]
    for clutch, name, own, other in zip(CLUTCHES, CONTROLLERS, sliding, reversed(sliding), strict=True):
        estimate = _lag(columns[f"{name}_torque_estimate_nm"], bandwidth, step)
        slip = columns[f"slip_speed_{clutch}_rad_s"]
        gap = _compare("motor and inertia", given, estimate, slip, own & ~other, step)
        if gap is not None and gap.exceeds(_OTHER):
            return (
                f"on clutch {clutch} alone {gap} than its controller estimated: its calibration belongs to another clutch,"
                f" {_OR}"
            )
    return None


def _find_step(columns: Mapping[str, np.ndarray]) -> float:
    """Return the sample period [s]; not-a-number for a single sample."""
    time = columns["time_s"]
    return float(time[1] - time[0]) if len(time) > 1 else float("nan")


def _lag(signal: np.ndarray, bandwidth: float, step: float) -> np.ndarray:
    """Return a signal (n,) after the lag of a slip observer of this `bandwidth` [1/s]; NaN samples count as 0.

    The impulse response of ((1 - q)/(1 - q z^-1))^3 is (1 - q)^3 (k + 1)(k + 2)/2 q^k; the observer is centred on the previous
    sample.
    """
    if len(signal) < 2:
        return signal
    k, q = np.arange(np.ceil(_FORGOTTEN / (bandwidth * step))), np.exp(-bandwidth * step)
    response = 0.5 * (1.0 - q) ** 3 * (k + 1.0) * (k + 2.0) * q**k
    return np.convolve(np.nan_to_num(signal), np.append(0.0, response))[: len(signal)]


def _compare(
    what: str, given: np.ndarray, estimate: np.ndarray, slip: np.ndarray, sliding: np.ndarray, step: float
) -> _Gap | None:
    """Compare the torque `given` by source `what` with the estimate where the clutch slips; None where it hardly does."""
    if not np.count_nonzero(sliding) * step >= _LEAST_TIME:
        return None
    torque = given[sliding]
    off = float(np.mean(np.sign(slip[sliding]) * (torque - estimate[sliding])))
    return _Gap(what, off, float(np.mean(np.abs(torque))))
