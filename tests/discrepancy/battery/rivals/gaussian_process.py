"""Gaussian-process discrepancy: a process over states explains the residual of each output; named by what its mean looks like.

Method          residual = delta(p, dp/dt, slip, temperature, torque, voltage) + noise, delta a Gaussian process with an
                anisotropic squared exponential kernel, hyperparameters by marginal likelihood, on a random subset; its
                posterior mean over all samples, all outputs together, is compared with what each effect of the catalogue
                changes in the same runs, seen through the same process (smoothed alike): the largest |cosine| is named
References      Kennedy and O'Hagan 2001, J. R. Statist. Soc. B 63; Rasmussen and Williams 2006, ch. 2 and 5
"""

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from tests.discrepancy.battery.rivals.prepared import PERIOD, Prepared

_POINTS = 600  # of the subset
_THINNED = 5  # every fifth mean is compared: 20 ms
_SEED = 6
_OUTPUTS = (0, 1, 2, 4)  # analog: pressure, both torques, temperature


def states(made: Prepared) -> np.ndarray:
    """What the process is over, standardised: (runs, n, 6)."""
    p, torque = made.output("cylinder_pressure_bar"), made.output("clutch_torque_nm")
    slip, celsius = made.output("slip_speed_rad_s"), made.output("oil_temperature_degc")
    rising = np.tanh(np.gradient(p, PERIOD, axis=-1) / 3.0)
    x = np.stack([p, rising, slip, celsius, torque, made.input("valve_voltage_v")], axis=-1)
    return (x - x.mean(axis=(0, 1))) / (x.std(axis=(0, 1)) + 1e-9)


def ranked(made: Prepared, effects: Mapping[str, np.ndarray]) -> list[tuple[str, float]]:
    """Effects with |cosine| between their changes and the posterior mean, the largest first."""
    x = states(made)[:, ::_THINNED].reshape(-1, 6)
    chosen = np.random.default_rng(_SEED).choice(len(x), _POINTS, replace=False)
    mean, changes = [], {name: [] for name in effects}
    for i in _OUTPUTS:
        y = made.residuals[:, i, ::_THINNED].ravel()
        kernel = _kernel(x[chosen], y[chosen])
        across = kernel(x, x[chosen])  # without the white part, which sklearn adds for one set with itself alone
        factor = cho_factor(kernel(x[chosen]))
        mean.append(across @ cho_solve(factor, y[chosen]))
        for name, change in effects.items():
            seen = change[:, i, ::_THINNED].ravel()
            changes[name].append(across @ cho_solve(factor, seen[chosen]))
    whole = np.concatenate(mean)
    found = {name: _cosine(whole, np.concatenate(parts)) for name, parts in changes.items()}
    return sorted(found.items(), key=lambda one: -one[1])


def _kernel(x: np.ndarray, y: np.ndarray) -> Any:
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    start = ConstantKernel(1.0, (1e-4, 1e4)) * RBF(np.ones(x.shape[1]), (0.05, 1e2)) + WhiteKernel(1.0, (1e-2, 1e2))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a length at its bound: the residual does not depend on that state
        return GaussianProcessRegressor(start, normalize_y=False, random_state=_SEED).fit(x, y).kernel_


def _cosine(a: np.ndarray, b: np.ndarray) -> float:
    return float(abs(a @ b) / np.sqrt((a @ a) * (b @ b) + 1e-300))
