"""Motor limit: torque limit of a motor that is larger or smaller than the declared one.

No column of a recording contains the limit, and a model whose motor gives less than was measured fits nothing. If the runs stay
at their largest torque, this is the limit. Otherwise the limit may be higher than that torque, and gets a margin.

Any limit can be seen where the speed demand steps: the motor's regulator asks for M + k_p (step), and the motor stays below.
k_p by least squares of dM(k) = a dx(k) + b dx(k-1) + c e(k), k_p = a + b, with the speed error e, x = e or the demand, in rows
below the limit.
Assumption: the proportional part acts within a sample (docs/rig.md, 8).
"""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.ndimage import median_filter

from clutch_hil.fitting.model import Columns
from clutch_hil.recordings.checks.finding import Finding
from protocols.errors import InputError, name_run

LIMIT = "motor.torque_limit"
_TORQUE = "motor_torque_nm"
# Margin above a largest torque at which the motor does not stay; also the largest ratio of torque to limit (wet_clutch.py)
_ROOM = 1.25
_SPEED, _DEMAND = "slip_speed_rad_s", "motor_speed_demand_rad_s"
_OWN_LIMIT = "motor_torque_limit_nm"  # column of a controller that limits the motor itself
# Largest distance from the largest torque, as a share; least share of rows so near: then the motor is at its limit
_AT_LIMIT, _RESTS = 0.02, 0.02
# Shares of the limit: a step asks for more than the first times it; the motor is at its limit within the second. k_p is known
# to some percent
_BEYOND, _NEAR = 1.1, 0.04
_KNOWN = 5.0  # least ratio of k_p to its standard deviation: a run that does not move the motor does not determine it
# Share of the limit: the torques asked for must differ by more, because the torques of a slow motor would then differ too
_SPREAD = 0.1
_MEDIAN = 3  # rows of a median filter: a limit lasts longer than one row, and noise must not set the largest torque
# Least number of steps that ask for more than the limit, and least share of them after which the motor is at it
_LEAST_STEPS, _SURE = 4, 0.8


def find_motor_limit(runs: Mapping[str, Columns], declared: float, most: float) -> tuple[float, list[Finding]]:
    """Return the limit [Nm]: `declared` if the runs stay within it, else a larger one with a finding.

    Raises InputError where a torque is above `most` [Nm].
    """
    shown = {name: float(np.abs(run[_TORQUE]).max()) for name, run in runs.items()}
    name = max(shown, key=lambda one: shown[one])
    if shown[name] <= _ROOM * declared:
        return declared, []
    size = np.abs(np.concatenate([run[_TORQUE] for run in runs.values()]))
    rests = np.mean(size > (1.0 - _AT_LIMIT) * shown[name]) > _RESTS
    limit = min(shown[name] if rests else _ROOM * shown[name], most)
    if shown[name] > most:
        raise InputError(
            f"{name_run(name)}: {_TORQUE} is up to {shown[name]:.4g} Nm; allowed are motors of {most:g} Nm: check the unit in"
            " the import map"
        )
    row = int(np.argmax(np.abs(runs[name][_TORQUE])))
    text = (
        f"is {runs[name][_TORQUE][row]:.4g} Nm, but the declared motor gives {declared:g} Nm: the rig is"
        f" taken as a larger one, whose motor gives {limit:.4g} Nm. Check the unit; --hold {LIMIT}=... sets another limit"
    )
    return limit, [Finding("larger", _TORQUE, (row, row), text, False, name)]


def find_limit_at_steps(runs: Mapping[str, Columns], declared: float) -> tuple[float, list[Finding]]:
    """Return the limit [Nm] from speed steps that ask for more than the motor gives, with a finding; else `declared`."""
    fitting = {
        name: run
        for name, run in runs.items()
        if {_SPEED, _DEMAND} <= set(run) and float(np.min(run.get(_OWN_LIMIT, declared))) >= declared
    }
    if not fitting:
        return declared, []
    shown = {name: float(np.abs(median_filter(run[_TORQUE], _MEDIAN)).max()) for name, run in fitting.items()}
    limit = max(shown.values())
    gain = _estimate_gain(list(fitting.values()), limit)
    asked, given = np.hstack([_follow_steps(run, gain) for run in fitting.values()])
    more = asked > _BEYOND * limit
    at_limit = given[more & (given > (1.0 - _NEAR) * limit)]
    sure = len(at_limit) >= max(_LEAST_STEPS, _SURE * np.count_nonzero(more))
    if abs(limit - declared) <= _NEAR * declared or not sure or np.ptp(asked[more]) < _SPREAD * limit:
        return declared, []
    name = max(shown, key=lambda one: shown[one])
    limit = float(np.median(at_limit))
    row = int(np.argmax(np.abs(fitting[name][_TORQUE])))
    text = (
        f"stays at {limit:.4g} Nm after {len(at_limit)} steps of the speed demand that need more, but the declared motor"
        f" gives {declared:g} Nm: this is taken as the motor's limit; --hold {LIMIT}=... sets another one"
    )
    return limit, [Finding("limit", _TORQUE, (row, row), text, False, name)]


def _estimate_gain(runs: Sequence[Columns], limit: float) -> float:
    """Estimate the proportional gain of the motor's speed regulator [Nm s/rad] in rows below `limit` [Nm]; 0 if not possible.

    The larger of two estimates: from the demand, which has no noise, and from the speed error, whose noise biases it low.
    """
    by_demand: list[np.ndarray] = []
    by_error: list[np.ndarray] = []
    changes: list[np.ndarray] = []
    for run in runs:
        error, torque = run[_DEMAND] - run[_SPEED], run[_TORQUE]
        free = np.abs(torque) < (1.0 - 2.0 * _NEAR) * limit
        free = free[2:] & free[1:-1] & free[:-2]
        for rows, moved in ((by_demand, np.diff(run[_DEMAND])), (by_error, np.diff(error))):
            rows.append(np.column_stack([moved[1:], moved[:-1], error[1:-1]])[free])
        changes.append(np.diff(torque)[1:][free])
    change = np.concatenate(changes)
    return max(_regress(np.concatenate(rows), change) for rows in (by_demand, by_error))


def _regress(rows: np.ndarray, change: np.ndarray) -> float:
    """Return the sum of the first two coefficients of `change` (n,) over `rows` (n, 3); 0 if its deviation is above a fifth of
    it."""
    both = np.array([1.0, 1.0, 0.0])
    coefficients = np.linalg.lstsq(rows, change, rcond=None)[0]
    left = change - rows @ coefficients
    deviation = np.sqrt(both @ np.linalg.pinv(rows.T @ rows) @ both * float(left @ left) / max(len(change) - 3, 1))
    gain = float(both @ coefficients)
    return gain if len(change) > 3 and gain > _KNOWN * deviation else 0.0


def _follow_steps(run: Columns, gain: float) -> tuple[np.ndarray, np.ndarray]:
    """Return for each row the torque that its speed demand step asks for, and the largest torque of its sign in the next two
    [Nm]."""
    step, torque = np.diff(run[_DEMAND])[:-1], run[_TORQUE]
    way = np.sign(step)
    return way * (torque[:-2] + gain * step), np.maximum(way * torque[1:-1], way * torque[2:])
