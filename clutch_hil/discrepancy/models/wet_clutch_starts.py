"""Where to begin the fit of effects that are not smooth in their parameters, read from a run and its residuals."""

from collections.abc import Callable, Mapping

import numpy as np

from clutch_hil.discrepancy.model import Candidate, Columns
from protocols.files.parameters import ParameterSet

_ORDERS = np.arange(0.5, 60.01, 0.05)  # periods a turn that are looked for
_TURNING = 1.0  # rad/s: a slower shaft shows no order
_FREQUENT = 400.0  # Hz: what a run at 1 kHz can show
_BEST = 1  # orders to begin from
_SATURATED = 0.999  # quantile of a channel that stands for its end

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


STARTS: Mapping[str, Starts] = {
    "shaft_angle_ripple": _ripple("clutch_torque_nm", "clutch_torque_nm"),
    "position_ripple": _ripple("clutch_torque_nm", None),
    "motor_torque_ripple": _ripple("motor_torque_nm", "motor_torque_nm"),
    "sensor_saturation": _saturation,
}
