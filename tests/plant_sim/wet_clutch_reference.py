"""Equations 1 to 8 of docs/rig.md, written anew in bar and degC, integrated between kinks."""

from collections.abc import Sequence
from math import exp, log10
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

BAR, KELVIN = 1e5, 273.15
A_CYL, P_CONTACT, P_PRELOAD, X_C = 1.131e-2, 2.35, 1.7, 1.0e-3
W_V, ZETA = 2 * np.pi * 8.0, 0.9
F_0 = A_CYL * P_PRELOAD * BAR
K_S = (A_CYL * P_CONTACT * BAR - F_0) / X_C
K_STACK, C_P = 5.0e7, 2.0e4
J, M_MAX = 0.05, 40.0
ATOL = [1e-10, 1e-8, 1e-10, 1e-14, 1e-11, 1e-9, 1e-9, 1e-11, 1e-9]


def compute_mu(temperature: float) -> float:
    return -0.0145 * log10(temperature - 30.0) + 0.143


def compute_stribeck(p_star: float, omega: float) -> float:
    """s_n without its sign."""
    beta = min(1.0, 0.704 + (1 - 0.704) * exp(-(p_star - 2.71) / 0.158))
    return 1.0 + (beta - 1.0) * exp(-11.52 / abs(omega)) if omega else 1.0


def compute_friction(p_star: float, m: float, omega: float, direction: int, temperature: float) -> float:
    r_t = 1.0 + 2.354 * (compute_mu(temperature) / compute_mu(70.0) - 1.0)
    viscous = max(0.0, 2.67 * p_star - 6.49) * r_t * abs(omega) ** (1 / 3)
    return max(0.0, 10.8 * p_star - 25.1) * m + direction * viscous


class Reference:
    """Equations 1 to 8 with their kinks as modes, each changed only at an event: touching plates, resting piston, empty
    cylinder, limited motor, direction of slip."""

    def __init__(self, speed: float, temperature: float) -> None:
        # p_v, p_v', p_cyl, x, m, T, omega, integral of the speed error, theta
        self.y = np.array([0, 0, 0, 0, 0, temperature, speed, 0, 0], dtype=float)
        self.t = 0.0
        self.touching, self.resting, self.empty, self.limited = False, True, True, 0
        self.direction = 1 if speed >= 0 else -1
        self.u = self.omega_d = 0.0

    def compute_demand(self, y: Sequence[float]) -> float:
        return 4.0 * (self.omega_d - y[6]) + 40.0 * y[7]

    def compute_torques(self, y: Sequence[float]) -> tuple[float, float]:
        """Clutch and motor torque."""
        motor = self.limited * M_MAX if self.limited else self.compute_demand(y)
        if not self.touching:
            return 0.0, motor
        p_star = P_CONTACT + K_STACK * (y[3] - X_C) / (A_CYL * BAR)
        return compute_friction(p_star, y[4], y[6], self.direction, y[5]), motor

    def compute_rates(self, t: float, y: Sequence[float]) -> list[float]:
        p_v, rate, p, x, m, temperature, omega, _, _ = y.tolist()
        stack = K_STACK * (x - X_C) if self.touching else 0.0
        dx = 0.0 if self.resting else (A_CYL * p * BAR - F_0 - K_S * x - stack) / C_P
        dp = 0.0 if self.empty else (2.0e-4 * (p_v - p) - A_CYL * dx) / 1.0e-6
        clutch, motor = self.compute_torques(y)
        dm = 0.0
        if self.touching:
            s_n = self.direction * compute_stribeck(P_CONTACT + stack / (A_CYL * BAR), omega)
            dm = self.direction * 69.0 * (1.0 - m / s_n)
        return [
            rate,
            W_V**2 * (self.u - p_v) - 2 * ZETA * W_V * rate,
            dp,
            dx,
            dm,
            (abs(clutch * omega) - 3.0 * (temperature - 70.0)) / 600.0,
            (motor - clutch) / J,
            0.0 if self.limited else self.omega_d - omega,
            omega,
        ]

    def make_events(self) -> list[Any]:
        """Each crosses zero in its `direction` where its mode ends."""

        def make_event(function: Any, direction: int) -> Any:
            def crossing(t: float, y: Sequence[float]) -> float:
                return float(function(y))

            crossing.terminal, crossing.direction = True, direction  # type: ignore[attr-defined]
            return crossing

        return [
            make_event(lambda y: y[3] - X_C, -1 if self.touching else 1),
            make_event(lambda y: A_CYL * y[2] * BAR - F_0, 1) if self.resting else make_event(lambda y: y[3], -1),
            make_event(lambda y: y[0] - y[2], 1) if self.empty else make_event(lambda y: y[2], -1),
            make_event(lambda y: self.limited * self.compute_demand(y) - M_MAX, -1)
            if self.limited
            else make_event(lambda y: abs(self.compute_demand(y)) - M_MAX, 1),
            make_event(lambda y: y[6], -self.direction),
        ]

    def change(self, index: int) -> None:
        if index == 0:
            self.touching = not self.touching
            if not self.touching:
                self.y[4] = 0.0
        elif index == 1:
            self.resting = not self.resting
        elif index == 2:
            self.empty = not self.empty
        elif index == 3:
            self.limited = 0 if self.limited else (1 if self.compute_demand(self.y) > 0 else -1)
        else:
            self.direction = -self.direction

    def sample(self) -> tuple[float, ...]:
        y = self.y
        return y[2], y[3], self.compute_torques(y)[0], y[6], y[5], y[8]

    def hold(self, voltage: float, speed_demand: float, cycles: int, period: float = 1e-3) -> list[tuple[float, ...]]:
        """Samples after each of `cycles` with the inputs held."""
        self.u, self.omega_d = min(max(2.5 * voltage, 0.0), 25.0), speed_demand
        asked = self.compute_demand(self.y)
        self.limited = 0 if abs(asked) <= M_MAX else (1 if asked > 0 else -1)
        grid = self.t + period * np.arange(1, cycles + 1)
        samples: list[tuple[float, ...]] = []
        while len(samples) < cycles:
            left = grid[len(samples) :]
            # fmt: off
            solution = solve_ivp(self.compute_rates, (self.t, left[-1]), self.y, "LSODA", t_eval=left,
                                 events=self.make_events(),
                                 rtol=1e-9, atol=ATOL)
            # fmt: on
            for self.y in np.transpose(solution.y):
                samples.append(self.sample())
            if solution.status == 1:
                [index] = [i for i, times in enumerate(solution.t_events) if times.size]
                self.t, self.y = solution.t_events[index][0], solution.y_events[index][0].copy()
                self.change(index)
        self.t = grid[-1]
        return samples
