"""Frequency response of the pressure loop from recordings: p_cyl/p_d and M/p_d, with coherence and intervals (fig 6.15).

Equation        H = S_yu/S_uu,  coherence g2 = |S_yu|^2/(S_uu S_yy)
                relative deviation of |H|, and deviation of the phase [rad]: e = sqrt((1 - g2)/(2 g2 (n - 1))), n averages; the
                95 % half width is t(0.975, 2 n - 2) e
                periodic demand: S by the discrete Fourier transform of whole periods, at the excited lines. The first period
                is left out, because the loop settles in it. Any other demand: Welch's method, Hann windows of 2 s with 50 %
                overlap, n = 0.947 of the number of windows
                bandwidth: frequency at which |H| over its value at rest first falls by 3 dB; its interval ends where the
                edges of the 95 % band fall by 3 dB. At rest p_cyl/p_d is 1 bar/bar, because the regulator integrates, and
                M/p_d is the slope of the identified maps
Assumptions     plates in contact that slide; the demand does not depend on the measured signals; the loop is linear about the
                operating point: a valve at its limits gives a warning
Not modelled    distortion that repeats with the period: the coherence does not show it
References      Janssens 2010, sec. 6.3, fig 6.15; Bendat and Piersol 2010, Random data, ch. 9; Welch 1967, IEEE Trans. Audio
                Electroacoust. 15
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import csd, welch
from scipy.stats import t as student

from clutch_hil.fitting.model import Columns
from clutch_hil.identify.stepwise import LEAST_SLIP

DEMAND = "controller_pressure_demand_bar"  # p_d in a run of the bench
HALF_POWER = -10.0 * np.log10(2.0)  # dB: "-3 dB"
_PRESSURE, _TORQUE, _SLIP, _VOLTAGE, _CELSIUS = (
    "cylinder_pressure_bar", "clutch_torque_nm", "slip_speed_rad_s", "valve_voltage_v", "oil_temperature_degc",
)  # fmt: skip
_MARGIN = 0.1  # bar above contact, so that the plates never separate
_LEAST_SECONDS = 3.0  # s, shortest stretch: three periods of 1 s, or two windows
_LEAST_AMPLITUDE = 0.01  # bar, standard deviation of the demand: twice the noise of a sample of the pressure
_LEAST_COHERENCE = 0.9  # at every line up to the bandwidth; with 7 averages the magnitude is then known to 20 %
_MOST_SATURATED = 0.002  # largest share of rows with the valve at a limit: the distortion is then below a tenth of a dB
_HIGHEST = 50.0  # Hz: five times the bandwidth of the thesis
_LINE_POWER = 1e-3  # share of the power of the strongest line: weaker lines are leakage
_WELCH_POWER = 1e-5  # share of the power of the strongest line: the power of a step falls with 1/f^2
_PERIODS = 3  # smallest number of periods: the loop settles in the first, two are compared
_SHORTEST = 0.1  # s, shortest period
# Largest root mean square difference between successive periods, as a share of the demand's standard deviation. Set-points on
# CAN have steps of 5 mbar: in a multisine of 0.13 bar every fifteenth sample was one step off the period before, which is 1 %
_REPEATS = 0.02
_LIKE = 0.3  # least autocorrelation of the demand's changes at a lag of one period; at least three periods are required
_WINDOW, _OVERLAP_SHARE = 2.0, 0.947  # s; 1/(1 + 2/36): Hann windows with 50 % overlap have a correlation of a sixth
_QUANTILE = 0.975
_NEIGHBOURS = 3  # lines on each side for the cubic spline: a straight line is 0.05 Hz too low between lines of 1 Hz
# Bar, mean deviation of pressure from demand: four deviations of a sample; with an integrating regulator it is 0
_OFF_DEMAND = 0.02


@dataclass(frozen=True)
class Channel:
    """Response (n,) at `frequency` [Hz] from the demanded pressure to one signal.

    response: complex, in units of the output per bar. coherence (n,). stationary: the response at rest. averages: number of
    independent averages.
    """

    frequency: np.ndarray
    response: np.ndarray
    coherence: np.ndarray
    stationary: float
    averages: float

    @property
    def decibel(self) -> np.ndarray:
        """Magnitude relative to the stationary response [dB]."""
        return np.asarray(20.0 * np.log10(np.abs(self.response) / self.stationary))

    @property
    def phase(self) -> np.ndarray:
        """Phase [deg], unwrapped."""
        return np.asarray(np.degrees(np.unwrap(np.angle(self.response))))

    @property
    def share(self) -> np.ndarray:
        """Half width of the 95 % interval, relative for the magnitude, in rad for the phase, (n,)."""
        free = max(self.averages - 1.0, 0.5)
        coherence = np.clip(self.coherence, 1e-6, 1.0)
        return np.asarray(student.ppf(_QUANTILE, 2.0 * free) * np.sqrt((1.0 - coherence) / (2.0 * coherence * free)))

    @property
    def decibel_band(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper end of the 95 % interval of `decibel`, (n,) each."""
        share = np.minimum(self.share, 0.99)
        return self.decibel + 20.0 * np.log10(1.0 - share), self.decibel + 20.0 * np.log10(1.0 + share)

    @property
    def phase_half(self) -> np.ndarray:
        """Half width of the 95 % interval of `phase` [deg], (n,)."""
        return np.minimum(np.degrees(self.share), 180.0)

    @property
    def bandwidth(self) -> float | None:
        """Frequency at which the magnitude first falls by 3 dB [Hz]; None if it does not."""
        return find_fall(self.frequency, self.decibel)

    @property
    def bandwidth_interval(self) -> tuple[float, float] | None:
        """95 % interval of `bandwidth` [Hz]; an end is the first or last line where the band does not cross -3 dB inside the
        range."""
        if self.bandwidth is None:
            return None
        low, high = (find_fall(self.frequency, edge) for edge in self.decibel_band)
        return low or float(self.frequency[0]), high or float(self.frequency[-1])

    def make_document(self) -> dict:
        """Return the channel as a JSON document."""
        return {
            "frequency_hz": self.frequency.tolist(), "magnitude_db": self.decibel.tolist(),
            "magnitude_db_ci95": [edge.tolist() for edge in self.decibel_band], "phase_deg": self.phase.tolist(),
            "phase_deg_half95": self.phase_half.tolist(), "coherence": self.coherence.tolist(),
            "averages": self.averages, "stationary": self.stationary, "bandwidth_hz": self.bandwidth,
            "bandwidth_hz_ci95": self.bandwidth_interval,
        }  # fmt: skip


def find_fall(frequency: np.ndarray, decibel: np.ndarray) -> float | None:
    """Return the frequency [Hz] at which `decibel` (n,) first falls by 3 dB, by cubic interpolation; None if it does not."""
    below = np.flatnonzero(decibel < HALF_POWER)
    if not len(below) or below[0] == 0:
        return None
    first = int(below[0])
    near = slice(max(first - _NEIGHBOURS, 0), first + _NEIGHBOURS)
    between = frequency[first - 1], frequency[first]
    roots = CubicSpline(frequency[near], decibel[near]).solve(HALF_POWER, extrapolate=False)
    inside = roots[(roots >= between[0]) & (roots <= between[1])]
    return float(inside[0])


@dataclass(frozen=True)
class LoopResponse:
    """Responses of cylinder pressure [bar/bar] and clutch torque [Nm/bar] about an operating point, from one stretch of a run.

    point: means of pressure [bar], slip [rad/s] and oil temperature [degC]. amplitude: standard deviation of the demand [bar].
    between [s]: begin and end of the stretch. saturated: share of its rows with the valve at a limit. periodic: whether whole
    periods were compared. off: mean of pressure minus demand [bar].
    """

    pressure: Channel
    torque: Channel
    point: tuple[float, float, float]
    amplitude: float
    run: str
    between: tuple[float, float]
    saturated: float
    periodic: bool
    off: float

    def __str__(self) -> str:
        """Return both bandwidths in one line."""
        pressure, slip, celsius = self.point
        parts = [_format_bandwidth(n, c) for n, c in (("p_cyl/p_d", self.pressure), ("M/p_d", self.torque))]
        return f"{'; '.join(parts)}; at {pressure:.3g} bar, {slip:.3g} rad/s, {celsius:.3g} degC ({self.run})"

    def warn(self) -> list[str]:
        """Return a warning sentence for each weakness of the stretch."""
        warnings = []
        if not self.periodic:
            warnings.append(
                "the demand of the frequency response does not repeat: leakage, or a demand that follows the torque, may move"
                " the bandwidth beyond its interval; play a multisine of the pressure"
            )
        if self.saturated > _MOST_SATURATED:
            warnings.append(
                f"the valve is at a limit in {self.saturated:.1%} of the rows of the frequency response; play a smaller"
                " amplitude"
            )
        if abs(self.off) > _OFF_DEMAND:
            warnings.append(
                f"the pressure is {self.off:.2g} bar off its demand where the frequency response was measured: the regulator"
                " does not integrate there, so p_cyl/p_d at rest is not 1, so this is not the bandwidth of a regulated pressure"
            )
        for name, channel in (("p_cyl/p_d", self.pressure), ("M/p_d", self.torque)):
            end = channel.bandwidth if channel.bandwidth is not None else np.inf
            low = channel.coherence[channel.frequency <= end]
            if len(low) and low.min() < _LEAST_COHERENCE:
                warnings.append(
                    f"{name} has a coherence of {low.min():.2g} below its bandwidth, {_LEAST_COHERENCE:g} is needed: play a"
                    " multisine of the pressure, or a larger one"
                )
            if channel.bandwidth is None:
                warnings.append(
                    f"{name} does not cross -3 dB from {channel.frequency[0]:.3g} to {channel.frequency[-1]:.3g} Hz, the"
                    " range that these runs excite: no bandwidth"
                )
        return warnings

    def make_document(self) -> dict:
        """Return the response as a JSON document."""
        return {
            "run": self.run, "between_s": list(self.between), "periodic": self.periodic,
            "operating_point": dict(zip(("pressure_bar", "slip_rad_s", "oil_degc"), self.point, strict=True)),
            "amplitude_bar": self.amplitude, "saturated": self.saturated, "off_demand_bar": self.off,
            "p_cyl_over_p_d": self.pressure.make_document(), "torque_over_p_d": self.torque.make_document(),
        }  # fmt: skip


def _format_bandwidth(name: str, channel: Channel) -> str:
    interval = channel.bandwidth_interval
    if channel.bandwidth is None or interval is None:
        return f"{name} no bandwidth"
    return f"{name} 3 dB down at {channel.bandwidth:.2f} Hz ({interval[0]:.2f} to {interval[1]:.2f})"


def measure_response(
    runs: Mapping[str, Columns], contact: float, highest: float, slope: Callable[[float, float, float], float]
) -> tuple[LoopResponse | None, list[str]]:
    """Return the best response that the runs give (None without one), and a sentence for each warning.

    contact: contact pressure as the sensor measures it [bar]. highest: valve voltage at its limit [V].
    slope(p, omega, T): slope of the torque over the pressure at rest [Nm/bar], at an operating point.
    """
    if not any(DEMAND in run for run in runs.values()):
        return None, [f"the frequency response needs the column {DEMAND}; these runs lack it"]
    responses = []
    largest = 0.0
    for name, run in runs.items():
        if DEMAND not in run:
            continue
        for stretch in _find_stretches(run, contact):
            part = {c: run[c][stretch] for c in ("time_s", DEMAND, _PRESSURE, _TORQUE, _SLIP, _VOLTAGE, _CELSIUS)}
            periodic = _find_periods(part)
            if periodic is not None:
                part = {c: values[periodic[0]] for c, values in part.items()}
            largest = max(largest, float(np.std(part[DEMAND])))
            if np.std(part[DEMAND]) >= _LEAST_AMPLITUDE:
                responses.append(_measure(name, part, periodic[1] if periodic else 0, highest, slope))
    if not responses:
        return None, [
            f"the frequency response needs a pressure demand that moves for {_LEAST_SECONDS:g} s in contact, by"
            f" {_LEAST_AMPLITUDE:g} bar at least; the most in these runs is {largest:.2g} bar"
        ]
    best = min(responses, key=_judge)
    return best, best.warn()


def _judge(response: LoopResponse) -> tuple[int, float]:
    """Return a sort key, lowest for the best response: number of warnings, then width of the bandwidth interval [Hz]."""
    interval = response.pressure.bandwidth_interval
    return len(response.warn()), interval[1] - interval[0] if interval else np.inf


def _find_stretches(run: Columns, contact: float) -> list[slice]:
    """Return the stretches of a run in contact with sliding plates, as slices of its rows."""
    inside = (
        (run[_PRESSURE] > contact + _MARGIN) & (run[DEMAND] > contact + _MARGIN) & (np.abs(run[_SLIP]) > LEAST_SLIP)
    )  # fmt: skip
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    least = _LEAST_SECONDS / float(run["time_s"][1] - run["time_s"][0])
    return [slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= least]


def _find_periods(part: Columns) -> tuple[slice, int] | None:
    """Return the longest stretch of whole periods of the demand, and the samples per period; None if the demand does not
    repeat."""
    demand = part[DEMAND]
    change = np.diff(demand)
    power = float(change @ change)
    if power == 0.0:
        return None
    size = len(change)
    spectrum = np.fft.rfft(change, 2 * size)
    like = np.fft.irfft(np.abs(spectrum) ** 2)[:size] / power
    first = round(_SHORTEST / float(part["time_s"][1] - part["time_s"][0]))
    peaks = [
        n for n in range(max(first, 1), size // _PERIODS + 1)
        if like[n] > _LIKE and like[n] >= like[n - 1] and like[n] >= like[n + 1]
    ]  # fmt: skip
    best: tuple[slice, int] | None = None
    for period in peaks:
        apart = np.cumsum(np.concatenate([[0.0], (demand[period:] - demand[:-period]) ** 2]))
        # whether the period that begins at a sample equals the next one; the mean square is 0 except for rounding
        same = (apart[period:] - apart[:-period]) / period <= (_REPEATS * float(np.std(demand))) ** 2
        edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(int)))
        for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            count = (end - 1 - begin) // period + 2
            if count < _PERIODS or np.std(demand[begin : begin + count * period]) < _LEAST_AMPLITUDE:
                continue
            if best is None or count * period > 1.05 * (best[0].stop - best[0].start):
                best = slice(begin, begin + count * period), period
    return best


def _measure(
    name: str, part: Columns, period: int, highest: float, slope: Callable[[float, float, float], float]
) -> LoopResponse:
    """Return the response of a stretch. period: samples per period, 0 if the demand does not repeat."""
    point = float(np.mean(part[_PRESSURE])), float(np.mean(np.abs(part[_SLIP]))), float(np.mean(part[_CELSIUS]))
    torque = np.abs(part[_TORQUE])
    compute = _average_periods if period else _average_windows
    frequency, channels, averages = compute(part, [part[_PRESSURE], torque], period)
    stationary = (1.0, slope(*point))
    pressure, moment = (
        Channel(frequency, *channel, at_rest, averages) for channel, at_rest in zip(channels, stationary, strict=True)
    )
    limited = (part[_VOLTAGE] <= 0.0) | (part[_VOLTAGE] >= highest)
    return LoopResponse(
        pressure, moment, point, float(np.std(part[DEMAND])), name,
        (float(part["time_s"][0]), float(part["time_s"][-1])), float(np.mean(limited)), period > 0,
        float(np.mean(part[_PRESSURE] - part[DEMAND])),
    )  # fmt: skip


Spectra = tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray]], float]  # frequency; response, coherence; averages


def _average_periods(part: Columns, outputs: Sequence[np.ndarray], period: int) -> Spectra:
    step = float(part["time_s"][1] - part["time_s"][0])
    count = len(part[DEMAND]) // period

    def compute_lines(values: np.ndarray) -> np.ndarray:
        return np.asarray(np.fft.rfft(values[: count * period].reshape(count, period)[1:]))

    u = compute_lines(part[DEMAND])
    power = np.sum(np.abs(u) ** 2, axis=0)
    frequency = np.fft.rfftfreq(period, step)
    used = _find_excited(frequency, power, _LINE_POWER)
    channels = []
    for output in outputs:
        y = compute_lines(output)
        cross, own = np.sum(y * u.conj(), axis=0), np.sum(np.abs(y) ** 2, axis=0)
        channels.append(_divide(cross[used], power[used], own[used]))
    return frequency[used], channels, float(count - 1)


def _find_excited(frequency: np.ndarray, power: np.ndarray, least: float) -> np.ndarray:
    """Return a mask (n,) of the lines whose power is at least the share `least` of the strongest line."""
    used = (frequency > 0.0) & (frequency <= _HIGHEST)
    return np.asarray(used & (power > 0.0) & (power >= least * power[used].max()))


def _divide(cross: np.ndarray, power: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return response and coherence; the coherence is 0 for an output that does not move."""
    return cross / power, np.abs(cross) ** 2 / np.maximum(power * own, 1e-300)


def _average_windows(part: Columns, outputs: Sequence[np.ndarray], period: int) -> Spectra:
    rate = 1.0 / float(part["time_s"][1] - part["time_s"][0])
    length = round(_WINDOW * rate)
    frequency, power = welch(part[DEMAND], rate, nperseg=length)
    used = _find_excited(frequency, power, _WELCH_POWER)
    channels = []
    for output in outputs:
        cross, own = csd(part[DEMAND], output, rate, nperseg=length)[1], welch(output, rate, nperseg=length)[1]
        channels.append(_divide(cross[used], power[used], own[used]))
    windows = 2 * len(part[DEMAND]) // length - 1
    return frequency[used], channels, _OVERLAP_SHARE * windows
