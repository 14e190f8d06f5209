"""Hand-over: when and at which torque the output shaft's torque passes from clutch a to clutch b in a recorded run.

Equation        transmitted: i_a M_a and i_b M_b, means over 20 ms
                change-over: after clutch a transmitted most of the output torque, b transmits more than a, until b transmits
                  most of it
                begins in the last row where a transmits 95 % of both, ends in the first row where b transmits 95 %
                pressures at which a and b each transmit half: from the identified maps, at the slips and oil temperatures
                  there. Their 95 % intervals follow from those of the parameters
                interval of the time: the noise of the two torques over the rate at which their difference changes
Assumptions     torque sensors without offset, or with the identified one subtracted
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.optimize import brentq

from clutch_hil.fitting.intervals import NORMAL_95
from clutch_hil.fitting.model import Columns, Values
from clutch_hil.fitting.noise import estimate_noise
from clutch_hil.identify.stepwise import LEAST_SLIP
from clutch_hil.identify.thesis_quantities import Propagation, Quantity, compute_torque
from plant_sim.profiles.profile import FULL_PRESSURE
from protocols.can.two_clutches import CLUTCHES

HAND_OVER = "hand-over"  # `where` of its quantities
_MEAN = 0.02  # s, averaging time: the noise of a torque is then 11 mNm at 1 kHz
_MOST = 0.95  # share of the torque of both clutches: with more, one transmits all
# Least output torque, as a share of the motor's largest torque: a twentieth of what the shipped shift hands over
_LEAST_SHARE = 0.05


@dataclass(frozen=True)
class HandOver:
    """A change-over in `run` at `time`, between `begin` and `end` [s]; half: half width of the 95 % interval of the time [s].

    torque: of the output shaft [Nm] at the change-over. pressures [bar], slips [rad/s], celsius [degC]: of clutch a and b, as
    measured then.
    """

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
        """Return a description in one line."""
        return (
            f"{self.run}: torque of {self.torque:.3g} Nm is handed over at {self.time:.3f} s ± {1e3 * self.half:.2g} ms,"
            f" begins at {self.begin:.3f} s, ends at {self.end:.3f} s"
        )

    def make_document(self) -> dict:
        """Return the hand-over as a JSON document."""
        return {
            "run": self.run, "time_s": self.time, "ci95_s": [self.time - self.half, self.time + self.half],
            "begin_s": self.begin, "end_s": self.end, "output_torque_nm": self.torque,
            **{f"pressure_{c}_bar": p for c, p in zip(CLUTCHES, self.pressures, strict=True)},
            **{f"slip_{c}_rad_s": s for c, s in zip(CLUTCHES, self.slips, strict=True)},
        }  # fmt: skip


def find_hand_overs(name: str, run: Columns, ratios: tuple[float, float], motor: float) -> list[HandOver]:
    """Find the hand-overs of a run whose torques are free of offsets. ratios: i_a, i_b. motor: its largest torque [Nm]."""
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
    """Compute the cylinder pressure at which each clutch transmits half the output torque at a hand-over, with its interval.

    A clutch that may stick, or has no such pressure, is left out. known: parameters of each clutch. ratios: i_a, i_b.
    """
    quantities = []
    for k, clutch in enumerate(CLUTCHES):
        slip, celsius, torque = abs(one.slips[k]), one.celsius[k], 0.5 * one.torque / ratios[k]
        strongest = compute_torque(known[clutch].values, np.array([FULL_PRESSURE]), slip, celsius)[0]
        if slip < LEAST_SLIP or torque >= strongest:
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
