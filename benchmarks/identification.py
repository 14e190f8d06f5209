"""Identification of rigs drawn at random: errors, intervals, time. `python -m benchmarks.identification`.

The truth is the rig of the battery (benchmarks/battery/truth_simulation.py). It shares no code with the plant. Its DRAWN
vary by +-30 %. Each rig plays the five courses of `clutch-hil experiment identify`, with the noise of docs/rig.md.
"""

import argparse
import sys
from collections.abc import Sequence
from time import monotonic

import numpy as np

from benchmarks.battery.truth_rig import BAR, RIG_RECORD, ZERO_CELSIUS, draw_rig
from benchmarks.battery.truth_simulation import COLUMNS, PERIOD, PRESSURE, Inputs, simulate
from clutch_hil.identify.courses import COURSES, TORQUE_SHARE, Span
from clutch_hil.identify.identification import Identification, identify_clutch
from plant_sim.rigs import wet_clutch
from protocols.files.run import Run

SPREAD = 0.3  # of every parameter, either way
SUMP = 15.0  # K, of the oil's sump, either way
DRAWN = (
    "valve_gain", "valve_frequency", "valve_damping", "hydraulics_conductance", "hydraulics_capacity",
    "piston_contact_pressure", "piston_preload_pressure", "piston_clearance", "piston_stack_stiffness", "piston_damping",
    "clutch_coulomb_slope",
    "clutch_viscous_slope", "clutch_beta_inf", "clutch_beta_scale", "clutch_stribeck_speed", "clutch_viscous_exponent",
    "clutch_attraction", "oil_viscous_gain", "oil_heat_capacity", "oil_heat_transfer", "motor_inertia",
    "motor_proportional_gain", "motor_integral_gain",
)  # fmt: skip
_NOISE = np.array([500.0, 0.1, 0.05, 0.05])  # Pa, K, Nm, Nm: docs/rig.md, 9
_LEAST_SPRINGS = 0.3 * BAR  # Pa between preload and contact: springs that are pressed together at all
_UNITS = {
    "bar": BAR,
    "bar/V": BAR,
    "m^3/(s bar)": 1 / BAR,
    "m^3/bar": 1 / BAR,
    "Nm/bar": 1 / BAR,
    "Nm/(bar (rad/s)^gamma)": 1 / BAR,
}


def draw(seed: int, spread: float = SPREAD, drawn: Sequence[str] = DRAWN, sump: float = SUMP) -> np.ndarray:
    """A rig's record (1,), SI, whose parameters `drawn` are off by at most `spread`, and its sump [K] by `sump`.

    Zeros of the torque lines and p_1 lie at the contact pressure as the thesis's do, within 1 %.
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


def play(rig: np.ndarray, seed: int, names: Sequence[str] = tuple(COURSES)) -> list[Run]:
    """The runs of the courses `names`, 1 kHz."""
    slope = (
        float(
            rig["clutch_coulomb_slope"][0] + rig["clutch_viscous_slope"][0] * 20.94 ** rig["clutch_viscous_exponent"][0]
        )
        * BAR
    )
    limit = float(rig["motor_torque_limit"][0])
    span = Span.of_line(slope, float(rig["piston_contact_pressure"][0]) / BAR, TORQUE_SHARE * limit)
    runs = []
    for number, (make, celsius) in enumerate(COURSES[name] for name in names):
        rows = np.array(make(span).rows)
        time = PERIOD * np.arange(int(rows[-1, 0] / PERIOD))
        pressure, speed = (np.interp(time, rows[:, 0], rows[:, k]) for k in (3, 2))
        noise = _NOISE * np.random.default_rng([seed, number, 31]).standard_normal((len(time), 4))
        shown = simulate(Inputs("", PRESSURE, pressure, speed, celsius, np.zeros(len(time))), plant=rig, noise=noise)
        columns = {
            "time_s": time, "valve_voltage_v": shown.voltage, "motor_speed_demand_rad_s": speed,
            **{name: shown[name].copy() for name in COLUMNS},
        }  # fmt: skip
        runs.append(Run(columns, {"rig": "wet_clutch"}, {}))
    return runs


def true_values(rig: np.ndarray) -> dict[str, float]:
    """The drawn parameters in the plant's units, relative to its declared clearance: pressures and torques tell no volume."""
    values = {}
    for name, p in wet_clutch.nominal().items():
        if (key := name.replace(".", "_", 1)) in RIG_RECORD.names:
            values[name] = float(rig[key][0]) / _UNITS.get(p.unit, 1.0) - (ZERO_CELSIUS if p.unit == "degC" else 0.0)
    scale = wet_clutch.nominal()["piston.clearance"].value / values["piston.clearance"]
    for name in ("hydraulics.conductance", "hydraulics.capacity", "piston.clearance"):
        values[name] *= scale
    for name in ("piston.damping", "piston.stack_stiffness"):
        values[name] /= scale
    return values


def maps_error(found: dict[str, float], true: dict[str, float]) -> dict[str, float]:
    """Largest relative error of M_C, C_v and beta from 0.35 to 1.85 bar above contact, the range of the maps."""
    p = true["piston.contact_pressure"] + np.linspace(0.35, 1.85, 50)

    def maps(v: dict[str, float]) -> dict[str, np.ndarray]:
        beta = v["clutch.beta_inf"] + (1.0 - v["clutch.beta_inf"]) * np.exp(
            -(p - v["clutch.beta_onset"]) / v["clutch.beta_scale"]
        )
        return {
            "M_C": v["clutch.coulomb_slope"] * p + v["clutch.coulomb_intercept"],
            "C_v": v["clutch.viscous_slope"] * p + v["clutch.viscous_intercept"],
            "beta": np.minimum(1.0, beta),
        }  # fmt: skip

    ours, theirs = maps(found), maps(true)
    return {name: float(np.max(np.abs(ours[name] / theirs[name] - 1.0))) for name in ours}


def values_of(found: Identification, declared: dict[str, float]) -> dict[str, float]:
    """Every parameter of the plant: the identified ones, and the declared others."""
    return {**declared, **{p.name: p.value for p in found.calibration.parameters}}


def main(options: list[str]) -> int:
    """Identify rigs, a line each, and the summary."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.identification", description=__doc__.partition("\n")[0])
    parser.add_argument("--rigs", type=int, default=50, help="number of rigs, 1 or more")
    parser.add_argument("--first", type=int, default=1, help="seed of the first one")
    given = parser.parse_args(options)
    if given.rigs < 1 or given.first < 0:
        parser.error(f"--rigs {given.rigs} and --first {given.first}: allowed are 1 or more, and 0 or more")
    declared = {name: p.value for name, p in wet_clutch.nominal().items()}
    inside, errors, seconds = [], [], []
    for seed in range(given.first, given.first + given.rigs):
        rig = draw(seed)
        true, runs, begin = true_values(rig), play(rig, seed), monotonic()
        found = identify_clutch(runs)
        seconds.append(monotonic() - begin)
        inside += [p.interval[0] <= true[p.name] <= p.interval[1] for p in found.calibration.parameters]
        values = values_of(found, declared)
        relative = {
            name: abs(values[name] / true[name] - 1.0)
            for name in ("clutch.stribeck_speed", "clutch.viscous_exponent", "clutch.attraction", "motor.inertia")
        }
        contact = 1e3 * abs(values["piston.contact_pressure"] - true["piston.contact_pressure"])
        errors.append({**maps_error(values, true), **relative, "contact [mbar]": contact})
        print(
            f"rig {seed}: {seconds[-1]:.0f} s, {found}; {', '.join(f'{n} {e:.2g}' for n, e in errors[-1].items())}",
            flush=True,
        )
    for name in errors[0]:
        print(f"largest error of {name}: {max(e[name] for e in errors):.3g}")
    print(f"intervals that hold the truth: {np.mean(inside):.1%} of {len(inside)}")
    print(f"seconds: median {np.median(seconds):.0f}, most {max(seconds):.0f}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
