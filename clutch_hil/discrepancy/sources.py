"""Sources: the power of each block's fault, from what channels have in common: noise of two sensors has nothing in common.

Wet clutch      r: measured less simulated, in means over 4 ms. The torque that is missing is seen three times:
                x_1 = friction block behind the measured pressure, less behind the simulated one    (pressure sensor)
                x_2 = r of the clutch torque                                                        (torque sensor)
                x_3 = r of the motor torque - J d/dt r of the slip                                  (drive: rig.md 8)
                a fault of valve, hydraulics stands in all three; of piston, friction in x_2, x_3; of a sensor in its own alone
                  hydraulics H = (<x_1 x_2> + <x_1 x_3>)/2     friction F = <x_2 x_3> - H
                  torque sensor S = <x_2 x_2'> - <x_2 x_3>
                  pressure sensor P = <x_1 x_1'> - H           drive D = <x_3 x_3'> - <x_2 x_3>, or
                  <d d'>, d = r of M_m + k_p r of omega + k_i integral of it: the motor's own law (rig.md 8)
                <x_2 x_2'>, <d d'>: less the noise's own; <x_1 x_1'>, <x_3 x_3'>: 12 ms later, of x_1 less that of noise alone
                x_2, x_3 differ by no gain that the sensors' data sheets allow
                temperature: r less what x_2 times slip heats (rig.md 7)
Other models    every output is its own source: <r r>, less the noise's own
Assumptions     noises of two sensors independent; friction block nearly linear in what the pressure is off by
Not modelled    a fault that is in one channel of a shared converter is a fault of that sensor here
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import minimum_filter1d
from scipy.signal import lfilter

from clutch_hil.discrepancy.model import Columns, Model, Values
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.discrepancy.noise import estimate_noise

MEAN = 4e-3  # s: samples are looked at in means over this time, as the fit does (evidence.py)
LAG = 3  # means: of the auto product of x_1, x_3, whose noise is coloured: a central difference reaches 2 means far
LATER = 4, 5, 6  # means: of an auto product that is tested; 16 to 24 ms, so that coloured noise of 10 ms is not in it
SENSORS, DRIVE, FRICTION, HYDRAULICS = "sensors", "drive", "friction", "hydraulics"
_WASHOUT = 1.0  # rad/s: what is slower in d is the motor's integrator that was held at its limit
_PRESSED, _AROUND = (
    0.1,
    0.4,
)  # bar, s: about touch and parting the friction block is not linear, and no sensor is accused
_SEED = 6
PRESSURE, SLIP, TORQUE = "cylinder_pressure_bar", "slip_speed_rad_s", "clutch_torque_nm"
MOTOR, CELSIUS, ANGLE = "motor_torque_nm", "oil_temperature_degc", "shaft_angle_rad"


@dataclass(frozen=True)
class Source:
    """What a block may be blamed for in an output, a list of runs each, at MEAN, in the output's unit (squared).

    `power` (n,): its mean is the mean square. `tested` (n, k): the same, later, of mean 0 where the block is right.
    `residual` (n,): in which it shows.
    """

    block: str
    column: str
    power: list[np.ndarray]
    tested: list[np.ndarray]
    residual: list[np.ndarray]


def sources(model: Model, runs: Sequence[Columns], floors: Values, parameters: Values, effects: Values) -> list[Source]:
    """The sources of `model`'s disagreement with `runs`."""
    with ThreadPoolExecutor() as pool:
        predicted = list(pool.map(lambda run: model.simulate(run, parameters, effects), runs))
        off = [_off(model, floors, run, shown) for run, shown in zip(runs, predicted, strict=True)]
        if isinstance(model, WetClutch):
            parts = list(pool.map(
                lambda k: _clutch(model, floors, parameters, effects, (runs[k], predicted[k], off[k], k)), range(len(runs))
            ))  # fmt: skip
            kinds = [(block, column) for block, column, *_ in parts[0]]
            return [
                Source(block, column, *(list(series) for series in zip(*(part[k][2:] for part in parts), strict=True)))
                for k, (block, column) in enumerate(kinds)
            ]
    found = []
    for output in model.outputs:
        residuals = [means(r[output.column], run) for r, run in zip(off, runs, strict=True)]
        found.append(
            Source(
                output.block, output.column,
                [_free(r, o[output.column], run) for r, o, run in zip(residuals, off, runs, strict=True)],
                [np.column_stack([_auto(r, lag) for lag in LATER]) for r in residuals], residuals,
            )
        )  # fmt: skip
    return found


def _clutch(
    model: WetClutch, floors: Values, parameters: Values, effects: Values, job: tuple[Columns, Columns, Columns, int]
) -> list[tuple[str, str, np.ndarray, np.ndarray, np.ndarray]]:
    """Sources in one run of the wet clutch: block, output, power, tested, residual."""
    run, shown, r, k = job
    torque_of = _friction(model, run, shown, parameters, effects)
    noise = floors[PRESSURE] * np.random.default_rng([_SEED, k]).standard_normal(len(r[PRESSURE]))
    x1, alone = means(torque_of(r[PRESSURE]), run), means(torque_of(noise), run)
    period = _period(run)
    slip = _shift_in_time(r[SLIP], np.gradient(shown[SLIP], period), period)
    inertia, gain, rate = (parameters[f"motor.{n}"] for n in ("inertia", "proportional_gain", "integral_gain"))
    # the encoder's angle has no noise to be integrated; half a sample: predictions are of the sample's instant
    turned = run[ANGLE] - run[ANGLE][0] - period * (np.cumsum(shown[SLIP]) - 0.5 * (shown[SLIP] + shown[SLIP][0]))
    law = r[MOTOR] + gain * slip + rate * turned
    law = _remove_slow(law, period)
    x2, p, d = means(r[TORQUE], run), means(r[PRESSURE], run), means(law, run)
    turning = inertia * np.gradient(means(slip, run), MEAN)
    x3 = means(r[MOTOR], run) - turning
    x3 = _match_gain(x2, x3, means(shown[TORQUE], run), _gains(model))
    heat = _warm_oil(r[TORQUE] * np.abs(run[SLIP]), parameters, period)
    celsius = means(r[CELSIUS] - heat, run)
    celsius = celsius - celsius.mean()
    common = x2 * x3
    h = 0.5 * (x1 * x2 + x1 * x3)
    found = []

    def add(
        block: str, column: str, residual: np.ndarray, auto: Callable[[int], np.ndarray], rest: np.ndarray,
        square: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        tested = np.column_stack([auto(lag) + rest for lag in LATER])
        found.append((block, column, (auto(LAG) if square is None else square) + rest, tested, residual))

    nothing = np.zeros_like(x2)
    add(HYDRAULICS, TORQUE, x1, lambda lag: nothing, h)
    # in bar^2, by the block's own gain for noise
    slope = float(np.mean(alone**2)) / max(float(np.mean(means(noise, run) ** 2)), 1e-300)
    well = minimum_filter1d(shown[PRESSURE] > parameters["piston.contact_pressure"] + _PRESSED, round(_AROUND / period))
    well = means(well.astype(float), run) / slope
    add(SENSORS, PRESSURE, p, lambda lag: (_auto(x1, lag) - _auto(alone, lag)) * well, -h * well)
    add(HYDRAULICS, PRESSURE, p, lambda lag: _auto(p, lag), nothing, _free(p, r[PRESSURE], run))
    add(FRICTION, TORQUE, x2, lambda lag: nothing, common - h)
    add(SENSORS, TORQUE, x2, lambda lag: _auto(x2, lag), -common, _free(x2, r[TORQUE], run))
    add(DRIVE, MOTOR, x3, lambda lag: _auto(x3, lag), -common)
    add(DRIVE, MOTOR, d, lambda lag: _auto(d, lag), nothing, _free(d, law, run))
    add(FRICTION, CELSIUS, celsius, lambda lag: _auto(celsius, lag), nothing, _free(celsius, r[CELSIUS], run))
    return found


def _friction(
    model: WetClutch, run: Columns, shown: Columns, parameters: Values, effects: Values
) -> Callable[[np.ndarray], np.ndarray]:
    """What the friction block makes of a pressure that is off [bar] (n,): torque [Nm] (n,)."""

    def torque(off: np.ndarray) -> np.ndarray:
        behind = {**run, **shown, PRESSURE: shown[PRESSURE] + off}
        return np.asarray(model.simulate_block(FRICTION, behind, parameters, effects)[TORQUE])

    still = torque(np.zeros_like(shown[PRESSURE]))
    return lambda off: torque(off) - still


def _warm_oil(power: np.ndarray, parameters: Values, period: float) -> np.ndarray:
    """What friction power [W] that is missing warms the oil by [K]: rig.md 7, exact for a power held over a sample."""
    capacity, transfer = parameters["oil.heat_capacity"], parameters["oil.heat_transfer"]
    decay = np.exp(-transfer / capacity * period)
    return np.asarray(lfilter([0.0, (1.0 - decay) / transfer], [1.0, -decay], power))


def _remove_slow(values: np.ndarray, period: float) -> np.ndarray:
    """Without what is slower than _WASHOUT."""
    pole = np.exp(-_WASHOUT * period)
    return np.asarray(lfilter([1.0, -1.0], [1.0, -pole], values - values[0]))


def _gains(model: WetClutch) -> float:
    """How far the gains of the two torque sensors may differ by their data sheets (1 sigma)."""
    sheets = [model.parameters[f"sensors.{name}_sensitivity"] for name in ("clutch_torque", "motor_torque")]
    return float(np.sqrt(sum((p.uncertainty / p.value) ** 2 for p in sheets)))


def _match_gain(x2: np.ndarray, x3: np.ndarray, torque: np.ndarray, most: float) -> np.ndarray:
    """`x3` as if its sensor's gain differed from that of `x2` by no more than is left beyond `most`."""
    swing = torque - torque.mean()  # an offset is no gain
    differ = np.clip((x2 - x3) @ swing / max(float(swing @ swing), 1e-12), -most, most)
    return x3 + differ * torque


def _shift_in_time(residual: np.ndarray, slope: np.ndarray, most: float) -> np.ndarray:
    """`residual` of the slip as if it had been simulated 0 to `most` [s] late, `slope` [1/s] simulated: an encoder's speed is
    half a sample old."""
    late = np.clip(-(residual @ slope) / max(float(slope @ slope), 1e-12), 0.0, most)
    return residual + late * slope


def _free(x: np.ndarray, raw: np.ndarray, run: Columns) -> np.ndarray:
    """x^2 less what white noise, as large as in `raw`, has in it."""
    return x**2 - estimate_noise(raw) ** 2 / max(1, round(MEAN / _period(run)))


def _auto(x: np.ndarray, lag: int) -> np.ndarray:
    """x_j x_(j+lag), 0 at the end."""
    product = np.zeros_like(x)
    product[:-lag] = x[lag:] * x[:-lag]
    return product


def _off(model: Model, floors: Values, run: Columns, shown: Columns) -> Columns:
    """Measured less simulated, without the offset of a run that is known to `Output.beginning` floors only."""
    found = {}
    for output in model.outputs:
        residual = run[output.column] - shown[output.column]
        spread = len(residual) * output.beginning**2
        found[output.column] = residual - (1.0 - 1.0 / np.sqrt(1.0 + spread)) * residual.mean()
    return found


def means(values: np.ndarray, run: Columns) -> np.ndarray:
    """Means over MEAN."""
    size = max(1, round(MEAN / _period(run)))
    n = len(values) // size
    return np.asarray(values[: n * size].reshape(n, size).mean(axis=1))


def _period(run: Columns) -> float:
    return float(run["time_s"][1] - run["time_s"][0])
