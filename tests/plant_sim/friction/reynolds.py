"""The 1-D Reynolds equation under a Rayleigh step, solved numerically by finite volumes: knows nothing of the closed forms."""

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_banded

Array = np.ndarray


class Film(NamedTuple):
    """Pressure [Pa] at the nodes `x` [-]; load, and the forces along x per dh/L, all [Pa]; uncut and cut at p = 0."""

    x: Array
    pressure: Array
    load: float
    cut_load: float
    plate_drag: float  # on the moving plate
    cut_plate_drag: float
    step_shear: float  # on the stepped surface, without the face of the step
    face_force: float  # of the pressure on the face of the step


def solve(alpha: float, gap: float, sliding: float, squeeze: float, cells: int = 2000) -> Film:
    """Solve d/dx(h^3 dp/dx - Lambda h) = s with p = 0 at both ends; `cells` in each of the two zones."""
    width = np.r_[np.full(cells, 1.0 / cells), np.full(cells, alpha / cells)]
    height = np.r_[np.full(cells, gap + 1.0), np.full(cells, gap)]
    x = np.r_[0.0, np.cumsum(width)]
    conductance = height**3 / width
    # Balance of the volume around each inner node: flux in the cell right of it minus flux in the cell left of it.
    source = 0.5 * squeeze * (width[1:] + width[:-1]) + sliding * np.diff(height)
    bands = np.zeros((3, 2 * cells - 1))
    bands[0, 1:] = conductance[1:-1]
    bands[1] = -(conductance[1:] + conductance[:-1])
    bands[2, :-1] = conductance[1:-1]
    pressure = np.r_[0.0, solve_banded((1, 1), bands, source), 0.0]
    cut = np.maximum(pressure, 0.0)
    couette = sliding / 6.0 * np.sum(width / height)
    poiseuille, cut_poiseuille = (0.5 * np.sum(height * np.diff(p)) for p in (pressure, cut))
    return Film(
        x,
        pressure,
        np.trapezoid(pressure, x),
        np.trapezoid(cut, x),
        couette + poiseuille,
        couette + cut_poiseuille,
        couette - poiseuille,
        float(pressure[cells]),
    )
