"""Counter surface of the Generic model: rigid steps of unit height with recesses between them.

What            a 0/1 profile of N_w steps, repeated without end; "fill degree" is the part of the length that is step
Equation        edges e_0 < e_1 < ...; the asperity tip is over step j where e_2j <= s < e_2j+1
Assumptions     rigid and at rest; periodic (chosen: the thesis says nothing of the ends, and a stroke must not meet them)
Valid range     any width above 0
Not modelled    the floor of the recesses (nothing touches it), slopes of the steps, wear
References      Janssens 2010, sec. 2.2.2, figs 2.1 and 2.2

Segments are counted upwards without end: an even number is a step, an odd number the recess above it.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from plant_sim.friction.model import Array, check_element_values, require
from plant_sim.friction.whole_number import require_whole
from protocols.errors import InputError

LEAST_WIDTH = 0.2  # of the mean width; chosen: a drawn width below it is set to it, so that no width is 0 or negative


@njit(inline="always")
def edge(segment, edges, period):
    """Return the position of the lower edge of `segment` (any integer); `edges` (2 N_w,) of one `period`."""
    turn = segment // edges.size
    return edges[segment - turn * edges.size] + turn * period


@njit(cache=True)
def segment_at(position, hint, edges, period):
    """Return the number of the segment at `position`, found by walking from segment `hint`."""
    segment = hint
    while position >= edge(segment + 1, edges, period):
        segment += 1
    while position < edge(segment, edges, period):
        segment -= 1
    return segment


@dataclass(frozen=True, eq=False)
class CounterSurface:
    """Steps of unit height, `width` (N_w,) each, each followed by a recess `gap` (N_w,); lengths in any one unit.

    Raises InputError.
    """

    width: Array
    gap: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "width", check_element_values("step width", self.width))
        object.__setattr__(self, "gap", check_element_values("recess width", self.gap))
        if self.width.size != self.gap.size:
            raise InputError(f"surface has {self.width.size} steps and {self.gap.size} recesses; each step needs one")

    @classmethod
    def draw(
        cls, steps: int, rng: np.random.Generator, fill: float = 0.5, pitch: float = 0.2, spread: float = 0.3
    ) -> "CounterSurface":
        """Draw a surface of `steps` steps N_w, `fill` degree [-] and mean `pitch` (step and recess).

        Widths are normal with the standard deviation `spread` [-] of their mean, then scaled to the fill degree exactly.
        Raises InputError.
        """
        require_whole("number of steps", steps)
        require("fill degree", fill, above=0.0, most=1.0 - 1e-6)
        require("pitch", pitch, above=0.0)
        require("spread of the widths", spread, least=0.0, most=10.0)
        drawn = np.maximum(1.0 + spread * rng.standard_normal((2, steps)), LEAST_WIDTH)
        width, gap = drawn / drawn.mean(axis=1, keepdims=True)
        return cls(width * pitch * fill, gap * pitch * (1.0 - fill))

    @property
    def edges(self) -> Array:
        """Edges of one period (2 N_w,), the first at 0."""
        lengths = np.column_stack((self.width, self.gap)).ravel()
        return np.concatenate(([0.0], np.cumsum(lengths)[:-1]))

    @property
    def period(self) -> float:
        """Length after which the surface repeats."""
        return float(self.width.sum() + self.gap.sum())

    @property
    def narrowest(self) -> float:
        """Width of the narrowest step or recess: the longest travel in which an asperity passes one edge at most."""
        return float(min(self.width.min(), self.gap.min()))

    @property
    def inverse_pitch(self) -> tuple[Array, Array]:
        """1 / ((1 + alpha) w) of each segment (2 N_w,), moving up and moving down.

        A recess belongs to the step that is left when it is entered: "the following recess" of eq 2.9.
        """
        up = self.width + self.gap
        down = self.width + np.roll(self.gap, 1)
        return 1.0 / np.repeat(up, 2), 1.0 / np.column_stack((down, np.roll(down, -1))).ravel()


@dataclass(frozen=True)
class FlatSurface:
    """One step without end: "totally flat, without pits or recess" (fig 2.8)."""

    edges: ClassVar[Array] = np.array([-np.inf, np.inf])
    period: ClassVar[float] = 1.0  # of no effect, but finite
    narrowest: ClassVar[float] = np.inf
    inverse_pitch: ClassVar[tuple[Array, Array]] = (np.zeros(2), np.zeros(2))
