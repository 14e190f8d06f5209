"""Valve, cylinder and piston of docs/rig.md, 1 to 3, integrated independently, in bar, with laws of effects by hand."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from plant_sim.rigs import wet_clutch
from plant_sim.rigs.wet_clutch import Rig, Whole

BAR, KELVIN = 1e5, 273.15
K_V, SUPPLY = 2.5, 25.0  # bar/V, bar
W_V, ZETA = 2 * np.pi * 8.0, 0.9  # rad/s, 1
G, C_H = 2.0e-4, 1.0e-6  # m^3/(s bar), m^3/bar
A_CYL, P_CONTACT, P_PRELOAD, X_C = 1.131e-2, 2.35, 1.7, 1.0e-3  # m^2, bar, bar, m
F_0 = A_CYL * P_PRELOAD * BAR  # N
K_S = A_CYL * (P_CONTACT - P_PRELOAD) * BAR / X_C  # N/m
K_STACK, C_P = 5.0e7, 2.0e4  # N/m, Ns/m

_SMOOTH = {"clutch.coulomb_intercept": -300.0, "clutch.viscous_intercept": -90.0}  # no torque below 27 bar

Piece = tuple[float, int]  # voltage [V], cycles of 1 ms


def compute_stack_force(x: float, clearance: float = X_C) -> float:
    """F_stack [N]."""
    return K_STACK * max(0.0, x - clearance)


@dataclass(frozen=True)
class Fluid:
    """The laws of docs/rig.md, 1 to 3; pressures in bar."""

    flow: Callable[[float, float], float] = lambda p_v, p: G * (p_v - p)
    capacity: Callable[[float], float] = lambda p: C_H
    thrust: Callable[[float], float] = lambda p: p
    spring: Callable[[float], float] = lambda x: F_0 + K_S * x
    stack: Callable[[float], float] = compute_stack_force
    frequency: float = W_V
    droop: float = 0.0  # bar s/m^3
    recovery: float = 0.02  # s

    def compute_rates(self, y: np.ndarray, u: float) -> tuple[float, ...]:
        p_v, rate, p, x, sag = y
        force = A_CYL * self.thrust(p) * BAR - self.spring(x) - self.stack(x)
        dx = max(force, 0.0) / C_P if x <= 0.0 else force / C_P
        dp = (self.flow(p_v, p) - A_CYL * dx) / self.capacity(p)
        given = min(u * (1.0 - sag / SUPPLY), SUPPLY - sag)
        w = self.frequency
        return (
            rate,
            w * w * (given - p_v) - 2.0 * ZETA * w * rate,
            max(dp, 0.0) if p <= 0.0 else dp,
            dx,
            (self.droop * max(G * (p_v - p), 0.0) - sag) / self.recovery,
        )

    def run(self, pieces: Iterable[Piece]) -> np.ndarray:
        """p_v [bar], its rate, p [bar], x [m], sag [bar] after every cycle, (n, 5), from rest."""
        y, rows = np.zeros(5), []
        for voltage, cycles in pieces:
            u = min(max(K_V * voltage, 0.0), SUPPLY)
            times = 1e-3 * np.arange(1, cycles + 1)
            # short steps: the kinks at rest and touch are met within one
            solution: Any = solve_ivp(
                lambda t, y, u=u: self.compute_rates(y, u), (0.0, times[-1]), y, "LSODA", t_eval=times,
                rtol=1e-9, atol=[1e-9, 1e-7, 1e-9, 1e-13, 1e-9], max_step=5e-4,
            )  # fmt: skip
            rows.append(solution.y.T)
            y = solution.y[:, -1]
        return np.concatenate(rows)


def make_rig(**changed: float) -> Rig:
    """A rig with parameters changed: `effect__parameter=value`, in declared units.

    Its plates have no friction, so that slip and temperature stay as they are.
    """
    values = {name.replace("__", "."): value for name, value in changed.items()}
    return Rig(wet_clutch.load_nominal().with_values(_SMOOTH | values))


def run(
    rig: Rig, pieces: Iterable[Piece], speed: float = 20.0, celsius: float = 70.0, substeps: int = 10
) -> np.ndarray:
    """Records of the rig after every cycle, from rest."""
    return resume(rig, rig.make_rest_state(speed, celsius + KELVIN), pieces, substeps)[0]


def resume(rig: Rig, state: Whole, pieces: Iterable[Piece], substeps: int = 10) -> tuple[np.ndarray, Whole]:
    """Records after every cycle, from `state`, and the last state."""
    speed, records = float(state.y["slip_speed"][0]), []
    for voltage, cycles in pieces:
        for _ in range(cycles):
            state = rig.advance(state, voltage, speed, 1e9, 1e-3, substeps)
            records.append(state.y)
    return np.concatenate(records), state
