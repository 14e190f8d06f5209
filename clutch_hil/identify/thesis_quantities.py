"""Quantities of the thesis from an identified clutch, with 95 % intervals: Tables 6.3 to 6.5, figs 6.8 and 6.12 to 6.14.

Equation        M(p, omega, T) = M_C s_n + C_v r_T omega^gamma at rest                              eq. 6.2, docs/rig.md, 4 to 6
                M = a_M p + b_M at 200 rpm and 70 degC over the pressures of fig 6.12: p_contact = -b_M/a_M
                mu = a_M/(r_fric A_cyl N_f)                                                         eq. 6.4, Table 6.3
                mu(T) = mu M(T)/M(70 degC) at 200 rpm                                               eq. 6.3, fig 6.8
                lag = s_n/C                                                                         eq. 6.9, fig 6.14
                fill volume = A_cyl clearance; fill time: from the demand of the middle pressure to the touch of the plates,
                  with the regulator of docs/rig.md and the identified hydraulics
                half width of f(x) = 1.96 sqrt(g' V g), g = df/dx by central differences, V covariance of the parameters x
Assumptions     f is linear in x over an interval. Geometry is known: r_fric, N_f, A_cyl, and the clearance that was held
References      Janssens 2010, sec. 6.3, 6.4
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from clutch_hil.fitting.intervals import NORMAL_95
from clutch_hil.fitting.model import Columns, Values
from plant_sim.blocks import oil
from plant_sim.rigs import wet_clutch
from protocols.files.parameters import ParameterSet
from protocols.files.units import BAR, RPM, ZERO_CELSIUS

RADIUS, CONTACTS = 0.058, 2  # m and -, r_fric and N_f: Table 6.2
# of the shipped clutch: the geometry of another one cannot be identified from runs
_GEOMETRY = f"if {CONTACTS} contacts of {1e3 * RADIUS:g} mm"
# Pressures of the maps, bar above contact: those of fig 6.12, 2.7 to 4.2 bar, on a clutch with contact at 2.35 bar
ABOVE = (0.35, 0.45, 0.55, 0.65, 0.85, 1.05, 1.25, 1.45, 1.65, 1.85)
_FURTHER = 0.2, 10  # bar, step as in fig 6.12; largest number of further pressures, for runs at higher ones
MIDDLE = 1.05  # bar above contact: 3.4 bar in the thesis, where the dynamics were measured
SPEED = 200 * RPM  # of Table 6.3
_REFERENCE = 70.0  # degC, of Tables 6.3 to 6.5
_TEMPERATURES = (50.0, 60.0, 70.0, 80.0, 90.0, 100.0, 110.0, 120.0, 130.0, 140.0, 150.0)  # degC, range of fig 6.8
_SHOWN = 0.999  # quantile of the rows of a run: a peak of one or two samples is no evidence for a map
_STEP = 0.1  # step of the differences, in standard deviations of the parameter
_SLOPE_STEP = 0.01  # bar to both sides, chosen: the maps are smooth over it
_FILL = 1.0  # s, longest fill time, chosen: the shipped clutch takes 85 ms
_MOST_EXPONENT = 700.0  # exp of it is 1e304, near the largest double: beta is 1 there
_SAMPLE, _SUBSTEPS = 1e-3, 10  # s and -: sample and integration steps per sample of the simulated fill


@dataclass(frozen=True)
class Quantity:
    """A quantity of the thesis.

    value, half: value and half width of its 95 % interval in `unit`. where: place in the thesis. at: operating point.
    """

    name: str
    value: float
    half: float
    unit: str
    where: str
    at: str = ""

    def make_document(self) -> dict:
        """Return the quantity as a JSON document."""
        low, high = self.value - self.half, self.value + self.half
        return {
            "name": self.name, "value": self.value, "ci95": [low, high], "unit": self.unit, "where": self.where, "at": self.at,
        }  # fmt: skip


@dataclass(frozen=True)
class Propagation:
    """Propagation of uncertainty: parameter `values`, and the `covariance` (p, p) of those in `names`."""

    values: Values
    names: Sequence[str]
    covariance: np.ndarray

    def __call__(self, function: Callable[[Values], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Return the value (k,) of a function of the parameters, and the half width (k,) of its 95 % interval."""
        best = np.asarray(function(self.values), float)
        slopes = np.zeros((len(self.names), *best.shape))
        for k, name in enumerate(self.names):
            step = _STEP * float(np.sqrt(self.covariance[k, k]))
            if step > 0.0:
                above, below = (
                    np.asarray(function({**self.values, name: self.values[name] + sign * step}), float)
                    for sign in (1.0, -1.0)
                )
                slopes[k] = (above - below) / (2.0 * step)
        return best, NORMAL_95 * np.sqrt(
            np.maximum(np.einsum("k...,kl,l...->...", slopes, self.covariance, slopes), 0.0)
        )

    def find_half(self, name: str) -> float:
        """Return the half width of the 95 % interval of a parameter; 0 for a parameter that was not fitted."""
        if name not in self.names:
            return 0.0
        at = list(self.names).index(name)
        return NORMAL_95 * float(np.sqrt(self.covariance[at, at]))


def list_pressures(contact: float, highest: float) -> np.ndarray:
    """Return the pressures of the maps [bar]: those of fig 6.12, continued up to the `highest` pressure of the runs."""
    pressures = contact + np.array(ABOVE)
    least, most = _FURTHER
    further = min(int(max(highest - pressures[-1], 0.0) / least), most)
    return np.append(pressures, np.linspace(pressures[-1], highest, further + 1)[1:])


def compute_maps(v: Values, pressure: np.ndarray) -> np.ndarray:
    """Compute M_C [Nm], C_v [Nm/(rad/s)^gamma] and beta [-], (3, n), at effective friction pressures (n,) [bar]."""
    below = (v["clutch.beta_onset"] - pressure) / v["clutch.beta_scale"]
    depth = np.exp(np.minimum(below, _MOST_EXPONENT))
    return np.array([
        np.maximum(v["clutch.coulomb_slope"] * pressure + v["clutch.coulomb_intercept"], 0.0),
        np.maximum(v["clutch.viscous_slope"] * pressure + v["clutch.viscous_intercept"], 0.0),
        np.minimum(1.0, v["clutch.beta_inf"] + (1.0 - v["clutch.beta_inf"]) * depth),
    ])  # fmt: skip


def compute_torque(v: Values, pressure: np.ndarray, slip: float, celsius: float) -> np.ndarray:
    """Compute the torque at rest [Nm], (n,), at cylinder pressures (n,) [bar], slip [rad/s] and oil temperature [degC]."""
    contact = v["piston.contact_pressure"]
    spring = v["piston.area"] * BAR * (contact - v["piston.preload_pressure"]) / v["piston.clearance"]
    star = contact + (pressure - contact) * v["piston.stack_stiffness"] / (v["piston.stack_stiffness"] + spring)
    coulomb, viscous, beta = compute_maps(v, star)
    ratio = 1.0 + (beta - 1.0) * np.exp(-v["clutch.stribeck_speed"] / slip)
    return np.asarray(coulomb * ratio + viscous * _compute_warmth(v, celsius) * slip ** v["clutch.viscous_exponent"])


def compute_slope(v: Values, pressure: float, slip: float, celsius: float) -> float:
    """Compute the slope of the torque at rest over the cylinder pressure [Nm/bar]."""
    below, above = compute_torque(v, pressure + np.array([-_SLOPE_STEP, _SLOPE_STEP]), slip, celsius)
    return float(above - below) / (2.0 * _SLOPE_STEP)


def _compute_warmth(v: Values, celsius: float) -> float:
    """Compute r_T, the temperature factor of the viscous torque (docs/rig.md, 6)."""
    mu, reference = (
        oil.friction_coefficient(one, v["oil.slope"], v["oil.offset"], v["oil.origin"])
        for one in (celsius, v["oil.reference"])
    )
    return float(oil.viscosity_ratio(mu, reference, v["oil.viscous_gain"]))


def find_highest_pressure(runs: Iterable[Columns], v: Values) -> float:
    """Return the cylinder pressure [bar] that is exceeded in 0.1 % of the rows of a run, without the sensor's offset."""
    shown = max(float(np.quantile(run["cylinder_pressure_bar"], _SHOWN)) for run in runs)
    return shown - v.get("pressure_sensor_offset.offset", 0.0)


def compute_quantities(
    known: Propagation,
    clutch: ParameterSet,
    regulator: tuple[float, float],
    between: tuple[float, float],
    highest: float,
) -> list[Quantity]:
    """Compute the quantities of the thesis.

    clutch: parameters of the identified rig, for the simulated fill. regulator: gains of the pressure regulator [-, 1/s].
    between: lowest and highest oil temperature of the runs [degC]; the temperature law is given within it only. highest:
    pressure of the runs [bar]; map values above it are marked as extrapolated.
    """
    contact = known.values["piston.contact_pressure"]
    pressures, maps = contact + np.array(ABOVE), list_pressures(contact, highest)
    area = known.values["piston.area"]
    middle = np.array([contact + MIDDLE])
    celsius = [one for one in _TEMPERATURES if between[0] <= one <= between[1]]

    def compute_line(v: Values) -> np.ndarray:
        slope, offset = np.polyfit(pressures, compute_torque(v, pressures, SPEED, _REFERENCE), 1)
        return np.array([slope, offset, -offset / slope, slope / (RADIUS * area * BAR * CONTACTS)])

    def compute_temperature_law(v: Values) -> np.ndarray:
        warm = np.array([compute_torque(v, middle, SPEED, one)[0] for one in celsius])
        return np.asarray(compute_line(v)[3] * warm / compute_torque(v, middle, SPEED, _REFERENCE)[0])

    def compute_lag(v: Values) -> np.ndarray:
        beta = compute_maps(v, middle)[2]
        return np.asarray(
            1e3 * (1.0 + (beta - 1.0) * np.exp(-v["clutch.stribeck_speed"] / SPEED)) / v["clutch.attraction"]
        )

    def fill(v: Values) -> np.ndarray:
        return np.array([1e6 * area * v["piston.clearance"], 1e3 * _fill_time(v, clutch, regulator)])

    quantities: list[Quantity] = []

    def add(where: str, function: Callable[[Values], np.ndarray], labels: Sequence[tuple[str, str, str]]) -> None:
        with np.errstate(invalid="ignore", divide="ignore"):  # 0/0 for a clutch without torque at a pressure
            value, half = known(function)
        quantities.extend(
            Quantity(name, float(x), float(h), unit, where, at)
            for (name, unit, at), x, h in zip(labels, value.ravel(), half.ravel(), strict=True)
            if np.isfinite(x) and np.isfinite(h)
        )

    speed = f"200 rpm, {_REFERENCE:g} degC"
    add("Table 6.3", compute_line, [
        ("a_M", "Nm/bar", speed), ("b_M", "Nm", speed), ("p_contact of the line", "bar", speed),
        ("mu", "1", f"{speed}, {_GEOMETRY}"),
    ])  # fmt: skip
    add("Table 6.3", lambda v: np.array([v["piston.contact_pressure"]]), [("contact pressure", "bar", "plates touch")])
    units = (
        ("M_C", "Nm", "Table 6.4, fig 6.13"),
        ("C_v", "Nm/(rad/s)^gamma", "Table 6.4, fig 6.13"),
        ("beta", "1", "Table 6.5"),
    )
    for k, (name, unit, where) in enumerate(units):

        def compute_map(v: Values, k: int = k) -> np.ndarray:
            return np.asarray(compute_maps(v, maps)[k])

        labels = [f"{p:.3f} bar{', extrapolated' if p > highest else ''}" for p in maps]
        add(where, compute_map, [(name, unit, label) for label in labels])
    shape = [("V_S", "clutch.stribeck_speed", "rad/s"), ("gamma", "clutch.viscous_exponent", "1")]
    add("fig 6.12", lambda v: np.array([v[n] for _, n, _ in shape]), [(name, unit, "") for name, _, unit in shape])
    if celsius:
        add(
            "eq. 6.3, fig 6.8",
            compute_temperature_law,
            [("mu(T)", "1", f"{one:g} degC, {middle[0]:.3f} bar, {_GEOMETRY}") for one in celsius],
        )
    add("fig 6.14", lambda v: np.array([v["clutch.attraction"]]), [("C", "1/s", "")])
    add("fig 6.14", compute_lag, [("lag s_n/C", "ms", f"{middle[0]:.3f} bar, 200 rpm")])
    add("sec. 6.3", fill, [
        ("fill volume", "cm^3", f"for a clearance of {1e3 * known.values['piston.clearance']:g} mm"),
        ("fill time", "ms", f"0 to {middle[0]:.3f} bar, until the plates touch"),
    ])  # fmt: skip
    return quantities


def _fill_time(v: Values, clutch: ParameterSet, regulator: tuple[float, float]) -> float:
    """Simulate a fill of the empty cylinder to the middle pressure. Return the time [s] until the plates touch, _FILL if
    never."""
    # the differences of a hardly excited parameter may leave its bounds
    inside = {name: float(np.clip(value, *clutch[name].bounds)) for name, value in v.items() if name in clutch}
    rig = wet_clutch.Rig(clutch.with_values(inside))
    state = rig.make_rest_state(SPEED, _REFERENCE + ZERO_CELSIUS)
    demand, gain = v["piston.contact_pressure"] + MIDDLE, v["valve.gain"]
    clearance = v["piston.clearance"]
    limit = rig.record["motor_torque_limit"][0]
    before = 0.0
    for k in range(round(_FILL / _SAMPLE)):
        shown = float(state.y["sensed_pressure"][0]) / BAR
        volt = max(demand + regulator[0] * (demand - shown), 0.0) / gain  # the regulator integrates in contact only
        state = rig.advance(state, volt, SPEED, limit, _SAMPLE, _SUBSTEPS)
        position = float(state.y["position"][0])
        if position >= clearance:
            return _SAMPLE * (k + (clearance - before) / (position - before))
        before = position
    return _FILL


def as_covariance(half: np.ndarray, correlation: np.ndarray) -> np.ndarray:
    """Return the covariance (p, p) of parameters from half widths (p,) of 95 % intervals and correlation (p, p)."""
    return np.asarray(correlation * np.outer(half, half) / NORMAL_95**2)


def format_table(quantities: Sequence[Quantity]) -> list[str]:
    """Return the lines of a text table of the quantities, one line per operating point."""
    width, place = (
        max(len(text) for text in texts) for texts in ([q.name for q in quantities], [q.at for q in quantities])
    )
    lines = [f"{'quantity':<{width}}  {'value':>9}  {'+- 95 %':>8}  {'unit':<16}  {'at':<{place}}  of"]
    lines += [
        f"{q.name:<{width}}  {q.value:>9.5g}  {q.half:>8.2g}  {q.unit:<16}  {q.at:<{place}}  {q.where}"
        for q in quantities
    ]
    return lines
