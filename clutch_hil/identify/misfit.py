"""Residuals that a calibration leaves in the outputs."""

from collections.abc import Mapping, Sequence

import numpy as np

from clutch_hil.fitting.model import Columns, Output
from clutch_hil.fitting.noise import pool_noise
from clutch_hil.identify.joint_fit import GOOD_FIT
from protocols.errors import join_names

# Rows of every cycle are taken for a logger's where there is no angle that shows the slip of each
LOGGED = (
    "The low rate of a logger alone can cause this: log every cycle of the loop. If these rows are every cycle, but have no"
    " angle of an encoder, give them one by a formula (docs/identify.md#a-missing-sensor)."
)


def warn_misfit(misfit: Mapping[str, float], hardly: Sequence[str] = (), logged: bool = False) -> list[str]:
    """Return a warning if residuals of outputs are above their noise. misfit: root mean square residual over noise, by output.

    hardly: names of hardly excited parameters. logged: whether a logger took rows of the runs, not every cycle of the loop.
    """
    above = [f"{column} ({share:.3g} times)" for column, share in misfit.items() if share > GOOD_FIT]
    if not above:
        return []
    who = "The model or the recording"
    if hardly:
        who = f"Hardly excited parameters differ more than assumed ({join_names(hardly)}), or the model or recording"
    rows = f"{LOGGED} Otherwise " if logged else ""
    who = f"{rows}{who[0].lower()}{who[1:]}" if rows else who
    return [
        f"outputs left above their noise: {join_names(above)}; usual is {GOOD_FIT:g} at most. {who} lacks something, and the"
        " intervals do not include this; see clutch-hil discrepancy --calibration"
    ]


def measure_misfit(
    output: Output, measured: Mapping[str, Columns], simulated: Mapping[str, Columns], floor: float
) -> float:
    """Return the root mean square residual of an output, in multiples of its noise, over the rows that the model predicts.

    floor: noise of most runs, in the unit of the output. The noise is at least the accuracy of the simulation.
    """
    column = output.column
    left = [run[column] - simulated[name][column] for name, run in measured.items()]
    noise = max(pool_noise([run[column] for run in measured.values()], floor), output.accuracy)
    return float(np.sqrt(np.nanmean(np.concatenate(left) ** 2))) / noise
