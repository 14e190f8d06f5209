"""Sources of the wet clutch: attribute an error to a block by what the channels have in common (sources.py).

Equation        r: measured minus simulated, in means over 4 ms. A missing torque is visible three times:
                x_1 = friction block driven by the measured pressure, minus driven by the simulated one    (pressure sensor)
                x_2 = r of the clutch torque                                                        (torque sensor)
                x_3 = r of the motor torque - J d/dt r of the slip                                  (drive: docs/rig.md, 8)
                a fault of valve or hydraulics is in all three; of piston or friction in x_2, x_3; of a sensor in its own only
                  hydraulics H = (<x_1 x_2> + <x_1 x_3>)/2     friction F = <x_2 x_3> - H
                  torque sensor S = <x_2 x_2'> - <x_2 x_3>
                  pressure sensor P = <x_1 x_1'> - H           drive D = <x_3 x_3'> - <x_2 x_3>, or
                  <d d'>, d = r of M_m + k_p r of omega + k_i integral of it: the motor's own law (docs/rig.md, 8)
                <x_2 x_2'>, <d d'>: minus the power of the noise; <x_1 x_1'>, <x_3 x_3'>: at a lag of 12 ms, of x_1 minus that
                of noise alone
                with one torque sensor alone, x its residual:  H = <x_1 x>, F = <x x'> - H
                a gain difference between x_2 and x_3 within the sensors' data sheets is removed
                temperature: r minus the heating by x_2 times slip (docs/rig.md, 7)
Assumptions     the noises of two sensors are independent; the friction block is nearly linear in the error of the pressure
Not modelled    with one torque sensor, its faults, and those of the drive in x_3, are attributed to the friction
                a fault in one channel of a shared converter is attributed to that sensor here
"""

from collections.abc import Callable

import numpy as np
from scipy.ndimage import minimum_filter1d
from scipy.signal import lfilter

from clutch_hil.discrepancy.sources import (
    ANGLE,
    CELSIUS,
    DRIVE,
    FRICTION,
    HYDRAULICS,
    LATER,
    MOTOR,
    PRESSURE,
    SENSORS,
    SLIP,
    TORQUE,
    average,
    compute_period,
    compute_products,
    compute_step,
    free,
)  # fmt: skip
from clutch_hil.fitting.model import Columns, RunSource, Values
from protocols.files.parameters import ParameterSet

LAG = 3  # means: lag of the auto product of x_1, x_3, whose noise is coloured: a central difference spans 2 means
_WASHOUT = 1.0  # rad/s: slower parts of d come from the motor's integrator, which was held at its limit
# bar, s: near contact and separation the friction block is not linear, and no error is attributed to a sensor
_PRESSED, _AROUND = 0.1, 0.4
_SEED = 6

Friction = Callable[[Columns], Columns]  # the friction block driven by given pressure and slip: outputs (n,) by column


def locate(
    friction: Friction, number: int, run: Columns, shown: Columns, r: Columns, floors: Values, parameters: ParameterSet,
    values: Values,
) -> list[RunSource]:  # fmt: skip
    """Return the sources in the run of this `number`: `shown` is simulated, `r` measured minus simulated, both (n,) by column.

    `friction` simulates the friction block alone, `parameters` are the baseline's with their uncertainties, `values` the
    simulated ones.
    """
    run_sources: list[RunSource] = []

    def add(
        block: str, column: str, residual: np.ndarray, product: Callable[[int], np.ndarray], rest: np.ndarray,
        square: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        tested = np.column_stack([product(lag) + rest for lag in LATER])
        run_sources.append(
            RunSource(block, column, (product(LAG) if square is None else square) + rest, tested, residual)
        )

    torque_of = _compute_friction(friction, run, shown)
    noise = floors[PRESSURE] * np.random.default_rng([_SEED, number]).standard_normal(len(r[PRESSURE]))
    x1, alone = average(torque_of(r[PRESSURE]), run), average(torque_of(noise), run)
    period = compute_period(run)
    nothing = np.zeros_like(x1)
    x2, p = average(r[TORQUE], run) if TORQUE in r else None, average(r[PRESSURE], run)
    x3 = _balance_motor(run, r, shown, values) if MOTOR in r else None
    if x2 is not None and x3 is not None:
        x3 = _make_alike(x2, x3, average(shown[TORQUE], run), _estimate_gain_difference(parameters))
    h = np.mean([x1 * x for x in (x2, x3) if x is not None], axis=0)
    add(HYDRAULICS, TORQUE if x2 is not None else MOTOR, x1, lambda lag: nothing, h)
    # in bar^2, by the block's own gain for noise
    slope = float(np.mean(alone**2)) / max(float(np.mean(average(noise, run) ** 2)), 1e-300)
    # plates that never touch convert no pressure into torque: x_1 then gives no information on the pressure sensor
    gain = 1.0 / slope if slope > 0.0 else 0.0
    well = minimum_filter1d(shown[PRESSURE] > values["piston.contact_pressure"] + _PRESSED, round(_AROUND / period))
    well = gain * average(well.astype(float), run)
    add(SENSORS, PRESSURE, p, lambda lag: (compute_products(x1, lag) - compute_products(alone, lag)) * well, -h * well)
    add(HYDRAULICS, PRESSURE, p, lambda lag: compute_products(p, lag), nothing, free(p, r[PRESSURE], run))
    if x2 is not None and x3 is not None:
        common = x2 * x3
        add(FRICTION, TORQUE, x2, lambda lag: nothing, common - h)
        add(SENSORS, TORQUE, x2, lambda lag: compute_products(x2, lag), -common, free(x2, r[TORQUE], run))
        add(DRIVE, MOTOR, x3, lambda lag: compute_products(x3, lag), -common)
    elif x2 is not None:
        add(FRICTION, TORQUE, x2, lambda lag: compute_products(x2, lag), -h, free(x2, r[TORQUE], run))
    elif x3 is not None:
        add(FRICTION, MOTOR, x3, lambda lag: compute_products(x3, lag), -h)
    if MOTOR in r:
        law = _apply_motor_law(run, r, shown, values)
        d = average(law, run)
        add(DRIVE, MOTOR, d, lambda lag: compute_products(d, lag), nothing, free(d, law, run))
    if CELSIUS in r:
        heat = _compute_heating(r[TORQUE] * np.abs(run[SLIP]), values, period) if TORQUE in r else 0.0
        celsius = average(r[CELSIUS] - heat, run)
        celsius = celsius - celsius.mean()
        add(
            FRICTION,
            CELSIUS,
            celsius,
            lambda lag: compute_products(celsius, lag),
            nothing,
            free(celsius, r[CELSIUS], run),
        )
    return run_sources


def _balance_motor(run: Columns, r: Columns, shown: Columns, values: Values) -> np.ndarray:
    """Return x_3 (means,) [Nm]."""
    turning = values["motor.inertia"] * np.gradient(average(_find_slip_error(run, r, shown), run), compute_step(run))
    return average(r[MOTOR], run) - turning


def _apply_motor_law(run: Columns, r: Columns, shown: Columns, values: Values) -> np.ndarray:
    """Return d (n,) [Nm] without its slow part."""
    period = compute_period(run)
    # the encoder's angle has no noise to be integrated; each simulated slip is the mean over the sample that ends with it
    turned = run[ANGLE] - run[ANGLE][0] - period * (np.cumsum(shown[SLIP]) - shown[SLIP][0])
    gain, rate = (values[f"motor.{n}"] for n in ("proportional_gain", "integral_gain"))
    return _remove_slow_part(r[MOTOR] + gain * _find_slip_error(run, r, shown) + rate * turned, period)


def _find_slip_error(run: Columns, r: Columns, shown: Columns) -> np.ndarray:
    """Return the residual of the slip (n,) [rad/s], aligned in time."""
    period = compute_period(run)
    return _align_in_time(r[SLIP], np.gradient(shown[SLIP], period), period)


def _compute_friction(friction: Friction, run: Columns, shown: Columns) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function from a pressure error [bar] (n,) to the torque error [Nm] (n,) of the friction block."""

    def compute_torque(off: np.ndarray) -> np.ndarray:
        behind = {**run, **shown, PRESSURE: shown[PRESSURE] + off}
        return np.asarray(friction(behind)[TORQUE])

    still = compute_torque(np.zeros_like(shown[PRESSURE]))
    return lambda off: compute_torque(off) - still


def _compute_heating(power: np.ndarray, values: Values, period: float) -> np.ndarray:
    """Return the heating [K] of the oil by missing friction power [W]: docs/rig.md, 7, exact for constant power in a sample."""
    capacity, transfer = values["oil.heat_capacity"], values["oil.heat_transfer"]
    decay = np.exp(-transfer / capacity * period)
    return np.asarray(lfilter([0.0, (1.0 - decay) / transfer], [1.0, -decay], power))


def _remove_slow_part(values: np.ndarray, period: float) -> np.ndarray:
    """Remove the part that is slower than _WASHOUT."""
    pole = np.exp(-_WASHOUT * period)
    return np.asarray(lfilter([1.0, -1.0], [1.0, -pole], values - values[0]))


def _estimate_gain_difference(parameters: ParameterSet) -> float:
    """Return the possible gain difference of the two torque sensors by their data sheets (1 sigma)."""
    sheets = [parameters[f"sensors.{name}_sensitivity"] for name in ("clutch_torque", "motor_torque")]
    return float(np.sqrt(sum((p.uncertainty / p.value) ** 2 for p in sheets)))


def _make_alike(x2: np.ndarray, x3: np.ndarray, torque: np.ndarray, most: float) -> np.ndarray:
    """Return `x3` with its gain difference to `x2` removed, up to a difference of `most`."""
    swing = torque - torque.mean()  # an offset is not a gain
    differ = np.clip((x2 - x3) @ swing / max(float(swing @ swing), 1e-12), -most, most)
    return x3 + differ * torque


def _align_in_time(residual: np.ndarray, slope: np.ndarray, most: float) -> np.ndarray:
    """Correct `residual` of the slip for a simulation delay of 0 to `most` [s]; `slope` is that of the simulated slip.

    The speed from an encoder is half a sample old.
    """
    late = np.clip(-(residual @ slope) / max(float(slope @ slope), 1e-12), 0.0, most)
    return residual + late * slope
