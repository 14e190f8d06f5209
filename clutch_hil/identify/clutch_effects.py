"""Clutch effects: effects of the catalogue that are fitted together with the parameters of a clutch, and their first estimates.

Equation        vented: valve voltage 0 for 0.4 s, or since the run began at rest. There
                  p_shown = o_p,  M_shown = o_M + d omega,  M_m,shown - M_shown = o_m - o_M
                where the motor holds its speed: omega_shown - omega_d = o_omega - o_d
                delay and drag: from the fit, which starts at a usual value
                an effect is absent if its strength is less than 1.5 half widths of its 95 % interval away from off. The
                  least significant one is removed first, and the others are tested again, because offsets of two speeds mask
                  each other. An effect with an interval too wide for the test stays in the fit
Assumptions     all other effects are off; `clutch-hil discrepancy` searches for them
References      docs/effects.md
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d

from clutch_hil.fitting.model import Columns, Values
from clutch_hil.identify.stepwise import MEAN, Samples, estimate_contact, take_samples
from plant_sim.effects.catalogue import load_effects as catalogue
from protocols.files.parameters import Parameter

PRESSURE, TORQUE, MOTOR = (
    "pressure_sensor_offset.offset", "torque_sensor_offset.offset", "motor_torque_sensor_offset.offset",
)  # fmt: skip
SPEED, DRIVE, DELAY, DRAG = (
    "speed_sensor_offset.offset", "drive_speed_offset.offset", "valve_delay.delay", "drag_torque.drag",
)  # fmt: skip
# Unit of moves of each effect in the fit, in its unit: about a tenth of a usual strength
EFFECTS: Mapping[str, float] = {
    PRESSURE: 0.005,
    TORQUE: 0.1,
    MOTOR: 0.1,
    SPEED: 0.03,
    DRIVE: 0.03,
    DELAY: 0.3,
    DRAG: 2e-3,
}
SENSORS = (PRESSURE, TORQUE, MOTOR, SPEED)  # offsets of sensors
HYDRAULIC_EFFECTS = (PRESSURE, DELAY)  # effects on the measured pressure
_BEGIN: Mapping[str, float] = {DELAY: 1.0, DRAG: 1e-3}  # ms, Nm s/rad: a start inside their bounds
_VENTED = 0.4  # s after the voltage is 0: the springs have then pressed the oil out
EMPTY = 0.3  # bar: a cylinder with less is empty, whatever the zero of its sensor is
_NO_VOLTAGE = 0.01  # V: a lower voltage counts as none; a hundredth of the voltage that moves a piston
_LEAST_VENTED = 0.2  # s, least duration of vented rows: at 1 kHz the mean of a torque is then known to 4 mNm
_LEAST_SPAN = 3.0  # rad/s, least span of slip of the open clutch that separates drag from an offset
_LEAST_RATE = 2.0  # bar/s: a delay of 1 ms is then 2 mbar, which a hundred samples resolve
# rad/s and -: friction at such low slips, beside higher ones, determines the speed sensor's zero
_LOW_SLIP, _SLIP_RATIO = 3.0, 4.0
_CALM_SPEED = 2.0  # rad/s^2: below it the motor holds its speed
_LAW_ERROR = 0.12  # relative error of the drag law, as for an effect (fitting/intervals.py)
_PRESENT = 1.5  # half widths, three standard deviations: of seven absent effects, one rig in fifty then shows one
_TELLING = 2.0  # units of moves, a fifth of a usual strength: with a wider interval an effect cannot be called absent


def declare_effects() -> dict[str, Parameter]:
    """Return the parameters of the fitted effects by dotted name, at their off values: fitted strengths and held shapes."""
    names = dict.fromkeys(name.partition(".")[0] for name in EFFECTS)
    return {n: p for effect in names for n, p in catalogue()[effect].declare_parameters().items()}


def find_vented(run: Columns) -> np.ndarray:
    """Return a mask (n,) of the rows in which the cylinder is vented."""
    period = float(run["time_s"][1] - run["time_s"][0])
    window = max(1, round(_VENTED / period))
    first = run["cylinder_pressure_bar"][: max(1, round(MEAN / period))]
    before = np.inf if np.median(first) > EMPTY else 0.0  # the valve was open before a run that was cut out
    voltage = maximum_filter1d(run["valve_voltage_v"], window, mode="constant", cval=before, origin=(window - 1) // 2)
    return np.asarray(voltage <= _NO_VOLTAGE)


@dataclass(frozen=True)
class Vented:
    """Vented rows of all runs: slip [rad/s], pressure [bar], torque and motor torque [Nm], (n,) each, and their duration
    [s]."""

    slip: np.ndarray
    pressure: np.ndarray
    torque: np.ndarray
    motor: np.ndarray
    seconds: float

    @classmethod
    def of(cls, runs: Sequence[Columns]) -> "Vented":
        """Collect the vented rows of `runs`."""
        at = [find_vented(run) for run in runs]
        names = ("slip_speed_rad_s", "cylinder_pressure_bar", "clutch_torque_nm", "motor_torque_nm")
        columns = [np.concatenate([run[name][rows] for run, rows in zip(runs, at, strict=True)]) for name in names]
        seconds = sum(
            np.count_nonzero(rows) * float(run["time_s"][1] - run["time_s"][0])
            for run, rows in zip(runs, at, strict=True)
        )
        return cls(columns[0], columns[1], columns[2], columns[3], seconds)

    @property
    def span(self) -> float:
        """Span of the slip between its 5 % and 95 % quantiles [rad/s]."""
        return float(np.quantile(self.slip, 0.95) - np.quantile(self.slip, 0.05)) if len(self.slip) else 0.0


def estimate_effects(runs: Sequence[Columns]) -> tuple[dict[str, float], dict[str, str]]:
    """Return initial strengths by dotted name, and a sentence for each effect that the runs do not excite."""
    vented = Vented.of(runs)
    samples = take_samples(runs)
    values = {**{name: p.value for name, p in declare_effects().items()}, **_BEGIN}
    if vented.seconds >= _LEAST_VENTED:
        terms = np.ones((len(vented.slip), 1))
        if vented.span >= _LEAST_SPAN:
            terms = np.column_stack([terms, vented.slip])
        (values[TORQUE], *drag), *_ = np.linalg.lstsq(terms, vented.torque, rcond=None)
        values[DRAG] = float(np.clip(drag[0], *_list_bounds(DRAG))) if drag else _BEGIN[DRAG]
        values[PRESSURE] = float(np.mean(vented.pressure))
        values[MOTOR] = values[TORQUE] + float(np.median(vented.motor - vented.torque))
    if np.any(held := _holds_speed(samples)):
        values[DRIVE] = float(np.median(samples.error[held]))
    unmet = {name: text for name, need in _NEEDS.items() if (text := need(vented, samples))}
    off = declare_effects()
    values |= {name: off[name].value for name in unmet}
    return {n: float(np.clip(v, *off[n].bounds)) for n, v in values.items()}, unmet


def correct_offsets(runs: Sequence[Columns], effects: Values) -> list[Columns]:
    """Return the runs with the offsets in `effects` subtracted, for functions that model no effects."""
    changes = {
        "cylinder_pressure_bar": PRESSURE, "clutch_torque_nm": TORQUE, "motor_torque_nm": MOTOR, "slip_speed_rad_s": SPEED,
        "motor_speed_demand_rad_s": DRIVE,
    }  # fmt: skip
    return [{**run, **{column: run[column] - effects[name] for column, name in changes.items()}} for run in runs]


def estimate_line(runs: Sequence[Columns]) -> tuple[float, float] | None:
    """Return slope [Nm/bar] and contact pressure [bar] by `estimate_contact`, without a known clutch; None if there is no line.

    The torque sensor's zero, measured with the open clutch, is subtracted: otherwise an open clutch would seem to transmit
    torque. The pressure sensor's zero is not, because a pressure regulator uses the same sensor.
    """
    zero = estimate_effects(runs)[0][TORQUE]
    return estimate_contact(take_samples([{**run, "clutch_torque_nm": run["clutch_torque_nm"] - zero} for run in runs]))


def choose_absent(names: Sequence[str], values: np.ndarray, half: np.ndarray, correlation: np.ndarray) -> list[str]:
    """Return the effects among `names` (p,) that are absent, see Equation.

    values, half (p,), correlation (p, p): results of the fit.
    """
    left = [k for k, name in enumerate(names) if name in EFFECTS and half[k] <= _TELLING * EFFECTS[name]]
    off = {name: p.value for name, p in declare_effects().items()}
    away = np.array([values[k] - off[names[k]] for k in left])
    spread = (correlation * np.outer(half, half))[np.ix_(left, left)]
    absent: list[str] = []
    while left:
        ratio = np.abs(away) / np.sqrt(np.maximum(np.diag(spread), 1e-300))
        least = int(np.argmin(ratio))
        if ratio[least] >= _PRESENT:
            break
        absent.append(names[left.pop(least)])
        # values and covariance of the others, given that this one is off: conditional normal distribution
        share = spread[:, least] / spread[least, least]
        away, spread = away - share * away[least], spread - np.outer(share, spread[least])
        away, spread = np.delete(away, least), np.delete(np.delete(spread, least, 0), least, 1)
    return absent


def widen_interval(name: str, half: float, values: Values) -> float:
    """Return the half width of a parameter's 95 % interval; for drag with the error of its law added, because rigs differ in
    it."""
    return float(np.hypot(half, _LAW_ERROR * values[name])) if name == DRAG else half


def _holds_speed(samples: Samples) -> np.ndarray:
    return samples.calm & (np.abs(samples.slip_rate) < _CALM_SPEED)


def _list_bounds(name: str) -> tuple[float, float]:
    return declare_effects()[name].bounds


def _make_vented_check(what: str) -> Callable[[Vented, Samples], str]:
    def need(vented: Vented, samples: Samples) -> str:
        return "" if vented.seconds >= _LEAST_VENTED else (
            f"{what} needs rows without valve voltage; these runs have {vented.seconds:.2g} s, {_LEAST_VENTED:g} s is needed"
        )  # fmt: skip

    return need


def _check_drag(vented: Vented, samples: Samples) -> str:
    return _make_vented_check("the drag of the open clutch")(vented, samples) or (
        "" if vented.span >= _LEAST_SPAN else
        f"the drag of the open clutch needs slips that differ; these runs span {vented.span:.2g} rad/s,"
        f" {_LEAST_SPAN:g} rad/s is needed"
    )  # fmt: skip


def _check_speed(vented: Vented, samples: Samples) -> str:
    slips = np.abs(samples.slip[samples.sliding])
    low, high = (float(np.quantile(slips, share)) for share in (0.02, 0.98)) if len(slips) else (np.inf, 0.0)
    return "" if low <= _LOW_SLIP and high >= _SLIP_RATIO * low else (
        f"the zero of the speed sensor needs slips below {_LOW_SLIP:g} rad/s and also higher ones in contact; the lowest of"
        f" these runs is {low:.3g}"
    )  # fmt: skip


def _check_drive(vented: Vented, samples: Samples) -> str:
    if np.any(_holds_speed(samples)):
        return ""
    return "the zero of the drive's speed needs a speed that is held; these runs hold none"


def _delay_need(vented: Vented, samples: Samples) -> str:
    rate = float(np.quantile(np.abs(samples.pressure_rate), 0.99)) if len(samples.pressure_rate) else 0.0
    return "" if rate >= _LEAST_RATE else (
        f"the valve's delay needs a pressure that changes fast; these runs reach {rate:.2g} bar/s,"
        f" {_LEAST_RATE:g} bar/s is needed"
    )  # fmt: skip


_NEEDS: Mapping[str, Callable[[Vented, Samples], str]] = {
    PRESSURE: _make_vented_check("the zero of the pressure sensor"),
    TORQUE: _make_vented_check("the zero of the torque sensor"),
    MOTOR: _make_vented_check("the zero of the motor's torque"),
    DRAG: _check_drag, SPEED: _check_speed, DRIVE: _check_drive, DELAY: _delay_need,
}  # fmt: skip
