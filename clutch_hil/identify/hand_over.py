"""Hand-over: where and when the torque of the output shaft passes from clutch a to clutch b in a recorded run.

Equation        carried: i_a M_a and i_b M_b, means over 20 ms
                change-over: after a carried most of the output's torque, b carries more than a, and goes on to do so
                it begins where a last carried 95 % of both, and ends where a first carries 5 %
                pressures at which a and b each carry half: of the identified maps, at the slips and oil temperatures there.
                  Their 95 % intervals follow from those of the parameters
                interval of the time: the noise of the two torques over the rate at which their difference changes
Assumptions     torque sensors without offset, or with the identified one
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.optimize import brentq

from clutch_hil.fitting.intervals import NORMAL_95
from clutch_hil.fitting.model import Columns, Values
from clutch_hil.fitting.noise import estimate_noise
from clutch_hil.identify.thesis_quantities import Propagation, Quantity, compute_torque
from plant_sim.profiles.profile import FULL_PRESSURE
from protocols.can.two_clutches import CLUTCHES

HAND_OVER = "hand-over"  # where its quantities are from
_MEAN = 0.02  # s: the noise of a torque is then 11 mNm at 1 kHz
_MOST, _LEAST = 0.95, 0.05  # shares of the torque of both: a carries all, or nothing
# Of the motor's largest torque, at the output shaft: a twentieth of what the shipped shift hands over
_LEAST_SHARE = 0.05
_LEAST_SLIP = 0.5  # rad/s: slower plates may stick, and their torque is none of the maps


@dataclass(frozen=True)
class HandOver:
    """A change-over in `run` at `time`, between `begin` and `end` [s]; half: of its 95 % interval [s]. torque: of the output
    shaft [Nm] there. pressures [bar], slips [rad/s], celsius: of clutch a and b, as measured there."""

    run: str
    time: float
    half: float
    begin: float
    end: float
    torque: float
    pressures: tuple[float, float]
    slips: tuple[float, float]
    celsius: tuple[float, float]

    def __str__(self) -> str:
        """In words."""
        return (
            f"{self.run}: torque of {self.torque:.3g} Nm changes over at {self.time:.3f} s ± {1e3 * self.half:.2g} ms,"
            f" begins at {self.begin:.3f} s, ends at {self.end:.3f} s"
        )

    def make_document(self) -> dict:
        """It as a JSON document."""
        return {
            "run": self.run, "time_s": self.time, "ci95_s": [self.time - self.half, self.time + self.half],
            "begin_s": self.begin, "end_s": self.end, "output_torque_nm": self.torque,
            **{f"pressure_{c}_bar": p for c, p in zip(CLUTCHES, self.pressures, strict=True)},
            **{f"slip_{c}_rad_s": s for c, s in zip(CLUTCHES, self.slips, strict=True)},
        }  # fmt: skip


def find_hand_overs(name: str, run: Columns, ratios: tuple[float, float], motor: float) -> list[HandOver]:
    """The hand-overs of a run, whose torques have no offset. motor: its largest torque [Nm]."""
    period = float(run["time_s"][1] - run["time_s"][0])
    width = max(1, round(_MEAN / period))
    carried = [run[f"clutch_torque_{clutch}_nm"] * ratio for ratio, clutch in zip(ratios, CLUTCHES, strict=True)]
    a, b = (np.asarray(uniform_filter1d(torque, width)) for torque in carried)
    both, gap = np.abs(a) + np.abs(b), np.abs(b) - np.abs(a)
    loaded = both > _LEAST_SHARE * motor
    carries_a, carries_b = loaded & (np.abs(a) > _MOST * both), loaded & (np.abs(b) > _MOST * both)
    hand_overs: list[HandOver] = []
    last = -1
    for k in np.flatnonzero(carries_b & ~np.roll(carries_b, 1)).tolist():
        before = np.flatnonzero(carries_a[:k])
        if not len(before) or before[-1] <= last or not loaded[before[-1] : k].all():
            continue
        begin, last = int(before[-1]), k
        at = begin + int(np.flatnonzero(gap[begin:k] <= 0.0)[-1])
        rate = max((gap[k] - gap[begin]) / ((k - begin) * period), 1e-9)
        noise = [estimate_noise(torque) for torque in carried]
        half = float(np.hypot(NORMAL_95 * np.linalg.norm(noise) / np.sqrt(width) / rate, 0.5 * period))

        def pair(column: str, at: int = at) -> tuple[float, float]:
            one, two = (float(np.mean(run[column.format(c)][max(at - width, 0) : at + width + 1])) for c in CLUTCHES)
            return one, two

        time = run["time_s"]
        hand_overs.append(
            HandOver(
                name, float(time[at]), half, float(time[begin]), float(time[k]), float(both[at]),
                pair("cylinder_pressure_{}_bar"), pair("slip_speed_{}_rad_s"), pair("oil_temperature_{}_degc"),
            )
        )  # fmt: skip
    return hand_overs


def compute_pressures(one: HandOver, known: Mapping[str, Propagation], ratios: tuple[float, float]) -> list[Quantity]:
    """Pressures of the cylinders at which each clutch carries half of the output's torque at a hand-over; none of a clutch that
    may stick, or that has no such pressure. known: parameters of each clutch."""
    quantities = []
    for k, clutch in enumerate(CLUTCHES):
        slip, celsius, torque = abs(one.slips[k]), one.celsius[k], 0.5 * one.torque / ratios[k]
        strongest = compute_torque(known[clutch].values, np.array([FULL_PRESSURE]), slip, celsius)[0]
        if slip < _LEAST_SLIP or torque >= strongest:
            continue

        def pressure(v: Values, slip: float = slip, celsius: float = celsius, torque: float = torque) -> np.ndarray:
            def missing(p: float) -> float:
                return float(compute_torque(v, np.array([p]), slip, celsius)[0]) - torque

            low = v["piston.contact_pressure"]
            return np.array(
                [brentq(missing, low, FULL_PRESSURE) if missing(low) < 0.0 < missing(FULL_PRESSURE) else low]
            )

        value, half = known[clutch](pressure)
        quantities.append(
            Quantity(
                f"pressure {clutch} at the change-over", float(value[0]), float(half[0]), "bar", HAND_OVER,
                f"{one.run}, {torque:.3g} Nm, {slip:.3g} rad/s, {celsius:.0f} degC",
            )
        )  # fmt: skip
    return quantities
