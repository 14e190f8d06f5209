"""Motion of a loaded Rayleigh-step bearing on its oil film: one step, or two steps back to back.

What            gap, lift-up speed and friction for a played sliding number
Equation        M h'' + W = W_n(h, sigma h', Lambda(t));  M = 0: the quasi-static motion W_n = W                       (2.53)
                several faces share h: W_n = sum_j W_n(d_j Lambda), F_f = sum_j d_j F_f(d_j Lambda), d_j = 1 narrows and
                d_j = -1 widens at Lambda > 0
Assumptions     as rayleigh_step; the body does not tilt; the pressure is 0 between faces (secs. 2.3.2, 2.4.1)
Valid range     h > 0: the film never lets the body touch, and below Lambda_0 the gap closes for ever
Not modelled    contact with the wall (generic_rayleigh)
References      Janssens 2010, sec. 2.3.3

Integrated by the stiffly accurate three-stage SDIRK of third order (R. Alexander, SIAM J. Numer. Anal. 14 (1977) 1006), with
embedded second-order weights for the step width. A stage is one equation in h', the same with and without mass.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from plant_sim.friction.model import LARGEST, Array, check_real, require, require_type
from plant_sim.friction.rayleigh_step import friction, load_and_rate, steady_gap
from protocols.errors import InputError

TOLERANCE = 1e-7  # of the gap, in one step
NEWTON_STEPS = 100  # most iterations of a search; it needs 3 to 6
LEAST_STEP = 1e-12  # of the sample interval; a step this small is accepted whatever its error

# Alexander 1977, table 1: root of g^3 - 3 g^2 + 3 g/2 - 1/6 = 0, third order and L-stable
_G = 0.43586652150845899942
_T2 = 0.5 * (1.0 + _G)  # time of the second stage
_A21 = 0.5 * (1.0 - _G)
_B1 = -0.25 * (6.0 * _G**2 - 16.0 * _G + 1.0)
_B2 = 0.25 * (6.0 * _G**2 - 20.0 * _G + 5.0)
_E1, _E2 = _G / (1.0 - _G), (1.0 - 2.0 * _G) / (1.0 - _G)  # second order, from the first two stages


@njit(cache=True)
def faces_load(faces, alpha, gap, sliding, squeeze, gap_rate, squeeze_rate):
    """Return W_n [Pa] of all faces, and its derivative when gap and squeeze change at the given rates."""
    load = rate = 0.0
    for direction in faces:
        one, one_rate = load_and_rate(alpha, gap, direction * sliding, squeeze, gap_rate, squeeze_rate)
        load += one
        rate += one_rate
    return load, rate


@njit(cache=True)
def faces_friction(faces, alpha, gap, sliding, squeeze, slope):
    """Return F_f [Pa] of all faces."""
    force = 0.0
    for direction in faces:
        force += direction * friction(alpha, gap, direction * sliding, squeeze, slope)
    return force


@njit(cache=True)
def squeeze_at_load(faces, alpha, gap, sliding, load):
    """Return s = sigma h' [Pa] at which all faces carry `load` [Pa] at `gap`: the quasi-static motion (sec. 2.3.3).

    Without the cut W_n is linear in s; with it W_n is convex and falls with s, so Newton's method rises from the uncut solution
    onto the root.
    """
    wide = gap + 1.0
    share = 0.5 * alpha * (1.0 + alpha) / (gap**3 + alpha * wide**3)
    resistance = 0.5 * share * (1.0 + alpha) + (1.0 / wide**3 + (alpha / gap) ** 3) / 12.0
    squeeze = (share * sliding * faces.sum() - load) / (resistance * faces.size)  # 2.49
    for _ in range(NEWTON_STEPS):
        carried, rate = faces_load(faces, alpha, gap, sliding, squeeze, 0.0, 1.0)
        change = (carried - load) / rate
        squeeze -= change
        if abs(change) <= 1e-14 * abs(squeeze):
            break
    return squeeze


@njit(cache=True)
def lift_speed(faces, alpha, squeeze_number, mass, load, sliding, gap, speed, duration, guess):
    """Return h' at the end of an implicit stage of `duration`.

    M (h' - speed)/duration + W = W_n(gap + duration h', sigma h', Lambda).

    `gap` and `speed` are those the stage starts from; Newton's method between bounds that hold the root, from `guess`.
    """
    lower = -gap / duration  # the film carries any load there
    upper = max(guess, 0.5 * lower)
    width = max(abs(upper), -lower)
    inertia = mass / duration
    for _ in range(NEWTON_STEPS):
        carried, _ = faces_load(faces, alpha, gap + duration * upper, sliding, squeeze_number * upper, 0.0, 0.0)
        if inertia * (upper - speed) + load > carried:
            break
        upper += width
        width *= 2.0
    now = min(max(guess, 0.5 * lower), upper)
    for _ in range(NEWTON_STEPS):
        carried, rate = faces_load(
            faces, alpha, gap + duration * now, sliding, squeeze_number * now, duration, squeeze_number
        )
        residual = inertia * (now - speed) + load - carried  # 2.53
        if residual > 0.0:
            upper = now
        else:
            lower = now
        steepness = inertia - rate
        following = now - residual / steepness if steepness > 0.0 else 0.5 * (lower + upper)
        if not lower < following < upper:
            following = 0.5 * (lower + upper)
        change = following - now
        now = following
        if abs(change) <= 1e-10 * abs(now) or abs(change) * duration <= 1e-15 * gap:
            break
    return now


@njit(cache=True)
def play(faces, alpha, squeeze_number, mass, load, sliding, dt, gaps, speeds):
    """Integrate eq 2.53 for `sliding` (n,), linear between samples `dt` apart; gaps[0] and speeds[0] are the start."""
    gap, speed = gaps[0], speeds[0]
    step = dt
    for i in range(1, sliding.size):
        start, slope = sliding[i - 1], (sliding[i] - sliding[i - 1]) / dt
        time = 0.0
        while time < dt:
            left = dt - time
            width = left if step >= left * (1.0 - 1e-9) else step
            stage = _G * width
            at = start + slope * (time + stage)
            k1 = lift_speed(faces, alpha, squeeze_number, mass, load, at, gap, speed, stage, speed)
            a1 = (k1 - speed) / stage
            base, base_speed = gap + _A21 * width * k1, speed + _A21 * width * a1
            at = start + slope * (time + _T2 * width)
            k2 = lift_speed(faces, alpha, squeeze_number, mass, load, at, base, base_speed, stage, k1)
            a2 = (k2 - base_speed) / stage
            base, base_speed = gap + width * (_B1 * k1 + _B2 * k2), speed + width * (_B1 * a1 + _B2 * a2)
            at = start + slope * (time + width)
            safe = base > 0.0
            k3 = lift_speed(faces, alpha, squeeze_number, mass, load, at, base, base_speed, stage, k2) if safe else k2
            following = base + stage * k3
            error = abs(following - gap - width * (_E1 * k1 + _E2 * k2)) / (TOLERANCE * gap)
            if safe and not (error > 1.0 and width > LEAST_STEP * dt):
                time = dt if width == left else time + width
                gap, speed = following, k3
            if not safe or width == step or error > 1.0:
                step = width * (0.2 if not safe else min(5.0, max(0.2, 0.9 * max(error, 1e-12) ** (-1.0 / 3.0))))
        gaps[i], speeds[i] = gap, speed


@dataclass(frozen=True)
class Motion:
    """At every sample: `gap` h [-], its derivative `speed` [-], film `load` W_n and `friction` F_f [Pa]."""

    gap: Array
    speed: Array
    load: Array
    friction: Array


@dataclass(frozen=True)
class StepBearing:
    """A body on Rayleigh steps: `faces` are 1 (narrows at Lambda > 0) or -1; (1, -1) is two steps back to back.

    `alpha` length of the narrow zone over that of the wide one [-], `slope` dh/L [-], `squeeze_number` sigma [Pa], `mass` M
    [Pa] of eq 2.53 (0: quasi-static). Raises InputError.
    """

    alpha: float
    slope: float
    squeeze_number: float
    mass: float = 0.0
    faces: tuple[int, ...] = (1,)

    def __post_init__(self) -> None:
        require("length ratio alpha", self.alpha, above=0.0, most=1e6)
        require("step slope dh/L", self.slope, above=0.0, most=1e6)
        require("squeeze number sigma", self.squeeze_number, above=0.0, unit="Pa")
        require("bearing mass", self.mass, least=0.0, unit="Pa")
        require_type("faces of the bearing", self.faces, tuple)
        if not self.faces or not set(self.faces) <= {1, -1}:
            raise InputError(f"faces of the bearing are {self.faces}; allowed are one or more of 1 and -1")

    def motion(self, sliding: Array, dt: float, load: float, gap: float | None = None) -> Motion:
        """Return the motion under `load` W [Pa] for `sliding` Lambda [Pa] (n,), `dt` [-] apart and linear between.

        Starts at `gap` [-] with the quasi-static speed; without one, at the gap of steady sliding at sliding[0].
        Raises InputError.
        """
        sliding = check_real("sliding [Pa]", sliding)
        require("load", load, above=0.0, unit="Pa")
        require("time step", dt, above=0.0)
        if sliding.ndim != 1 or sliding.size < 1:
            raise InputError(f"sliding has shape {sliding.shape}; one value or more is needed, in one dimension")
        if gap is None:
            gap = self.steady_gap(float(sliding[0]), load)
        require("gap at the start", gap, above=0.0)
        gaps, speeds = np.empty(sliding.size), np.empty(sliding.size)
        faces = np.array(self.faces, float)
        gaps[0] = gap
        args = (faces, float(self.alpha), float(self.squeeze_number))
        speeds[0] = squeeze_at_load(faces, float(self.alpha), gap, sliding[0], load) / self.squeeze_number
        play(*args, float(self.mass), float(load), sliding, float(dt), gaps, speeds)
        return Motion(gaps, speeds, *_forces(*args, self.slope, gaps, speeds, sliding))

    def steady_gap(self, sliding: float, load: float) -> float:
        """Return the gap [-] in steady sliding at `sliding` [Pa] under `load` [Pa]; 0 where no film carries it.

        Raises InputError.
        """
        require("sliding", sliding, least=-LARGEST, unit="Pa")
        require("load", load, above=0.0, unit="Pa")
        carrying = self.faces.count(1 if sliding > 0.0 else -1)  # the widening faces cavitate
        return float(steady_gap(self.alpha, abs(sliding), load / carrying)) if carrying else 0.0

    def stribeck(self, sliding: Array, load: float) -> Array:
        """Return the friction [Pa] in steady sliding for `sliding` [Pa] (n,), NaN where no film carries `load` [Pa].

        Raises InputError.
        """
        sliding = np.atleast_1d(check_real("sliding [Pa]", sliding))
        gaps = np.array([self.steady_gap(float(value), load) for value in sliding])
        faces = np.array(self.faces, float)
        return np.array(
            [
                faces_friction(faces, self.alpha, gap, value, 0.0, self.slope) if gap > 0.0 else np.nan
                for gap, value in zip(gaps, sliding, strict=True)
            ]
        )


@njit(cache=True)
def _forces(faces, alpha, squeeze_number, slope, gaps, speeds, sliding):
    load, force = np.empty(gaps.size), np.empty(gaps.size)
    for i in range(gaps.size):
        squeeze = squeeze_number * speeds[i]
        load[i], _ = faces_load(faces, alpha, gaps[i], sliding[i], squeeze, 0.0, 0.0)
        force[i] = faces_friction(faces, alpha, gaps[i], sliding[i], squeeze, slope)
    return load, force
