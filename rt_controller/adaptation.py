"""Adaptation of the friction level from motor torque and slip acceleration, without the torque sensor.

Equation        y = M_m - J alpha  (torque balance of the motor side);  y = level (c + v) + viscous v + noise,
                c, v the Coulomb and viscous part of the estimate. Least squares with forgetting on the moments of
                (c + v, v); the level follows it with a time constant; `viscous` moves only where v varies
                independently of c + v (excitation), else it is held.
                level(T) = base + sum_i w_i(T) d_i, w_i hat functions over oil temperature: what is learnt at one
                temperature is remembered there.
Assumptions     motor torque signal is right while it moves, one that is stuck teaches nothing; inertia known; friction
                changes slower than the window
Valid range     |slip| and torque above their floors, |alpha| below its limit; outside, everything is held
Not modelled    errors that are not proportional to torque (contact pressure, seal) appear as level
References      ours; torque balance from rig.md 8. Integral adaptation announced as future work in Janssens 2010, chapter 7
"""

from bisect import bisect_right
from dataclasses import dataclass
from typing import Protocol

TEMPERATURE_NODES = (313.15, 333.15, 353.15, 373.15, 398.15, 423.15)  # K: 40..150 degC, the span of fig 6.8


@dataclass(frozen=True, slots=True)
class AdaptationSettings:
    """Names and units as in `controller.toml`, SI."""

    window: float
    time_constant: float
    temperature_share: float
    level_low: float
    level_high: float
    viscous_bound: float
    torque_floor: float
    slip_floor: float
    acceleration_limit: float
    stuck_time: float
    excitation: float


class Adaptation(Protocol):
    """Friction level and viscous correction of estimator and inverse model; `settings` may be replaced between updates."""

    settings: AdaptationSettings
    level: float
    viscous: float
    active: bool

    def update(
        self, coulomb: float, viscous: float, observed: float, slip: float, acceleration: float,
        temperature: float, step: float, sliding: bool,
    ) -> None:  # fmt: skip
        """Torque parts and observed torque [Nm], slip [rad/s], acceleration [rad/s^2], temperature [K], step [s]."""


class NoAdaptation:
    """The identified parameters as they are."""

    level = 1.0
    viscous = 0.0
    active = False

    def __init__(self, settings: AdaptationSettings) -> None:
        self.settings = settings

    def update(
        self, coulomb: float, viscous: float, observed: float, slip: float, acceleration: float,
        temperature: float, step: float, sliding: bool,
    ) -> None:  # fmt: skip
        """Nothing to learn."""


class LevelAdaptation:
    """Bounded, frozen without excitation, scheduled with oil temperature."""

    def __init__(self, settings: AdaptationSettings) -> None:
        self.settings = settings
        self.level, self.viscous, self.active = 1.0, 0.0, False
        self._base = 1.0
        self._deviations = [0.0] * len(TEMPERATURE_NODES)
        # exponentially weighted moments of a = c + v, v and y
        self._aa = self._av = self._vv = self._ay = self._vy = 0.0

    def update(
        self, coulomb: float, viscous: float, observed: float, slip: float, acceleration: float,
        temperature: float, step: float, sliding: bool,
    ) -> None:  # fmt: skip
        """See `Adaptation`."""
        s = self.settings
        node, weight = _hat(temperature)
        whole = coulomb + viscous
        self.active = (
            sliding
            and step > 0.0
            and abs(slip) > s.slip_floor
            and abs(whole) > s.torque_floor
            and abs(acceleration) < s.acceleration_limit
        )
        if self.active:
            keep = max(0.0, 1.0 - step / s.window)
            fresh = 1.0 - keep
            self._aa = keep * self._aa + fresh * whole * whole
            self._av = keep * self._av + fresh * whole * viscous
            self._vv = keep * self._vv + fresh * viscous * viscous
            self._ay = keep * self._ay + fresh * whole * observed
            self._vy = keep * self._vy + fresh * viscous * observed
            gain = min(1.0, step / s.time_constant)
            unexplained = self._vv - self._av * self._av / self._aa  # of v, given a
            if unexplained > s.excitation * self._aa:
                best = (self._vy - self._av * self._ay / self._aa) / unexplained  # least squares in (level, viscous)
                self.viscous = _clip(self.viscous + gain * (best - self.viscous), -s.viscous_bound, s.viscous_bound)
            best = (self._ay - self.viscous * self._av) / self._aa  # least squares in level, viscous given
            best = _clip(best, s.level_low, s.level_high)
            correction = gain * (best - self._level(node, weight))
            self._base += (1.0 - s.temperature_share) * correction
            self._deviations[node] += s.temperature_share * (1.0 - weight) * correction
            self._deviations[node + 1] += s.temperature_share * weight * correction
        self.level = _clip(self._level(node, weight), s.level_low, s.level_high)

    def _level(self, node: int, weight: float) -> float:
        low, high = self._deviations[node], self._deviations[node + 1]
        return self._base + (1.0 - weight) * low + weight * high


def _hat(temperature: float) -> tuple[int, float]:
    """Lower node and weight of the upper one, for linear interpolation over `TEMPERATURE_NODES`; held outside."""
    node = min(max(bisect_right(TEMPERATURE_NODES, temperature) - 1, 0), len(TEMPERATURE_NODES) - 2)
    low, high = TEMPERATURE_NODES[node], TEMPERATURE_NODES[node + 1]
    return node, _clip((temperature - low) / (high - low), 0.0, 1.0)


def _clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)
