"""Gaussian-process discrepancy: a process over states explains the residual of each output; named by what its mean looks like.

Method          residual = delta(p, dp/dt, slip, temperature, torque, voltage) + noise, delta a Gaussian process with an
                anisotropic squared exponential kernel, hyperparameters by marginal likelihood, on a random subset; its
                posterior mean over all samples, all outputs together, is compared with what each effect of the catalogue
                changes in the same runs, seen through the same process (smoothed alike): the largest |cosine| is named
References      Kennedy and O'Hagan 2001, J. R. Statist. Soc. B 63; Rasmussen and Williams 2006, ch. 2 and 5
"""

from collections.abc import Mapping

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky
from scipy.linalg.lapack import dpotri
from scipy.optimize import minimize

from benchmarks.battery.rivals.prepared import PERIOD, Prepared

_POINTS = 600  # of the subset
_THINNED = 5  # every fifth mean is compared: 20 ms
_SEED = 6
_SIGNAL, _LENGTH, _NOISE = (1e-4, 1e4), (0.05, 1e2), (1e-2, 1e2)  # floors², standard deviations of the state, floors²
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
    near, far = _apart(x[chosen], x[chosen]), _apart(x, x[chosen])
    means = []
    for i in _OUTPUTS:
        y = made.residuals[:, i, ::_THINNED].ravel()
        seen = np.stack([y, *(change[:, i, ::_THINNED].ravel() for change in effects.values())], axis=-1)
        means.append(_posterior_mean(near, far, seen[chosen], learned(near, y[chosen])))
    mean, *smoothed = np.concatenate(means).T
    found = {name: _cosine(mean, change) for name, change in zip(effects, smoothed, strict=True)}
    return sorted(found.items(), key=lambda one: -one[1])


def learned(apart: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Logarithms of signal variance, lengths and noise variance, (d + 2,), by marginal likelihood from where all are 1.

    apart: squared distances in each state, (d, n, n). y: residuals in floors, (n,).
    """
    bounds = np.log([_SIGNAL, *[_LENGTH] * len(apart), _NOISE])
    return minimize(loss, np.zeros(len(bounds)), (apart, y), jac=True, bounds=bounds, method="L-BFGS-B").x


def loss(logs: np.ndarray, apart: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray]:
    """Negative logarithmic marginal likelihood of `learned`'s logarithms, and its gradient (d + 2,).

    Rasmussen and Williams 2006, eq. 2.30 and 5.9. scikit-learn's, with which a case took three times as long: it writes
    down the kernel's derivative by each of its parameters, (n, n, d + 2).
    """
    signal, noise = _kernel(logs, apart), np.exp(logs[-1])
    factor = cholesky(signal + noise * np.eye(len(y)), lower=True)
    a = cho_solve((factor, True), y)
    half = np.tril(dpotri(factor, lower=1)[0])
    inverse = half + np.tril(half, -1).T
    value = 0.5 * y @ a + np.log(np.diag(factor)).sum() + 0.5 * len(y) * np.log(2.0 * np.pi)  # eq. 2.30
    weight = np.outer(a, a) - inverse  # eq. 5.9, and below: half the trace of it times the kernel's derivative
    by_noise = 0.5 * noise * np.trace(weight)
    weight *= signal
    by_length = 0.5 * np.tensordot(apart, weight, 2) * np.exp(-2.0 * logs[1:-1])
    return value, -np.array([0.5 * weight.sum(), *by_length, by_noise])


def _posterior_mean(near: np.ndarray, far: np.ndarray, y: np.ndarray, logs: np.ndarray) -> np.ndarray:
    """What the process, given y (k, m), expects elsewhere (n, m), eq. 2.25; squared distances near (d, k, k), far (d, n, k)."""
    factor = cho_factor(_kernel(logs, near) + np.exp(logs[-1]) * np.eye(len(y)))
    return _kernel(logs, far) @ cho_solve(factor, y)


def _kernel(logs: np.ndarray, apart: np.ndarray) -> np.ndarray:
    """Squared exponential, a length to each state (eq. 5.1, without noise)."""
    return np.exp(logs[0] - 0.5 * np.tensordot(np.exp(-2.0 * logs[1:-1]), apart, 1))


def _apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Squared distances in each state: (d, rows of a, rows of b)."""
    return (a.T[:, :, None] - b.T[:, None, :]) ** 2


def _cosine(a: np.ndarray, b: np.ndarray) -> float:
    return float(abs(a @ b) / np.sqrt((a @ a) * (b @ b) + 1e-300))
