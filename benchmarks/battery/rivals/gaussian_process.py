"""Gaussian-process discrepancy: a process over states models the residuals; the effect that its mean resembles most is named.

Method          residual of an output = delta(p, dp/dt, slip, temperature, torque, voltage) + noise, where delta is a Gaussian
                process with an anisotropic squared exponential kernel. Hyperparameters: maximum marginal likelihood on
                a random subset. What each effect of the catalogue changes in the same runs is smoothed by the same process. The
                effect with the largest |cosine| to the posterior mean, all outputs together, is named
References      Kennedy and O'Hagan 2001, J. R. Statist. Soc. B 63; Rasmussen and Williams 2006, ch. 2 and 5
"""

from collections.abc import Mapping

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky
from scipy.linalg.lapack import dpotri
from scipy.optimize import minimize

from benchmarks.battery.rivals.residuals import PERIOD, ResidualData

_SUBSET_SIZE = 600  # samples that the process is conditioned on; chosen: cost grows with the third power
_STRIDE = 5  # samples of 4 ms: one each 20 ms is compared; chosen: to save time
_SEED = 6  # chosen: arbitrary, makes runs repeatable
# bounds [floors²], [standard deviations of the state], [floors²]; chosen: wide
_SIGNAL, _LENGTH, _NOISE = ((1e-4, 1e4), (0.05, 1e2), (1e-2, 1e2))
_OUTPUTS = (0, 1, 2, 4)  # index of the analog ones in OUTPUTS: pressure, both torques, temperature


def standardise_states(data: ResidualData) -> np.ndarray:
    """Standardise the states that the process is a function of: (runs, n, 6)."""
    p, torque = data.select_output("cylinder_pressure_bar"), data.select_output("clutch_torque_nm")
    slip, celsius = data.select_output("slip_speed_rad_s"), data.select_output("oil_temperature_degc")
    rising = np.tanh(np.gradient(p, PERIOD, axis=-1) / 3.0)
    x = np.stack([p, rising, slip, celsius, torque, data.select_input("valve_voltage_v")], axis=-1)
    return (x - x.mean(axis=(0, 1))) / (x.std(axis=(0, 1)) + 1e-9)


def rank_effects(data: ResidualData, effects: Mapping[str, np.ndarray]) -> list[tuple[str, float]]:
    """Rank effects by the |cosine| [-] between their changes and the posterior mean; pairs of name and cosine."""
    x = standardise_states(data)[:, ::_STRIDE].reshape(-1, 6)
    chosen = np.random.default_rng(_SEED).choice(len(x), _SUBSET_SIZE, replace=False)
    near, far = _compute_squared_distances(x[chosen], x[chosen]), _compute_squared_distances(x, x[chosen])
    means = []
    for i in _OUTPUTS:
        y = data.residuals[:, i, ::_STRIDE].ravel()
        targets = np.stack([y, *(change[:, i, ::_STRIDE].ravel() for change in effects.values())], axis=-1)
        means.append(_compute_posterior_mean(near, far, targets[chosen], fit_hyperparameters(near, y[chosen])))
    mean, *smoothed = np.concatenate(means).T
    cosines = {name: _compute_cosine(mean, change) for name, change in zip(effects, smoothed, strict=True)}
    return sorted(cosines.items(), key=lambda one: -one[1])


def fit_hyperparameters(distances: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Fit logarithms of signal variance, lengths and noise variance, (d + 2,), by maximum marginal likelihood; all start at 1.

    distances: squared distances in each state, (d, n, n). y: residuals in floors, (n,).
    """
    bounds = np.log([_SIGNAL, *[_LENGTH] * len(distances), _NOISE])
    return minimize(compute_loss, np.zeros(len(bounds)), (distances, y), jac=True, bounds=bounds, method="L-BFGS-B").x


def compute_loss(logs: np.ndarray, distances: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray]:
    """Compute the negative logarithm of the marginal likelihood at the hyperparameters `logs`, and its gradient (d + 2,).

    Rasmussen and Williams 2006, eq. 2.30 and 5.9. scikit-learn takes three times as long for a case, because it stores
    the derivative of the kernel by each hyperparameter, (n, n, d + 2).
    """
    signal, noise = _compute_kernel(logs, distances), np.exp(logs[-1])
    factor = cholesky(signal + noise * np.eye(len(y)), lower=True)
    a = cho_solve((factor, True), y)
    half = np.tril(dpotri(factor, lower=1)[0])
    inverse = half + np.tril(half, -1).T
    value = 0.5 * y @ a + np.log(np.diag(factor)).sum() + 0.5 * len(y) * np.log(2.0 * np.pi)  # eq. 2.30
    weight = np.outer(a, a) - inverse  # eq. 5.9; the gradient is half the trace of it times the kernel's derivative
    by_noise = 0.5 * noise * np.trace(weight)
    weight *= signal
    by_length = 0.5 * np.tensordot(distances, weight, 2) * np.exp(-2.0 * logs[1:-1])
    return value, -np.array([0.5 * weight.sum(), *by_length, by_noise])


def _compute_posterior_mean(near: np.ndarray, far: np.ndarray, y: np.ndarray, logs: np.ndarray) -> np.ndarray:
    """Compute the posterior mean (n, m) given `y` (k, m), eq. 2.25. near, far: squared distances (d, k, k) and (d, n, k)."""
    factor = cho_factor(_compute_kernel(logs, near) + np.exp(logs[-1]) * np.eye(len(y)))
    return _compute_kernel(logs, far) @ cho_solve(factor, y)  # eq. 2.25


def _compute_kernel(logs: np.ndarray, distances: np.ndarray) -> np.ndarray:
    """Compute the squared exponential kernel with one length per state, without noise."""
    return np.exp(logs[0] - 0.5 * np.tensordot(np.exp(-2.0 * logs[1:-1]), distances, 1))  # eq. 5.1


def _compute_squared_distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Compute the squared distances in each state: (d, rows of a, rows of b)."""
    return (a.T[:, :, None] - b.T[:, None, :]) ** 2


def _compute_cosine(a: np.ndarray, b: np.ndarray) -> float:
    return float(abs(a @ b) / np.sqrt((a @ a) * (b @ b) + 1e-300))
