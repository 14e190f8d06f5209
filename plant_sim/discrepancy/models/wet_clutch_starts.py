"""Where to begin the fit of effects that are not smooth in their parameters, read from a run and its residuals."""

from collections.abc import Callable, Mapping

import numpy as np

from plant_sim.discrepancy.model import Candidate, Columns
from protocols.parameters import ParameterSet

_ORDERS = np.arange(0.5, 60.01, 0.05)  # periods a turn that are looked for
_TURNING = 1.0  # rad/s: a slower shaft shows no order
_FREQUENT = 400.0  # Hz: what a run at 1 kHz can show
_BEST = 1  # orders to begin from
_SATURATED = 0.999  # quantile of a channel that stands for its end
_LEVELS = 4000  # most different values of a channel that is coarse

Start = dict[str, float]
Starts = Callable[[Candidate, Columns, Columns, ParameterSet], list[Start]]


def _ripple(column: str, relative: str | None) -> Starts:
    """Orders of the residual of `column` over the shaft's angle, in shares of the column `relative` where it is given."""

    def starts(candidate: Candidate, run: Columns, residuals: Columns, parameters: ParameterSet) -> list[Start]:
        angle, speed, residual = run["shaft_angle_rad"], run["slip_speed_rad_s"], residuals[column]
        turning = np.abs(speed) > _TURNING
        base = run[relative] if relative else np.ones_like(residual)
        turning &= np.abs(base) > 0.1 * np.max(np.abs(base))
        if np.count_nonzero(turning) < 1000:
            return []
        angle, residual, base, speed = (v[turning][::2] for v in (angle, residual, base, speed))
        fastest = float(np.quantile(np.abs(speed), 0.9))
        # the slow part of a residual has all low orders: take it away
        residual = residual - np.convolve(residual, np.ones(201) / 201, mode="same")
        orders = _ORDERS[_ORDERS * fastest / (2.0 * np.pi) < _FREQUENT]
        # one complex product a sample and order in place of an exponential
        wave, step = residual * base * np.exp(-1j * orders[0] * angle), np.exp(-1j * (orders[1] - orders[0]) * angle)
        amplitudes = np.empty(len(orders), complex)
        for i in range(len(orders)):
            amplitudes[i] = wave.sum()
            wave *= step
        amplitudes *= 2.0 / np.sum(base * base)
        found = []
        power = np.abs(amplitudes)
        for _ in range(_BEST):
            best = int(np.argmax(power))
            found.append(
                {
                    f"{candidate.name}.amplitude": float(np.abs(amplitudes[best])),
                    f"{candidate.name}.order": float(orders[best]),
                    f"{candidate.name}.phase": float(np.angle(amplitudes[best])),
                }
            )
            power[np.abs(orders - orders[best]) < 1.0] = 0.0
        bounds = {f"{candidate.name}.{p.name}": p.bounds for p in candidate.parameters}
        return [{n: float(np.clip(v, *bounds[n])) for n, v in start.items()} for start in found]

    return starts


def _saturation(candidate: Candidate, run: Columns, residuals: Columns, parameters: ParameterSet) -> list[Start]:
    """The ends of both channels, one at a time."""
    volts = {
        "pressure_limit": run["cylinder_pressure_bar"] * parameters["sensors.pressure_sensitivity"].value,
        "torque_limit": run["clutch_torque_nm"] * parameters["sensors.clutch_torque_sensitivity"].value,
    }
    off = candidate.off()
    return [
        off | {f"{candidate.name}.{name}": float(np.quantile(np.abs(volt), _SATURATED))} for name, volt in volts.items()
    ]


def _quantisation(candidate: Candidate, run: Columns, residuals: Columns, parameters: ParameterSet) -> list[Start]:
    """Bits lost by the spacing of the values that a channel takes."""
    full = 2.0 * parameters["sensors.input_range"].value
    found = candidate.off()
    for name, column, group in (
        ("pressure_bits_lost", "cylinder_pressure_bar", "pressure"),
        ("torque_bits_lost", "clutch_torque_nm", "clutch_torque"),
    ):
        step = spacing(run[column] * parameters[f"sensors.{group}_sensitivity"].value)
        lost = np.log2(step * 2.0 ** parameters[f"sensors.{group}_bits"].value / full) if step > 0.0 else 0.0
        strength = next(p for p in candidate.strengths if p.name == name)
        if lost > 0.5:
            found[f"{candidate.name}.{name}"] = float(np.clip(lost, *strength.bounds))
    return [found] if found != candidate.off() else []


def spacing(values: np.ndarray) -> float:
    """Step of the lattice that all `values` lie on; 0 where they take too many different ones to tell."""
    levels = np.unique(np.round(values, 9))
    if len(levels) < 3 or len(levels) > _LEVELS:
        return 0.0
    gaps = np.diff(levels)
    step = float(np.median(gaps[gaps < 1.5 * np.quantile(gaps, 0.1)]))
    off_lattice = np.abs(values / step - np.round(values / step))
    return step if np.quantile(off_lattice, 0.99) < 0.1 else 0.0


STARTS: Mapping[str, Starts] = {
    "shaft_angle_ripple": _ripple("clutch_torque_nm", "clutch_torque_nm"),
    "position_ripple": _ripple("clutch_torque_nm", None),
    "motor_torque_ripple": _ripple("motor_torque_nm", "motor_torque_nm"),
    "sensor_saturation": _saturation,
    "coarse_quantisation": _quantisation,
}
