"""Motor limit: of a rig whose motor gives more torque than the declared one.

No column of a recording tells the limit, and a model whose motor gives less than was measured fits nothing. Where the runs rest
at their largest torque, the motor gave no more; elsewhere it may have given more than it did, as the declared one may.
"""

from collections.abc import Mapping

import numpy as np

from clutch_hil.fitting.model import Columns
from clutch_hil.recordings.checks.finding import Finding
from protocols.errors import InputError, name_run

LIMIT = "motor.torque_limit"
_TORQUE = "motor_torque_nm"
_ROOM = 1.25  # of the largest torque that is not rested at; what a motor may show over its limit, too (wet_clutch.py)
_AT_LIMIT, _RESTS = 0.02, 0.02  # of the largest torque, of the rows: so near, in so many, the motor rests at its limit


def find_motor_limit(runs: Mapping[str, Columns], declared: float, most: float) -> tuple[float, list[Finding]]:
    """The limit [Nm] by what `runs` show: the `declared` one where they keep it, else a larger one, and a finding of it.

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
        f"is {runs[name][_TORQUE][row]:.4g} Nm in row {row}, where the declared motor gives {declared:g} Nm: the rig is"
        f" taken as a larger one, whose motor gives {limit:.4g} Nm. Check the unit; --hold {LIMIT}=... tells another limit"
    )
    return limit, [Finding("larger", _TORQUE, (row, row), text, False, name)]
