"""Random runs of a healthy clutch in all states (slipping, sticking, locking, creeping, reversing), to test the controller.

`python -m tests.every_state --runs 10000` simulates many and prints the worst; test_every_state.py simulates some. With
`--presliding 2e-3` the plates deflect by 2e-3 rad before they slide. With `--spread 0.3` each run has another clutch, with
parameters that differ from the shipped ones by up to 30 %. The controller is calibrated to the clutch.
"""

import argparse
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from clutch_hil.bench.in_process import Played, play
from clutch_hil.identify.controller_values import derive_controller_values
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import Profile
from plant_sim.rigs import wet_clutch
from rt_controller.law.clutch_state import ClutchState
from rt_controller.loop.node import ControllerNode
from rt_controller.loop.parameter_sets import load_controller_parameters

# Allowed error of the torque estimate: the larger of the two, except for TRANSIENT after a zero crossing of the slip or a touch
ERROR, SHARE = 0.5, 0.05  # Nm, 1
TRANSIENT = 0.030  # s
CREEP = (0.05, 1.0)  # rad/s
SPEED, TORQUE = 25.0, 25.0  # rad/s, Nm: the span of the maps
LEVEL, OIL, RATES = (0.7, 1.3), (40.0, 140.0), (250, 1000)  # 1, degC, Hz
PRELOAD = (0.55, 0.85)  # of the contact pressure: 0.72 of the shipped clutch
# What differs from clutch to clutch; the maps follow the contact pressure (draw_clutch)
VARIED = (
    "valve.gain", "valve.frequency", "valve.damping", "hydraulics.conductance", "hydraulics.capacity",
    "piston.contact_pressure", "piston.clearance", "piston.stack_stiffness", "piston.damping",
    "clutch.coulomb_slope", "clutch.viscous_slope", "clutch.beta_inf", "clutch.beta_scale", "clutch.stribeck_speed",
    "clutch.viscous_exponent", "clutch.attraction", "oil.viscous_gain", "oil.heat_capacity", "oil.heat_transfer",
    "motor.inertia", "motor.proportional_gain", "motor.integral_gain",
)  # fmt: skip
NOMINAL = {name: parameter.value for name, parameter in wet_clutch.load_nominal().items()}


@dataclass(frozen=True)
class Life:
    """A random run: profile, and the clutch: friction level [1], oil temperature [degC], rate [Hz], changed plant values."""

    seed: int
    profile: Profile
    level: float
    celsius: float
    rate: int
    clutch: Mapping[str, float] = field(default_factory=dict)


class Verdict(NamedTuple):
    """Result of a random run.

    fault: number of the controller's fault. samples: judged samples. off: samples in which the error of the estimate is above
    the allowed one. excess: largest excess [Nm]. above: samples in which the estimate exceeds the torque that the plates can
    carry by more than 5 % and 0.5 Nm. voltage: largest change [V] of the valve command between two samples while the plates
    stick and the demand is constant.
    """

    fault: int
    samples: int
    off: int
    excess: float
    above: int
    voltage: float


def draw_clutch(seed: int, spread: float) -> dict[str, float]:
    """Return plant values of a random clutch, up to `spread` off the shipped ones. Its maps begin at its contact pressure."""
    random = np.random.default_rng([seed, 7])
    values = {name: NOMINAL[name] * (1.0 + random.uniform(-spread, spread)) for name in VARIED}
    values["clutch.beta_inf"] = min(values["clutch.beta_inf"], 1.0)
    contact = values["piston.contact_pressure"]
    values["piston.preload_pressure"] = contact * random.uniform(*PRELOAD)
    share = contact / NOMINAL["piston.contact_pressure"]
    values["clutch.beta_onset"] = share * NOMINAL["clutch.beta_onset"]
    for line in ("coulomb", "viscous"):
        slope = values[f"clutch.{line}_slope"] / NOMINAL[f"clutch.{line}_slope"]
        values[f"clutch.{line}_intercept"] = slope * share * NOMINAL[f"clutch.{line}_intercept"]
    return values


def draw_life(seed: int, spread: float = 0.0) -> Life:
    """Return a random run of the shipped clutch, or of one that differs from it by up to `spread`."""
    random = np.random.default_rng(seed)
    speed = random.uniform(-SPEED, SPEED)
    rows = [(0.0, 0.0, speed, 0.0), (0.3, 0.0, speed, 0.0)]
    time, torque = 0.3, 0.0
    for _ in range(random.integers(5, 10)):
        time += np.exp(random.uniform(np.log(0.1), np.log(2.0)))
        if torque == 0.0 or random.random() < 0.7:
            torque = random.uniform(0.5, TORQUE)
        what = random.choice(["rest", "turn", "creep", "slide", "slide", "keep"])
        if what == "rest":
            speed = 0.0
        elif what == "turn":
            speed = -speed
        elif what == "creep":
            speed = random.choice([-1.0, 1.0]) * np.exp(random.uniform(*np.log(CREEP)))
        elif what == "slide":
            speed = random.uniform(-SPEED, SPEED)
        rows.append((time, torque, speed, float(random.random() < 0.15)))
        if random.random() < 0.5:
            time += random.uniform(0.1, 1.5)
            rows.append((time, torque, speed, rows[-1][3]))
    rows += [(time + 0.3, 0.0, speed, 0.0), (time + 0.6, 0.0, speed, 0.0)]
    times, torques, speeds, locks = zip(*rows, strict=True)
    profile = Profile(f"life {seed}", times, torques, speeds, (0.0,) * len(rows), locks)
    level, celsius, rate = random.uniform(*LEVEL), random.uniform(*OIL), int(random.choice(RATES))
    return Life(seed, profile, level, celsius, rate, draw_clutch(seed, spread) if spread else {})


def play_life(life: Life, presliding: float = 0.0) -> Played:
    """Simulate a random run with plates that deflect by `presliding` [rad] before they slide; return the run."""
    changes = {
        **life.clutch, "friction_level.level": life.level, "oil.sump_temperature": life.celsius, "presliding.angle": presliding
    }  # fmt: skip
    plant = PlantNode(
        rate=life.rate, parameters=wet_clutch.load_nominal().with_values(changes), profile=life.profile, seed=life.seed + 1,
        temperature=life.celsius,
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as directory:
        calibrated = Path(directory) / "controller.toml"
        known = (
            derive_controller_values(NOMINAL | life.clutch, NOMINAL, load_controller_parameters())
            if life.clutch
            else {}
        )
        lines = [f"{name} = {value!r}" for name, (value, _) in known.items()]
        calibrated.write_text("\n".join([*lines, f'bending.angle = {{ value = {presliding}, unit = "rad" }}', ""]))
        controller = ControllerNode(rate=life.rate, parameters_file=calibrated)
    return play(plant, controller)


def judge_life(life: Life, run: Played) -> Verdict:
    """Judge the controller in the run of `life`."""
    true, estimate, slip = (
        run[name] for name in ("truth_clutch_torque_nm", "controller_torque_estimate_nm", "truth_slip_speed_rad_s")
    )
    settled = ~_find_after(np.diff(np.sign(slip)) != 0.0, life.rate)
    settled &= ~_find_after(np.diff(run["truth_normal_force_n"] > 0.0), life.rate)
    excess = np.where(settled, np.abs(estimate - true) - np.maximum(ERROR, SHARE * np.abs(true)), -np.inf)
    above = settled & (np.abs(estimate) > (1.0 + SHARE) * _compute_capacity(life, run) + ERROR)
    sticks = run["controller_clutch_state"] >= ClutchState.STICKING
    # the demand has been constant for long, because the acting command is one sample old
    asked = np.diff(run["controller_torque_demand_nm"]) != 0.0
    asked |= np.diff(run["controller_phase"]) != 0.0
    held = sticks & ~_find_after(asked | (np.diff(sticks.astype(int)) != 0), life.rate)
    voltage = np.abs(np.diff(run["valve_voltage_v"]))[held[1:]]
    return Verdict(
        int(run["controller_fault"].max()), int(settled.sum()), int((excess > 0.0).sum()), float(excess.max()),
        int(above.sum()), float(voltage.max(initial=0.0)),
    )  # fmt: skip


def _find_after(events: np.ndarray, rate: int) -> np.ndarray:
    """Return which samples are within TRANSIENT after the one before an event, shape (n + 1,)."""
    span = round(TRANSIENT * rate) + 2
    marked = np.concatenate([events, [False]]).astype(float)
    return np.convolve(marked, np.ones(span))[: len(marked)] > 0.0


def _compute_capacity(life: Life, run: Played) -> np.ndarray:
    """Return the torque [Nm] that the plates can carry at their pressure: the present one, or level M_C of Table 6.4."""
    true = np.abs(run["truth_clutch_torque_nm"])
    force = run["truth_normal_force_n"]
    values = NOMINAL | life.clutch
    pressure = values["piston.contact_pressure"] + force / (values["piston.area"] * 1e5)  # bar: docs/rig.md, 4
    level = values["clutch.coulomb_slope"] * pressure + values["clutch.coulomb_intercept"]
    return np.maximum(true, np.where(force > 0.0, life.level * np.maximum(level, 0.0), 0.0))


def main() -> None:
    """Simulate random runs and print the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--presliding", type=float, default=0.0, help="angle by which the plates bend [rad]; 0: rigid")
    parser.add_argument(
        "--spread", type=float, default=0.0, help="share by which each clutch may be off the shipped one"
    )
    arguments = parser.parse_args()
    verdicts = {}
    for seed in range(arguments.first, arguments.first + arguments.runs):
        life = draw_life(seed, arguments.spread)
        verdicts[seed] = judge_life(life, play_life(life, arguments.presliding))
        if len(verdicts) % 500 == 0:
            print(f"{len(verdicts)} of {arguments.runs}", flush=True)
    faults = [seed for seed, verdict in verdicts.items() if verdict.fault]
    samples, off = (sum(getattr(v, name) for v in verdicts.values()) for name in ("samples", "off"))
    runs = sum(v.off > 0 for v in verdicts.values())
    worst = max(verdicts, key=lambda seed: verdicts[seed].excess)
    print(f"lives {len(verdicts)}, faults {len(faults)} {faults[:10]}")
    print(f"estimate off by more than is allowed: {off} of {samples} samples ({off / samples:.2e}), in {runs} lives")
    print(f"the most beyond what is allowed: {verdicts[worst].excess:.2f} Nm (life {worst})")
    print(f"above what the plates can carry: {sum(v.above for v in verdicts.values())} samples")
    print(f"valve command between two samples in stick: at most {max(v.voltage for v in verdicts.values()):.3f} V")


if __name__ == "__main__":
    main()
