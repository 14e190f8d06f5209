"""Delay between a measured position and a measured force, estimated from the residual of a fit.

Equation        r = f(theta) - F,  r + J dtheta - f' delay ~ 0:  the share of sum r^2 that a delay explains beside theta
                then the parameters and the delay are fitted together: F(t) = f(t - delay)
Assumptions     one delay for the whole trace
Not modelled    a filter that both channels do not share; it looks like a delay
References      Ljung 1999, System identification, sec. 10.1 (Gauss-Newton step)
"""

from collections.abc import Callable

import numpy as np

from plant_sim.friction.identification.least_squares import Estimate, minimise
from plant_sim.friction.model import Array

LEAST_SHARE = 0.2  # of the squares: noise alone gives some 1/n, 1e-4 in 4000 samples; 5 ms at 0.05 N of noise gave 0.8
LEAST_GAIN = 0.5  # of the squares, explained by the fit with a delay: then the delay causes most of the residual
LEAST_DELAY = 0.5  # samples: less is the hold of the converters
ROUNDING = 1e-6  # of the force, root mean square: a smaller residual counts as zero
MOST_DELAY = 0.1  # of the trace: the remainder must still determine the parameters


def find_delay(
    force: Callable[[Array], Array], measured: Array, dt: float, estimate: Estimate, bounds: Array
) -> float | None:
    """Return the delay [s] of the `measured` force [N] (n,) behind the position, or None.

    A delay is returned only if it explains most of the residual of `estimate`. force: of the model (n,) by its parameters (m,),
    within `bounds` (m, 2). dt [s]: between samples. A force that is early has a negative delay.
    """
    shown = force(estimate.values)
    rest = shown - measured
    squares = float(rest @ rest)
    if measured.size <= estimate.values.size + 1 or not np.sqrt(squares) > ROUNDING * np.linalg.norm(measured):
        return None
    columns = np.column_stack([estimate.jacobian, -np.gradient(shown, dt)])
    size = np.linalg.norm(columns, axis=0)
    columns = columns / np.where(size > 0.0, size, 1.0)
    step = np.linalg.lstsq(columns, -rest, rcond=1e-9)[0]
    left, first = rest + columns @ step, step[-1] / (size[-1] or 1.0)
    if float(left @ left) > (1.0 - LEAST_SHARE) * squares or abs(first) < LEAST_DELAY * dt:
        return None
    time, most = dt * np.arange(measured.size), MOST_DELAY * dt * measured.size

    def compute_residual(theta: Array) -> Array:
        return np.asarray(np.interp(time - theta[-1], time, force(theta[:-1]))) - measured

    start = np.append(estimate.values, np.clip(first, -0.9 * most, 0.9 * most))
    with_delay = minimise(compute_residual, (*estimate.names, "delay"), start, np.vstack([bounds, [-most, most]]))
    delay = with_delay["delay"]
    gain = 1.0 - measured.size * with_delay.rmse**2 / squares
    return delay if gain > LEAST_GAIN and abs(delay) >= LEAST_DELAY * dt else None
