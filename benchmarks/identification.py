"""Identification of rigs drawn at random: errors, intervals, time. `python -m benchmarks.identification`.

The truth is the rig of the battery (benchmarks/battery/truth_simulation.py). It shares no code with the plant. Its
parameters DRAWN vary by +-30 %. Each rig plays the courses of `clutch-hil experiment identify`, with the noise of docs/rig.md:
first the slow staircase, whose torque shows the contact pressure from which the other five are laid out. With `--hidden` the
rig has offsets of its sensors, drag and a delay of its valve as well (Hidden).
"""

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic

import numpy as np

from benchmarks.battery.truth_rig import BAR, RIG_RECORD, ZERO_CELSIUS, draw_rig
from benchmarks.battery.truth_simulation import COLUMNS, PERIOD, PRESSURE, HiddenEffects, Inputs, simulate
from benchmarks.identified_loop import Loop, follow_torque
from benchmarks.pressure_loop import find_bandwidth
from clutch_hil.identify.calibration import Identified
from clutch_hil.identify.clutch_effects import EFFECTS, estimate_line
from clutch_hil.identify.courses.clutch_courses import COURSES, SCALE, TORQUE_SHARE, Span
from clutch_hil.identify.identification import Identification, identify_clutch
from plant_sim.rigs import wet_clutch
from protocols.files.run import Run

DEMAND = "controller_pressure_demand_bar"  # p_d, column name in runs of the bench
REGULATOR_GAIN = 2.5  # bar/V, valve gain assumed by the truth's regulator: docs/rig.md
SPREAD = 0.3  # +-, relative, of every parameter
SUMP = 15.0  # K, +-, of the oil sump
DRAWN = (
    "valve_gain", "valve_frequency", "valve_damping", "hydraulics_conductance", "hydraulics_capacity",
    "piston_contact_pressure", "piston_preload_pressure", "piston_clearance", "piston_stack_stiffness", "piston_damping",
    "clutch_coulomb_slope",
    "clutch_viscous_slope", "clutch_beta_inf", "clutch_beta_scale", "clutch_stribeck_speed", "clutch_viscous_exponent",
    "clutch_attraction", "oil_viscous_gain", "oil_heat_capacity", "oil_heat_transfer", "motor_inertia",
    "motor_proportional_gain", "motor_integral_gain",
)  # fmt: skip
_NOISE = np.array([500.0, 0.1, 0.05, 0.05])  # Pa, K, Nm, Nm: docs/rig.md, 9
_LEAST_SPRINGS = 0.3 * BAR  # Pa between preload and contact: the springs must be compressed
_UNITS = {
    "bar": BAR,
    "bar/V": BAR,
    "m^3/(s bar)": 1 / BAR,
    "m^3/bar": 1 / BAR,
    "Nm/bar": 1 / BAR,
    "Nm/(bar (rad/s)^gamma)": 1 / BAR,
}


def draw(seed: int, spread: float = SPREAD, drawn: Sequence[str] = DRAWN, sump: float = SUMP) -> np.ndarray:
    """Return a rig's record (1,), SI: parameters `drawn` off by at most `spread`, sump temperature by at most `sump` [K].

    The zeros of the torque lines and p_1 lie at the contact pressure within 1 %, as in the thesis.
    """
    random, rig, nominal = np.random.default_rng([seed, 31]), draw_rig(), draw_rig()
    for name in drawn:
        rig[name] = nominal[name] * (1.0 + spread * random.uniform(-1.0, 1.0))
    rig["clutch_beta_inf"] = min(float(rig["clutch_beta_inf"][0]), 0.95)
    contact = float(rig["piston_contact_pressure"][0])
    rig["piston_preload_pressure"] = min(float(rig["piston_preload_pressure"][0]), contact - _LEAST_SPRINGS)
    for name in ("coulomb", "viscous"):
        zero = (
            -nominal[f"clutch_{name}_intercept"] / nominal[f"clutch_{name}_slope"] / nominal["piston_contact_pressure"]
        )
        rig[f"clutch_{name}_intercept"] = (
            -rig[f"clutch_{name}_slope"] * contact * zero * (1.0 + 0.01 * random.uniform(-1.0, 1.0))
        )
    above = nominal["clutch_beta_onset"] - nominal["piston_contact_pressure"]
    rig["clutch_beta_onset"] = contact + above * (1.0 + spread * random.uniform(-1.0, 1.0))
    rig["oil_sump_temperature"] = ZERO_CELSIUS + 70.0 + random.uniform(-sump, sump)
    rig["piston_preload"] = rig["piston_area"] * rig["piston_preload_pressure"]
    rig["piston_spring_stiffness"] = (
        rig["piston_area"] * (contact - rig["piston_preload_pressure"]) / rig["piston_clearance"]
    )
    return rig


@dataclass(frozen=True)
class Hidden:
    """Hidden effects of a rig: offsets [bar, Nm, rad/s], drag [Nm s/rad] and the delay of its valve [ms]."""

    pressure: float = 0.0
    torque: float = 0.0
    motor: float = 0.0
    speed: float = 0.0
    drive: float = 0.0
    drag: float = 0.0
    delay: float = 0.0

    @classmethod
    def draw(cls, seed: int) -> "Hidden":
        """Return the offsets within +-0.05 bar, +-1 Nm and +-0.3 rad/s, drag of 5 to 20 mNm s/rad, a delay of 1 to 6 ms."""
        r = np.random.default_rng([seed, 310])
        pressure, torque, motor, speed, drive = r.uniform(-1.0, 1.0, 5) * (0.05, 1.0, 1.0, 0.3, 0.3)
        return cls(pressure, torque, motor, speed, drive, r.uniform(5e-3, 20e-3), r.uniform(1.0, 6.0))

    @property
    def effects(self) -> HiddenEffects:
        """Drag and delay, by laws that the catalogue also has."""
        strengths = {"drag_torque": self.drag, "valve_delay": 1e-3 * self.delay}
        return HiddenEffects({n: s for n, s in strengths.items() if s > 0.0}, laws=dict.fromkeys(strengths, 2))

    @property
    def noise(self) -> np.ndarray:
        """Offsets (4,) of pressure [Pa], temperature, motor and clutch torque [Nm], added to the noise, before rounding."""
        return np.array([BAR * self.pressure, 0.0, self.motor, self.torque])

    def list_strengths(self) -> dict[str, float]:
        """Return the strengths of the catalogue's effects, by dotted name."""
        values = (self.pressure, self.torque, self.motor, self.speed, self.drive, self.delay, self.drag)
        return dict(zip(EFFECTS, values, strict=True))


def play(rig: np.ndarray, seed: int, hidden: Hidden = Hidden(), *, names: Sequence[str] = tuple(COURSES)) -> list[Run]:
    """Return the runs of the courses `names`, 1 kHz, laid out from the contact pressure measured in a staircase.

    The pressure regulator then uses this pressure: below it, it does not integrate.
    """
    nominal = wet_clutch.load_nominal()["piston.contact_pressure"].value
    first = record_course(rig, np.array(SCALE[0](Span(nominal)).rows), SCALE[1], nominal, [seed, 99, 31], hidden)
    line = estimate_line([first.columns])
    assert line is not None
    span = Span.of_line(*line, TORQUE_SHARE * float(rig["motor_torque_limit"][0]))
    return [
        record_course(rig, np.array(make(span).rows), celsius, span.contact, [seed, number, 31], hidden)
        for number, (make, celsius) in enumerate(COURSES[name] for name in names)
    ]


def record_course(
    rig: np.ndarray, rows: np.ndarray, celsius: float, contact: float, seed: list[int], hidden: Hidden,
    gain: float = REGULATOR_GAIN,
) -> Run:  # fmt: skip
    """Return a course as measured on the rig. rows (n, 4): of its profile, as `Course.rows`.

    contact [bar] and gain of the valve [bar/V]: those that the regulator assumes.
    """
    time = PERIOD * np.arange(int(rows[-1, 0] / PERIOD))
    pressure, speed = (np.interp(time, rows[:, 0], rows[:, k]) for k in (3, 2))
    noise = _NOISE * np.random.default_rng(seed).standard_normal((len(time), 4)) + hidden.noise
    held = speed - hidden.drive  # the motor begins at the demanded speed, and then holds a different one
    held[0] = speed[0]
    inputs = Inputs("", PRESSURE, pressure, held, celsius, np.zeros(len(time)), contact)
    # The regulator of the truth divides by its gain: another one is a scale of the voltage
    scale, scaled = REGULATOR_GAIN / gain, rig.copy()
    scaled["valve_gain"] *= scale
    shown = simulate(inputs, hidden.effects, plant=scaled, noise=noise)
    columns = {
        "time_s": time, "valve_voltage_v": scale * shown.voltage, "motor_speed_demand_rad_s": speed,
        DEMAND: pressure, **{name: shown[name].copy() for name in COLUMNS},
    }  # fmt: skip
    columns["slip_speed_rad_s"] += hidden.speed
    columns["shaft_angle_rad"] += hidden.speed * time
    return Run(columns, {"rig": "wet_clutch"}, {})


def list_true_values(rig: np.ndarray) -> dict[str, float]:
    """Return the true parameters in the plant's units, relative to its declared clearance.

    Pressures and torques contain no information on volume.
    """
    values = {}
    for name, p in wet_clutch.load_nominal().items():
        if (key := name.replace(".", "_", 1)) in RIG_RECORD.names:
            values[name] = float(rig[key][0]) / _UNITS.get(p.unit, 1.0) - (ZERO_CELSIUS if p.unit == "degC" else 0.0)
    scale = wet_clutch.load_nominal()["piston.clearance"].value / values["piston.clearance"]
    for name in ("hydraulics.conductance", "hydraulics.capacity", "piston.clearance"):
        values[name] *= scale
    for name in ("piston.damping", "piston.stack_stiffness"):
        values[name] /= scale
    return values


def compute_maps_error(identified: dict[str, float], true: dict[str, float]) -> dict[str, float]:
    """Return the largest relative error of M_C, C_v and beta from 0.35 to 1.85 bar above contact, the range of the maps."""
    p = true["piston.contact_pressure"] + np.linspace(0.35, 1.85, 50)

    def compute_maps(v: dict[str, float]) -> dict[str, np.ndarray]:
        beta = v["clutch.beta_inf"] + (1.0 - v["clutch.beta_inf"]) * np.exp(
            -(p - v["clutch.beta_onset"]) / v["clutch.beta_scale"]
        )
        return {
            "M_C": v["clutch.coulomb_slope"] * p + v["clutch.coulomb_intercept"],
            "C_v": v["clutch.viscous_slope"] * p + v["clutch.viscous_intercept"],
            "beta": np.minimum(1.0, beta),
        }  # fmt: skip

    ours, theirs = compute_maps(identified), compute_maps(true)
    return {name: float(np.max(np.abs(ours[name] / theirs[name] - 1.0))) for name in ours}


def list_values(identification: Identification, declared: dict[str, float]) -> dict[str, float]:
    """Return every parameter of the plant: the identified ones, and the declared others."""
    return {**declared, **{p.name: p.value for p in identification.calibration.parameters}}


def split_effects(identification: Identification) -> tuple[list[Identified], list[Identified]]:
    """Return the parameters of the rig, and offsets, drag and delay, including absent ones."""
    own = [p for p in identification.calibration.parameters if p.name not in EFFECTS]
    return own, [
        *(p for p in identification.calibration.parameters if p.name in EFFECTS),
        *identification.calibration.absent,
    ]


def main(options: list[str]) -> int:
    """Identify rigs; print a line for each, and a summary."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.identification", description=__doc__.partition("\n")[0])
    parser.add_argument("--rigs", type=int, default=50, help="number of rigs, 1 or more")
    parser.add_argument("--first", type=int, default=1, help="seed of the first one")
    parser.add_argument("--hidden", action="store_true", help="with offsets, drag and a delay of the valve")
    parser.add_argument(
        "--closed-loop", action="store_true", help="also follow the torque of Table 6.6 with each calibration"
    )
    given = parser.parse_args(options)
    if given.rigs < 1 or given.first < 0:
        parser.error(f"--rigs {given.rigs} and --first {given.first}: allowed are 1 or more, and 0 or more")
    declared = {name: p.value for name, p in wet_clutch.load_nominal().items()}
    inside: list[bool] = []
    hidden_inside: list[bool] = []
    errors, seconds = [], []
    loops: list[Loop] = []
    for seed in range(given.first, given.first + given.rigs):
        rig = draw(seed)
        hidden = Hidden.draw(seed) if given.hidden else Hidden()
        true, runs, begin = list_true_values(rig), play(rig, seed, hidden), monotonic()
        identification = identify_clutch(runs)
        seconds.append(monotonic() - begin)
        own, effects = split_effects(identification)
        holding = [p.interval[0] <= true[p.name] <= p.interval[1] for p in own]
        inside += holding
        strengths = hidden.list_strengths()
        off = [p for p in effects if not p.interval[0] <= strengths[p.name] <= p.interval[1]]
        hidden_inside += [p not in off for p in effects]
        values = list_values(identification, declared)
        relative = {
            name: abs(values[name] / true[name] - 1.0)
            for name in ("clutch.stribeck_speed", "clutch.viscous_exponent", "clutch.attraction", "motor.inertia")
        }
        found_bandwidth = identification.response.pressure.bandwidth if identification.response else None
        bandwidth = abs((found_bandwidth or 0.0) - find_bandwidth(rig, 1e-3 * hidden.delay))
        contact = 1e3 * abs(values["piston.contact_pressure"] - true["piston.contact_pressure"])
        errors.append(
            {**compute_maps_error(values, true), **relative, "contact [mbar]": contact, "bandwidth [Hz]": bandwidth}
        )
        print(
            f"rig {seed}: {seconds[-1]:.0f} s, {identification}; {', '.join(f'{n} {e:.2g}' for n, e in errors[-1].items())};"
            f" {sum(holding)} of {len(holding)} intervals hold the truth",
            flush=True,
        )
        for p in off:
            print(f"  {p.name}: {p.value:.4g} +- {p.half:.2g} {p.unit}, truth {strengths[p.name]:.4g}")
        if given.closed_loop:
            loops.append(_follow(identification, true))
            print(f"rig {seed}: closed loop: {loops[-1]}", flush=True)
    for name in errors[0]:
        print(f"largest error of {name}: {max(e[name] for e in errors):.3g}")
    print(f"intervals that hold the truth: {np.mean(inside):.1%} of {len(inside)}")
    print(
        f"intervals of offsets, drag and delay that hold the truth: {np.mean(hidden_inside):.1%} of {len(hidden_inside)}"
    )
    print(f"seconds: median {np.median(seconds):.0f}, most {max(seconds):.0f}")
    if loops:
        print(
            f"closed loop: largest error over that of a controller that knows the rig: {max(one.ratio for one in loops):.3f}"
        )
        faults = Counter(one.shipped.fault for one in loops)
        print(f"shipped calibration: {dict(faults)}; {sum(one.is_told for one in loops)} of {len(loops)} good or told")
    return 0


def _follow(identification: Identification, true: dict[str, float]) -> Loop:
    """Return the closed loop with an identified calibration on its rig."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "calibration.toml"
        identification.calibration.write(path)
        return follow_torque(true, path)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
