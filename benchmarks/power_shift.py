"""Identification of power-shift rigs drawn at random: errors, intervals, hand-over. `python -m benchmarks.power_shift`.

The truth is benchmarks/shift_truth.py, which shares no code with the plant or the fit. Clutch a, clutch b, motor, vehicle and
road vary by +-30 % (benchmarks/identification.py has the parameters of a clutch), the grade by 0.02. Each rig plays the courses
of clutch_hil/identify/courses/shift_courses.py, with the noise of docs/rig.md: first the slow staircase of both clutches. With
`--hidden` each clutch has offsets of its pressure and torque sensors, drag and a delay of its valve as well.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, process_time

import numpy as np

from benchmarks import shift_loop
from benchmarks.battery.truth_simulation import PERIOD
from benchmarks.identification import SPREAD, Hidden, compute_maps_error, draw, list_true_values
from benchmarks.shift_truth import make_road_record, simulate
from clutch_hil.identify.clutch_effects import DELAY, DRAG, PRESSURE, TORQUE
from clutch_hil.identify.courses.clutch_courses import TORQUE_SHARE, Span
from clutch_hil.identify.courses.shift_courses import COURSES, SCALE, ShiftCourse, Spans
from clutch_hil.identify.two_clutches.power_shift import ShiftIdentification, estimate_clutch_line, identify_power_shift
from plant_sim.rigs import power_shift, wet_clutch
from protocols.files.run import Run

_NOISE = np.array([500.0, 0.1, 0.05, 0.05])  # Pa, K, Nm, Nm: docs/rig.md, 9
_GRADE = 0.02  # +-: two stated uncertainties
_EFFECTS = (PRESSURE, TORQUE, DELAY, DRAG)  # of a clutch, by the catalogue's names
_DRIVEN = ("vehicle_inertia", "rolling_resistance", "drag_area")


@dataclass(frozen=True)
class TrueShift:
    """A power-shift rig: records of clutch a and b and the shafts, values of the driveline by dotted name, hidden effects."""

    clutches: tuple[np.ndarray, np.ndarray]
    road: np.ndarray
    driveline: dict[str, float]
    hidden: tuple[Hidden, Hidden] = (Hidden(), Hidden())

    @classmethod
    def draw(cls, seed: int, hidden: bool = False) -> "TrueShift":
        """Return rig number `seed`; `hidden`: with offsets, drag and delays."""
        random = np.random.default_rng([seed, 3131])
        one, two = draw(2 * seed), draw(2 * seed + 1)
        for name in ("inertia", "proportional_gain", "integral_gain"):
            two[f"motor_{name}"] = one[f"motor_{name}"]
        nominal = power_shift.load_nominal()
        values = {
            f"driveline.{n}": nominal[f"driveline.{n}"].value * (1.0 + SPREAD * random.uniform(-1.0, 1.0))
            for n in _DRIVEN
        }
        values["driveline.grade"] = _GRADE * random.uniform(-1.0, 1.0)
        ratios, radius = (3.0, 2.0), nominal["driveline.wheel_radius"].value
        road = make_road_record(
            one, ratios, values["driveline.vehicle_inertia"], radius, values["driveline.rolling_resistance"],
            values["driveline.drag_area"], values["driveline.grade"],
        )  # fmt: skip
        of_clutches = (Hidden.draw(2 * seed), Hidden.draw(2 * seed + 1)) if hidden else (Hidden(), Hidden())
        return cls((one, two), road, values, of_clutches)

    @property
    def ratios(self) -> tuple[float, float]:
        """Gear ratios of a and b."""
        return float(self.road["ratio_a"][0]), float(self.road["ratio_b"][0])

    @property
    def values(self) -> dict[str, float]:
        """Parameters of the plant by dotted name, relative to its declared clearance."""
        values = dict(self.driveline)
        for clutch, rig, hidden in zip("ab", self.clutches, self.hidden, strict=True):
            own = {n: v for n, v in list_true_values(rig).items() if not n.startswith("sensors.")}
            strengths = hidden.list_strengths()
            own |= {n: strengths[n] for n in _EFFECTS if strengths[n] != 0.0}
            values |= {n: v for n, v in own.items() if n.startswith("motor.")} if clutch == "a" else {}
            values |= {f"{clutch}.{n}": v for n, v in own.items() if not n.startswith("motor.")}
        return values


def play(rig: TrueShift, seed: int, names: Sequence[str] = tuple(COURSES)) -> list[Run]:
    """Return the runs of the courses `names`, 1 kHz, laid out from the contact pressures measured in staircases."""
    first = play_scale(rig, seed)
    limit = TORQUE_SHARE * float(rig.road["limit"][0])
    spans = Spans({c: Span.of_line(*estimate_clutch_line(first.columns, c), limit) for c in "ab"}, rig.ratios)
    return [
        _record(rig, make(spans), celsius, spans, [seed, number, 313])
        for number, (make, celsius) in enumerate(COURSES[name] for name in names)
    ]


def play_scale(rig: TrueShift, seed: int) -> Run:
    """Return the slow staircases, laid out from the nominal contact pressure."""
    nominal = wet_clutch.load_nominal()["piston.contact_pressure"].value
    begin = Spans({clutch: Span(nominal) for clutch in "ab"}, rig.ratios)
    return _record(rig, SCALE[0](begin), SCALE[1], begin, [seed, 99, 313])


def _record(rig: TrueShift, course: ShiftCourse, celsius: float, spans: Spans, seed: list[int]) -> Run:
    """Return a course as measured on the rig."""
    rows = np.array(course.rows)
    time = PERIOD * np.arange(int(rows[-1, 0] / PERIOD))
    speed, *pressures = (np.interp(time, rows[:, 0], rows[:, k]) for k in (3, 4, 5))
    noise = _NOISE * np.random.default_rng(seed).standard_normal((2, len(time), 4))
    noise += np.array([replace(hidden, motor=0.0).noise for hidden in rig.hidden])[:, np.newaxis]
    contacts = np.array([span.contact for span in spans.of.values()])
    one, two = rig.hidden
    shown = simulate(
        np.array(pressures), speed, contacts, celsius, rig.clutches, rig.road, noise, (one.effects, two.effects)
    )
    return Run(shown.make_columns(time, speed), {"rig": "power_shift"}, {})


def compute_errors(identification: ShiftIdentification, true: dict[str, float]) -> dict[str, float]:
    """Return the errors of both clutches and the driveline, as the issue defines them for one clutch.

    For the clutches, the worse one counts.
    """
    values = dict(identification.propagation.values)
    errors: dict[str, float] = {}
    for clutch in "ab":
        ours, theirs = (
            {n.removeprefix(f"{clutch}."): v for n, v in one.items() if n.startswith(f"{clutch}.")}
            for one in (values, true)
        )
        own = compute_maps_error(ours, theirs)
        own |= {
            n: abs(ours[n] / theirs[n] - 1.0)
            for n in ("clutch.stribeck_speed", "clutch.viscous_exponent", "clutch.attraction")
        }
        own["contact [mbar]"] = 1e3 * abs(ours["piston.contact_pressure"] - theirs["piston.contact_pressure"])
        errors |= {name: max(error, errors.get(name, 0.0)) for name, error in own.items()}
    for name in ("motor.inertia", "driveline.vehicle_inertia", "driveline.rolling_resistance", "driveline.drag_area"):
        errors[name] = abs(values[name] / true[name] - 1.0)
    errors["driveline.grade [1]"] = abs(values["driveline.grade"] - true["driveline.grade"])
    return errors


def list_outside(identification: ShiftIdentification, true: dict[str, float]) -> tuple[int, list[str]]:
    """Return the number of intervals, and those that do not contain the truth; an absent effect has the true value 0."""
    outside, count = [], 0
    for p in [*identification.calibration.parameters, *identification.calibration.absent]:
        truth = true.get(p.name, 0.0)
        count += 1
        if not p.interval[0] <= truth <= p.interval[1]:
            outside.append(f"{p.name}: {p.value:.5g} +- {p.half:.2g} {p.unit}, truth {truth:.5g}")
    return count, outside


def main(options: list[str]) -> int:
    """Identify rigs; print a line for each, and a summary."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.power_shift", description=__doc__.partition("\n")[0])
    parser.add_argument("--rigs", type=int, default=10, help="number of rigs, 1 or more")
    parser.add_argument("--first", type=int, default=1, help="number of the first one")
    parser.add_argument("--closed-loop", action="store_true", help="also hand the torque over with each calibration")
    parser.add_argument("--hidden", action="store_true", help="with offsets, drag and a delay of each clutch")
    given = parser.parse_args(options)
    if given.rigs < 1 or given.first < 0:
        parser.error(f"--rigs {given.rigs} and --first {given.first}: allowed are 1 or more, and 0 or more")
    errors, counts, missed, seconds = [], 0, 0, []
    loops = []
    for seed in range(given.first, given.first + given.rigs):
        rig = TrueShift.draw(seed, given.hidden)
        runs, begin, cpu = play(rig, seed), monotonic(), process_time()
        identification = identify_power_shift(runs)
        seconds.append(process_time() - cpu)
        true = rig.values
        errors.append(compute_errors(identification, true))
        count, outside = list_outside(identification, true)
        counts, missed = counts + count, missed + len(outside)
        print(
            f"rig {seed}: {monotonic() - begin:.0f} s, {seconds[-1]:.0f} s of CPU, {identification};"
            f" {', '.join(f'{n} {e:.2g}' for n, e in errors[-1].items())}; {len(outside)} of {count} outside",
            flush=True,
        )
        print("".join(f"  {line}\n" for line in outside), end="", flush=True)
        if given.closed_loop:
            with TemporaryDirectory() as folder:
                path = Path(folder) / "calibration.toml"
                identification.calibration.write(path)
                loops.append(shift_loop.play_hand_over(true, path))
            print(f"rig {seed}: hand-over: {loops[-1]}", flush=True)
    for name in errors[0]:
        print(f"largest error of {name}: {max(e[name] for e in errors):.3g}")
    print(f"intervals that hold the truth: {1.0 - missed / counts:.1%} of {counts}")
    print(f"seconds of CPU: median {np.median(seconds):.0f}, most {max(seconds):.0f}")
    if loops:
        print(f"as good as known: {sum(one.is_as_good for one in loops)} of {len(loops)}")
        false = sum(bool(one.known.warning) + bool(one.identified.warning) for one in loops)
        print(f"warnings with the true or the identified calibration: {false}")
        print(f"shipped calibration: good or told: {sum(one.is_told for one in loops)} of {len(loops)}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
