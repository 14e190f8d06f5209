"""Closed loop of identified power-shift rigs: how well controllers with an identified calibration hand the torque over.

The rig is the plant of clutch-hil with the true parameters, the scenario is `shift`.
`python -m benchmarks.power_shift --closed-loop` plays every rig that it identifies.

Measure         dip and rise of the output torque in the hand-over, each as a share of the torque before, and the time of the
                shift (clutch_hil/bench/judgement/power_shift_measures.py). As good as known: each is at most 1.2 times that of
                controllers that know the rig, and 0.01, or 0.02 s. A shift that does not end with these (on a steep road the
                vehicle does not reach the second gear's speed in the scenario) has no time to compare
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import clutch_hil as ch
from clutch_hil.bench.judgement.calibration_check import describe_shift_mismatch
from clutch_hil.identify.calibration import Calibration
from clutch_hil.identify.controller_values import derive_controller_values
from plant_sim.rigs import power_shift
from protocols.can.two_clutches import CLUTCHES
from rt_controller.loop.parameter_sets import load_controller_parameters

WORSE = 1.2  # ratio to controllers that know the rig: as issue 31 allows for the regime error of one clutch
_ADDED = {"torque_gap": 0.01, "torque_peak": 0.01, "shift_time_s": 0.02}  # differences within sensor noise
NO_FAULT = "none"


@dataclass(frozen=True)
class Shifted:
    """A hand-over: its `fault`, a word; measures by name; the `warning` that the calibration is of another rig, or ""."""

    fault: str
    measures: Mapping[str, float]
    warning: str

    def is_as_good_as(self, other: "Shifted") -> bool:
        """Return whether this hand-over is as good as another one (Measure in the module docstring)."""
        return self.fault == NO_FAULT and all(
            self.measures[name] <= WORSE * other.measures[name] + added or np.isnan(other.measures[name])
            for name, added in _ADDED.items()
        )

    def __str__(self) -> str:
        """Return the result in words."""
        shown = ", ".join(f"{name} {self.measures[name]:.3g}" for name in _ADDED)
        return self.fault if self.fault != NO_FAULT else f"{shown}{', warned' if self.warning else ''}"


@dataclass(frozen=True)
class ShiftLoop:
    """The scenario `shift` with controllers that know the rig, with the identified and with the shipped calibration."""

    known: Shifted
    identified: Shifted
    shipped: Shifted

    @property
    def is_as_good(self) -> bool:
        """Whether the identified calibration hands over as well as the true one."""
        return self.identified.is_as_good_as(self.known)

    @property
    def is_told(self) -> bool:
        """Whether the shipped calibration hands over as well, or ends in a fault or a warning."""
        one = self.shipped
        return one.fault != NO_FAULT or bool(one.warning) or one.is_as_good_as(self.known)

    def __str__(self) -> str:
        return f"known {self.known}; identified {self.identified}; shipped {self.shipped}"


def play_hand_over(true: Mapping[str, float], calibration: Path) -> ShiftLoop:
    """Play the scenario `shift` on a rig of these `true` values with three calibrations of the controllers."""

    def play(path: Path | None) -> Shifted:
        run = ch.simulate("shift", plant=dict(true), controller_parameters=path)
        measures = ch.measure_run(run)
        fault = str(measures.pop("fault"))
        warning = describe_shift_mismatch(run.columns, run.metadata["controller_parameters"]) or ""
        return Shifted(fault, {n: float(v) for n, v in measures.items()}, warning)

    with TemporaryDirectory() as folder:
        path = Path(folder) / "known.toml"
        make_true_calibration(true).write(path)
        return ShiftLoop(play(path), play(calibration), play(None))


def make_true_calibration(true: Mapping[str, float]) -> Calibration:
    """Return the calibration with the true parameters of the rig."""
    whole, controller = power_shift.load_nominal(), load_controller_parameters()
    values = {n: p.value for n, p in whole.items()} | dict(true)
    ratios = {f"driveline.ratio_{c}": (values[f"driveline.ratio_{c}"], "known") for c in CLUTCHES}
    nominal = {n: p.value for n, p in whole.items()}
    parts = [
        derive_controller_values(
            power_shift.select_clutch(values, c), power_shift.select_clutch(nominal, c), controller
        )
        | ratios
        for c in CLUTCHES
    ]
    fixed = {n: (v, "known") for n, v in true.items()}
    return Calibration("power_shift", [], parts[0], np.zeros((0, 0)), {}, fixed=fixed, controller_b=parts[1])
