"""Lift-up: the force F_N(v, a) with which an oil film lifts a sliding body, from butterflies (announced in thesis sec. 7).

What            a gap sensor shows the lift h over a reciprocating position: the height of its wings is a function of the speed,
                the distance between its branches is the lag of the film
Equation        force    appendix E, `plant_sim.friction.lift_up`: F_N,inf, v_N, C_N; body and contact are known
                height   h' = r (h_inf (1 - exp(-|v|/v_N)) - h), as in `plant_sim.rigs.tribometer`
                both: min sum |h_model - h - (b_0 + b_1 sin x + b_2 cos x)|^2, b of each record: zero of the sensor, and runout
                F_N(v, a) = F(v) - T(v) F'(v) a for sliding forwards, the slow manifold of either; T: the lag, F_N/C_N or 1/r
                a height lifts as the force G (1 - (1 - h/d)^p),  K d^p = G
Assumptions     mass, stiffness and power of the contact are known, as from the gap over loads. A height is read as the gap has
                it: strokes slow beside the normal resonance, at 9 Hz and 290 Hz it comes out 1.5 % too high
Valid range     speeds and accelerations of the records: the function is not asked beyond them
Not modelled    lift-up that depends on the load, tilt, harmonics of the runout
References      Janssens 2010, appendix E, secs. 4.2.2, 7, figs 4.18, E.2, E.3, E.6
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, pi

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, lfilter, sosfiltfilt

from clutch_hil.bench.arguments import take_function
from clutch_hil.identify.friction.intervals import compute_intervals
from plant_sim.friction.identification.least_squares import minimise
from plant_sim.friction.lift_up import LiftingXGMS, LiftUp
from plant_sim.friction.load_law import Amontons
from plant_sim.friction.model import Array, check_signal, require, require_type
from plant_sim.friction.xgms import XGMS
from protocols.errors import InputError

LEAST_SAMPLES = 200  # of a record: chosen, a few tens in each wing
SPEED_SHARES = (0.1, 0.3, 1.0, 3.0)  # of the greatest speed, from which the search for v_N starts; chosen
LAG_SHARES = (0.02, 0.2)  # of a period of the stroke, from which the search for the lag starts; chosen
WIDE = 1e3  # ratio of a bound to the size of the records; chosen
# Steps of the simulation in a period of the normal resonance, first for the search and then for the result: with 400 the lag is
# off by 0.12 %, the rest by less than 0.01 % (cycles of fig E.2 against some with 2700)
STEPS = (50, 400)
SETTLING_SHARE = 0.25  # of a record, at its beginning, that is not judged: the film has built up by then; chosen
LEAST_SPREAD = 1.2  # of the greatest speeds of all records: one alone does not tell height from speed scale; chosen


@dataclass(frozen=True)
class LiftRecord:
    """Butterflies: `position` [m] and `lift` [m] (n,), every `period` [s], under the `load` [N]; zero of the lift is free.

    radius: of the contact [m], where the position is one along it, so that runout of the disks is known by its angle; 0 for a
    sensor without runout. low_pass: corner [Hz] of the Butterworth filter of second order that the lift went through, forwards
    and backwards; the model goes through it as well; 0 for none. Raises InputError.
    """

    position: Array
    lift: Array
    period: float
    load: float
    radius: float = 0.0
    low_pass: float = 0.0

    def __post_init__(self) -> None:
        count = np.size(self.position)
        if np.ndim(self.position) != 1 or count < LEAST_SAMPLES:
            raise InputError(f"butterflies have {count} samples; {LEAST_SAMPLES} or more are needed, in one dimension")
        for name, unit in (("position", "m"), ("lift", "m")):
            values = check_signal(name, getattr(self, name), count)
            object.__setattr__(self, name, values)
            if float(np.ptp(values)) == 0.0:
                raise InputError(f"the {name} of the butterflies stays at {values[0]:g} {unit}; it must change")
        require("period of the butterflies", self.period, above=0.0, unit="s")
        require("load of the butterflies", self.load, above=0.0, unit="N")
        require("radius of the butterflies", self.radius, least=0.0, unit="m")
        require("low-pass of the butterflies", self.low_pass, least=0.0, most=0.45 / self.period, unit="Hz")

    @property
    def speed(self) -> Array:
        """Sliding speed [m/s] (n,)."""
        return np.gradient(self.position, self.period)

    def filter(self, lift: Array) -> Array:
        """`lift` [m] (n,) as the sensor would show it."""
        if not self.low_pass:
            return lift
        return np.asarray(sosfiltfilt(butter(2, self.low_pass, fs=1.0 / self.period, output="sos"), lift))

    @property
    def nuisance(self) -> Array:
        """Columns (n, k) of what the sensor shows beside the lift: its zero, and runout."""
        ones = np.ones(self.position.size)
        if not self.radius:
            return ones[:, None]
        angle = self.position / self.radius
        return np.column_stack([ones, np.sin(angle), np.cos(angle)])

    @property
    def judged_rows(self) -> slice:
        """The samples at which the film has built up."""
        return slice(int(SETTLING_SHARE * self.position.size), None)


@dataclass(frozen=True)
class IdentifiedLiftUp:
    """A lift-up function: `values` by name with their 95 % `intervals`, `correlation`, error [m] RMS, and `warnings`.

    Values of the kind "force": highest [N], speed_scale [m/s], attraction [N/s]; of the kind "height": height [m],
    speed_scale [m/s], rate [1/s]. `contact` has mass, stiffness and power. `reach`: greatest speed [m/s] and acceleration
    [m/s^2] of the records.
    """

    kind: str
    values: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]]
    correlation: Array
    error: float
    contact: LiftUp
    reach: tuple[float, float]
    warnings: tuple[str, ...]

    def force(self, speed: Array | float, acceleration: Array | float = 0.0, load: float = 1.0) -> Array:
        """F_N(v, a) [N] at `speed` [m/s] and `acceleration` [m/s^2], under the `load` [N] that a height needs; at least 0."""
        speed, along = np.abs(speed), np.sign(speed) * np.asarray(acceleration)
        scale, most = self.values["speed_scale"], self.values["highest" if self.kind == "force" else "height"]
        steady, slope = -most * np.expm1(-speed / scale), most / scale * np.exp(-speed / scale)
        lag = steady / self.values["attraction"] if self.kind == "force" else 1.0 / self.values["rate"]
        film = np.maximum(steady - lag * slope * along, 0.0)
        if self.kind == "force":
            return np.asarray(film)
        approach = (load / self.contact.stiffness) ** (1.0 / self.contact.power)
        return np.asarray(load * (1.0 - np.maximum(1.0 - film / approach, 0.0) ** self.contact.power))

    @property
    def model(self) -> LiftUp:
        """The normal direction of `plant_sim.friction.lift_up`. Raises InputError for the kind "height"."""
        if self.kind != "force":
            raise InputError("lift-up of the kind 'height' is not a model of appendix E; identify the kind 'force'")
        return _with_values(self.contact, self.values)


def identify_lift_up(
    records: Sequence[LiftRecord],
    contact: LiftUp,
    tangential: XGMS | None = None,
    kind: str = "force",
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> IdentifiedLiftUp:
    """Identify F_N(v, a) from the butterflies in `records`.

    contact: mass, stiffness, power and damping of the body on its contact, which are known; its lift-up force is what is
    identified. tangential: the friction of the contact, whose elements begin to slip where the film begins to build up; one
    that slips at once if None. kind: "force" (appendix E) or "height" (a film by the speed alone, whatever the load).
    Raises InputError.
    """
    if kind not in ("force", "height"):
        raise InputError(f"kind of lift-up is {kind!r}; allowed is force or height")
    if not records:
        raise InputError("no butterflies were given; one record or more is needed")
    require_type("contact", contact, LiftUp)
    take_function("progress", progress)
    names = ("highest", "speed_scale", "attraction") if kind == "force" else ("height", "speed_scale", "rate")
    fastest = max(float(np.abs(one.speed).max()) for one in records)
    size = max(float(np.ptp(one.lift)) for one in records)
    stroke = min(_measure_stroke_time(one) for one in records)
    load = float(np.mean([one.load for one in records]))
    projections = [_project_nuisance_out(one) for one in records]
    slips = tangential or _make_slipping_element(records)

    def compute_residual(theta: Array, steps: int) -> Array:
        values = dict(zip(names, map(float, theta), strict=True))
        shown = [_simulate(kind, values, one, contact, slips, steps) for one in records]
        return (
            np.concatenate(
                [
                    project((lift - one.lift)[one.judged_rows])
                    for lift, one, project in zip(shown, records, projections, strict=True)
                ]
            )
            / size
        )  # the search ends by numbers without unit

    approach = (load / contact.stiffness) ** (1.0 / contact.power)
    if kind == "force":
        most = load * (
            1.0 - max(1.0 - size / approach, 0.0) ** contact.power
        )  # F_N that lifts by the size of the butterflies
        lag = np.array([[most / (share * stroke)] for share in LAG_SHARES])
    else:
        most = size
        lag = np.array([[1.0 / (share * stroke)] for share in LAG_SHARES])
    starts = np.array([[most, share * fastest, rate] for share in SPEED_SHARES for rate in lag.ravel()])
    middle = np.array([most, fastest, float(lag.mean())])
    bounds = np.column_stack([middle / WIDE, middle * WIDE])
    if kind == "force":
        bounds[0, 1] = load  # a greater force throws the body off (appendix E)
        starts[:, 0] = np.minimum(starts[:, 0], 0.9 * load)
    estimate = minimise(lambda theta: compute_residual(theta, STEPS[0]), names, starts, bounds, {}, progress)
    if kind == "force":
        estimate = minimise(lambda theta: compute_residual(theta, STEPS[1]), names, estimate.values, bounds)
    left = np.split(
        compute_residual(estimate.values, STEPS[1]),
        np.cumsum([one.position[one.judged_rows].size for one in records])[:-1],
    )
    spans, correlation = compute_intervals(estimate, bounds, left)
    reach = max(float(np.abs(np.gradient(one.speed, one.period)).max()) for one in records)
    return IdentifiedLiftUp(
        kind,
        dict(zip(names, map(float, estimate.values), strict=True)),
        {name: (float(low), float(high)) for name, (low, high) in zip(names, spans, strict=True)},
        correlation,
        estimate.rmse * size,
        contact,
        (fastest, reach),
        _describe_doubt(names, estimate.values, spans, records),
    )


def simulate_lift(identified: IdentifiedLiftUp, record: LiftRecord, tangential: XGMS | None = None) -> Array:
    """Lift [m] (n,) along the record, with the zero and the runout of its sensor."""
    slips = tangential or _make_slipping_element([record])
    lift = _simulate(identified.kind, identified.values, record, identified.contact, slips, STEPS[1])
    beside, *_ = np.linalg.lstsq(
        record.nuisance[record.judged_rows], (record.lift - lift)[record.judged_rows], rcond=None
    )
    return np.asarray(lift + record.nuisance @ beside)


def _simulate(
    kind: str, values: Mapping[str, float], record: LiftRecord, contact: LiftUp, tangential: XGMS, steps: int
) -> Array:
    """Lift [m] (n,) that `values` make of the record's position, in `steps` in a period of the normal resonance."""
    if kind == "force":
        model = LiftingXGMS(tangential, _with_values(contact, values))
        every = _count_substeps(record, contact, steps)
        position = _refine(record.position, every)
        state = model.trace(position, record.period / every, record.load).state
        return record.filter(model.lift(state)[::every])
    steady = -values["height"] * np.expm1(-np.abs(record.speed) / values["speed_scale"])
    keep = np.exp(-values["rate"] * record.period)
    return record.filter(lfilter([0.5 * (1.0 - keep), 0.5 * (1.0 - keep)], [1.0, -keep], steady))


def _count_substeps(record: LiftRecord, contact: LiftUp, steps: int) -> int:
    """Steps of the simulation in a period of the record."""
    approach = (record.load / contact.stiffness) ** (1.0 / contact.power)
    resonance = (contact.power * record.load / approach / contact.mass) ** 0.5  # rad/s
    return max(ceil(record.period * steps * resonance / (2.0 * pi)), 1)


def _refine(position: Array, every: int) -> Array:
    """`position` (n,) with `every` steps in place of one, along a cubic spline."""
    if every == 1:
        return position
    at = np.arange(position.size)
    return np.asarray(CubicSpline(at, position)(np.arange((position.size - 1) * every + 1) / every))


def _with_values(contact: LiftUp, values: Mapping[str, float]) -> LiftUp:
    return LiftUp(
        values["highest"], values["speed_scale"], values["attraction"], contact.mass, contact.stiffness, contact.power,
        contact.damping,
    )  # fmt: skip


def _make_slipping_element(records: Sequence[LiftRecord]) -> XGMS:
    """One element whose break point is a thousandth of the least stroke."""
    least = min(float(np.ptp(one.position)) for one in records)
    coefficient = 0.1  # any: the lift does not depend on the friction but through the break point
    load = max(one.load for one in records)
    return XGMS(Amontons(coefficient), np.array([coefficient * load / (1e-3 * least)]), np.ones(1))


def _project_nuisance_out(record: LiftRecord) -> Callable[[Array], Array]:
    """Project judged samples (n,) onto what zero and runout of the sensor leave."""
    basis, _ = np.linalg.qr(record.nuisance[record.judged_rows])
    return lambda values: np.asarray(values - basis @ (basis.T @ values))


def _measure_stroke_time(record: LiftRecord) -> float:
    """Time [s] between two reversals. Raises InputError where there are too few."""
    centred = record.position - 0.5 * (record.position.max() + record.position.min())
    crossings = int(np.count_nonzero(np.diff(centred > 0.0)))
    if crossings < 3:  # one period
        raise InputError(
            f"the position passes its middle {crossings} times; 3 or more are needed: butterflies reciprocate"
        )
    return record.position.size * record.period / crossings


def _describe_doubt(
    names: Sequence[str], values: Array, spans: Array, records: Sequence[LiftRecord]
) -> tuple[str, ...]:
    doubts = []
    for name, value, (low, high) in zip(names, values, spans, strict=True):
        if not np.isfinite(low):
            doubts.append(f"{name} rests at its bound {value:.3g}: these butterflies do not determine it")
        elif 0.5 * (high - low) > abs(value):
            doubts.append(f"{name} is poorly determined: {value:.3g} +- {0.5 * (high - low):.2g}")
    greatest = [float(np.abs(one.speed).max()) for one in records]
    if max(greatest) < LEAST_SPREAD * min(greatest):
        doubts.append(
            f"all butterflies reach about {max(greatest):.3g} m/s; record some at half and at double this speed"
        )
    return tuple(doubts)
