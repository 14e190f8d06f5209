"""The joint fit: where it ends in a bent valley, as that of C_v, gamma and the zeros of two speeds; what it knows roughly."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from clutch_hil.fitting.evidence import Point
from clutch_hil.fitting.fit import FreeParameter
from clutch_hil.identify.clutch_effects import SPEED
from clutch_hil.identify.free_parameters import know_roughly
from clutch_hil.identify.joint_fit import _settle, shorten_step


class Valley:
    """Evidence whose residuals (2,) are like those of Rosenbrock's valley: their least cost is 0 at x = y = 1."""

    redundancy = 1.0

    def compute_residuals(self, points: Sequence[Point]) -> list[np.ndarray]:
        return [30.0 * np.array([5.0 * (p["y"] - p["x"] ** 2), 1.0 - p["x"]]) for p, _ in points]


@pytest.mark.parametrize("start", [(-1.2, 1.0), (0.0, 0.0), (3.0, 9.0)])
def test_in_a_bent_valley_the_fit_goes_on_to_the_end(start: tuple[float, float]) -> None:
    evidence: Any = Valley()
    free = [shorten_step(FreeParameter(name, 0.2, 1.0, -10.0, 10.0)) for name in "xy"]
    at = _settle(evidence, (dict(zip("xy", start, strict=True)), {}), free)
    assert at.cost < 1.0
    assert at.point[0]["x"] == pytest.approx(1.0, abs=0.05)


def test_what_the_runs_hardly_excite_is_known_roughly() -> None:
    """A parameter to 15 % of its value, an effect to what is usual; in the middle is what it is without the runs."""
    parameter = know_roughly(FreeParameter("oil.viscous_gain", 0.01, 0.1, 0.5, 10.0), 2.0)
    assert (parameter.centre, parameter.scale, parameter.step) == (2.0, pytest.approx(0.3), 0.01)
    offset = know_roughly(FreeParameter(SPEED, 0.006, 0.03, -5.0, 5.0), 0.0)
    assert (offset.centre, offset.scale) == (0.0, pytest.approx(0.3))
