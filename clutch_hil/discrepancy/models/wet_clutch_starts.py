"""Starts of the fit of an effect on the wet-clutch rig, read from a run and its residuals as the effect's `start` specifies."""

from collections.abc import Collection

import numpy as np

from clutch_hil.fitting.model import Candidate, Columns
from plant_sim.effects.effect import Effect
from plant_sim.effects.start import ChannelEnds, Start, StrongestOrder
from protocols.errors import InputError, suggest_closest
from protocols.files.parameters import ParameterSet

_ORDERS = np.arange(0.5, 60.01, 0.05)  # periods per turn that are tried
_TURNING = 1.0  # rad/s: a slower shaft shows no order
_LOADED = 0.1  # share of the greatest load: below it a ripple proportional to the load is not visible
_ENOUGH = 1000  # samples in which the shaft turns under load
_HIGHEST = 400.0  # Hz: the fastest ripple that a run at 1 kHz can show
_SATURATED = 0.999  # quantile of a channel's magnitude that represents its end: single samples may lie beyond it
_SENSITIVITIES = {  # V per unit of the column, by the column of a converted channel
    "cylinder_pressure_bar": "sensors.pressure_sensitivity",
    "motor_torque_nm": "sensors.motor_torque_sensitivity",
    "clutch_torque_nm": "sensors.clutch_torque_sensitivity",
}
_INSTEAD = {"clutch_torque_nm": "motor_torque_nm"}  # where that sensor is missing: the torque that drives the clutch

Values = dict[str, float]  # of a candidate's parameters, by dotted name, each in its declared unit


def check_start(effect: Effect, outputs: Collection[str]) -> None:
    """Raise InputError if the start of `effect` reads a column that this rig lacks; `outputs`: the measured columns."""
    columns = _SENSITIVITIES if isinstance(effect.start, ChannelEnds) else outputs
    for column in effect.start.columns:
        if column not in columns:
            raise InputError(
                f"effect {effect.name}: its start reads the column {column!r}, which is unknown;"
                f" {suggest_closest(column, columns)}"
            )


def suggest_values(
    start: Start, candidate: Candidate, run: Columns, residuals: Columns, parameters: ParameterSet
) -> list[Values]:
    """Return initial values for the fit of `candidate`; [] for the typical ones.

    run: measured columns (n,); residuals: measured minus predicted (n,), by column, in its unit; parameters: of the baseline.
    """
    match start:
        case StrongestOrder():
            return _find_strongest_order(start, candidate, run, residuals)
        case ChannelEnds():
            return _suggest_channel_ends(start, candidate, run, parameters)
        case _:
            return []


def _find_strongest_order(
    start: StrongestOrder, candidate: Candidate, run: Columns, residuals: Columns
) -> list[Values]:
    """Return the order with the largest amplitude in the residual over the shaft's angle.

    [] for a shaft that hardly turns, and where the sensor is missing.

    Equation        line(k) = 2 sum(b r exp(-i k theta))/sum(b^2),  r the residual, b the reference of a relative ripple, else 1
    """
    column = start.column if start.column in residuals else _INSTEAD.get(start.column, "")
    if column not in residuals:
        return []
    angle, speed, residual = run["shaft_angle_rad"], run["slip_speed_rad_s"], residuals[column]
    base = run[start.share_of] if start.share_of else np.ones_like(residual)
    used = (np.abs(speed) > _TURNING) & (np.abs(base) > _LOADED * np.max(np.abs(base)))
    if np.count_nonzero(used) < _ENOUGH:
        return []
    angle, residual, base, speed = (values[used][::2] for values in (angle, residual, base, speed))
    fastest = float(np.quantile(np.abs(speed), 0.9))
    # the slow part of a residual contains all low orders: remove it
    residual = residual - np.convolve(residual, np.ones(201) / 201, mode="same")
    orders = _ORDERS[_ORDERS * fastest / (2.0 * np.pi) < _HIGHEST]
    # one complex product per sample and order instead of an exponential
    wave, step = residual * base * np.exp(-1j * orders[0] * angle), np.exp(-1j * (orders[1] - orders[0]) * angle)
    lines = np.empty(len(orders), complex)
    for i in range(len(orders)):
        lines[i] = wave.sum()
        wave *= step
    lines *= 2.0 / np.sum(base * base)
    best = int(np.argmax(np.abs(lines)))
    values = {
        "amplitude": float(np.abs(lines[best])),
        "order": float(orders[best]),
        "phase": float(np.angle(lines[best])),
    }
    bounds = {p.name: p.bounds for p in candidate.parameters}
    return [{f"{candidate.name}.{name}": float(np.clip(value, *bounds[name])) for name, value in values.items()}]


def _suggest_channel_ends(
    start: ChannelEnds, candidate: Candidate, run: Columns, parameters: ParameterSet
) -> list[Values]:
    """Return a start for each limit: at the highest voltage of its channel, with the other limits off."""
    off = candidate.list_off_values()
    volts = {name: run[column] * parameters[_SENSITIVITIES[column]].value for name, column in start.limits.items()}
    return [
        off | {f"{candidate.name}.{name}": float(np.quantile(np.abs(volt), _SATURATED))} for name, volt in volts.items()
    ]
