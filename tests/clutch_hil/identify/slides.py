"""Runs of sliding contacts with known friction, for tests of its identification."""

import numpy as np
from scipy.interpolate import CubicSpline

from plant_sim.friction.model import FrictionModel
from protocols.files.run import Run

PERIOD = 2e-3  # s
SPAN = 2e-3  # m


def make_motion(seconds: float = 20.0, seed: int = 0) -> np.ndarray:
    """Position [m] (n,): slow reversals, and a multisine that spans two decades of speed."""
    time = PERIOD * np.arange(round(seconds / PERIOD))
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, 8)
    lines = np.arange(1, 9) * 0.4
    fast = sum(np.sin(2.0 * np.pi * f * time + p) / f for f, p in zip(lines, phases, strict=True))
    slow = 0.1 * np.sin(2.0 * np.pi * 0.25 * time)
    x = np.clip(time - 0.4 * seconds, 0.0, 1.0)
    grown = x**3 * (10.0 - 15.0 * x + 6.0 * x**2)  # without a jump of the acceleration
    return np.asarray(SPAN * (slow * (1.0 - grown) + 0.5 * grown * fast))


def play(
    model: FrictionModel,
    position: np.ndarray | None = None,
    load: np.ndarray | None = None,
    noise: np.ndarray | float = 0.0,
    mass: float = 0.0,
    offset: float = 0.0,
) -> Run:
    """The run of a contact with `model` and a `mass` [kg] along `position` [m] (n,), force with `offset` and `noise` [N]."""
    position = make_motion() if position is None else position
    force = model.trace(position, PERIOD, 1.0 if load is None else load).force
    time = PERIOD * np.arange(position.size)
    force = force + mass * CubicSpline(time, position)(time, 2) + offset + noise
    columns = {"time_s": time, "position_m": position, "friction_force_n": force}
    if load is not None:
        columns["normal_load_n"] = load
    return Run(columns, {})


def make_white_noise(size: int, deviation: float, seed: int) -> np.ndarray:
    """White noise [N] (n,)."""
    return deviation * np.random.default_rng(seed).standard_normal(size)


def make_red_noise(size: int, deviation: float, share: float, seed: int) -> np.ndarray:
    """Noise [N] (n,) of which each sample keeps `share` of the one before."""
    own = np.random.default_rng(seed).standard_normal(size)
    for i in range(1, size):
        own[i] = share * own[i - 1] + np.sqrt(1.0 - share**2) * own[i]
    return deviation * own
