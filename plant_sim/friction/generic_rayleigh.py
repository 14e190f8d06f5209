"""Generic-Rayleigh model: the Generic model whose tips, once they slip fast enough, ride on an oil film.

What            stick, dry slip and wet slip of N asperities, each tip two Rayleigh steps back to back (fig 2.21)
Equation        as `generic` in stick and dry slip. Wet: W_n(h_i, sigma h_i', Lambda) = W_i/A, without mass      (2.50, 2.53)
                F_i = A [F_f(Lambda) - F_f(-Lambda)]                                                            (2.51)
                W_i = k_n (1 - z_i - z_b + dh (h_i - h_thr))                                               (2.4, lifted)
                dry slip becomes wet where Lambda >= r(h_thr) W_i/A (`tip_film`), wet becomes dry below it (sec. 2.4.2)
Assumptions     those of `generic` and `rayleigh_step`. A wet tip moves with the body: its spring is stiff beside the film.
                The film begins as thick as makes its shear the force of dry slip; falling dry, the tip sticks and its spring
                carries the force on: so the force is continuous ("the transition must be done based on the friction force that
                occurs at dry slip"). A tip that loses contact loses its film.
Valid range     as `generic`, its limit of the displacement too; dh h much smaller than the deflection of the asperities
Not modelled    oil between the tips, the film a tip brings to a step, starvation; a limit of the shear stress of thin films:
                while V grows faster than the film lifts, its shear exceeds the force of dry slip
References      Janssens 2010, sec. 2.4

The load balance sees the films of the step before; the films see their own spring at the end of the step (backward Euler).
Below the threshold the law is that of the Generic model to the bit.
State: that of the Generic model, then the gap h of each film (N), 0 where there is none.
"""

from dataclasses import dataclass
from functools import cached_property
from math import ceil

import numpy as np
from numba import njit

from plant_sim.friction import asperity_contact as contact
from plant_sim.friction import kernel
from plant_sim.friction.asperity_model import OBSERVE_SIGNATURE, AsperityModel
from plant_sim.friction.generic import FixedSeparationModel, GenericModel, split_parameters
from plant_sim.friction.model import Array, check_real, require_type
from plant_sim.friction.step_bearing import faces_friction, lift_speed, squeeze_at_load
from plant_sim.friction.tip_film import SlidingThreshold, TipFilm, check_threshold
from protocols.errors import InputError

FILM_SIZE = 9  # numbers before those of the Generic model
FACES = np.array([1.0, -1.0])  # back to back
BISECTIONS = 60
FIRST_GAP_RANGE = 1e6  # largest first gap over that of the threshold; a film that thick has no shear
SAMPLES_PER_PITCH = 50  # a pitch, in `steady_state`; as in `generic`
MOST_STROKES = 40  # at most, in `steady_state`, until the mean of one changes by less than SETTLED
STEADY_TOLERANCE = 1e-4


@njit(cache=True)
def film_force(gap, sliding, pressure, alpha, slope):
    """Return the shear of a film of `gap` h [-] that carries `pressure` W/A at `sliding` Lambda, over A.

    Its quasi-static squeeze is included.
    """
    return faces_friction(FACES, alpha, gap, sliding, squeeze_at_load(FACES, alpha, gap, sliding, pressure), slope)


@njit(cache=True)
def first_gap(shear, sliding, pressure, alpha, slope, threshold):
    """Return the gap h [-], at least `threshold`, at which the film's shear over A is `shear`: both positive."""
    thin, thick = threshold, threshold * FIRST_GAP_RANGE
    if film_force(thin, sliding, pressure, alpha, slope) <= shear:
        return thin
    for _ in range(BISECTIONS):
        middle = (thin * thick) ** 0.5
        if film_force(middle, sliding, pressure, alpha, slope) > shear:
            thin = middle
        else:
            thick = middle
    return thick


@njit(cache=True)
def tip_contact(
    film, gap, force, stick_time, mode, travelled, displacement, dt, stiffness, normal, deflection, mu_0, mu_inf, tau
):
    """Return the force, stick time, mode and gap of one tip after `displacement` in `dt`.

    `deflection` zeta > 0 at the begin of the step. `film`: the first FILM parameters.
    """
    alpha, slope, area, rise, per_velocity, squeeze_number, ratio, threshold, dry_below = film
    load = normal * deflection  # 2.5
    sliding = per_velocity * abs(displacement) / dt  # 2.55
    if gap > 0.0:
        spring = normal * rise / area
        inertia = spring * dt**2
        speed = lift_speed(FACES, alpha, squeeze_number, inertia, load / area, sliding, gap, 0.0, dt, 0.0)  # 2.53
        gap += dt * speed
        pressure = load / area + spring * dt * speed
        if sliding >= ratio * pressure or gap > dry_below:
            moves = 1.0 if displacement > 0.0 else -1.0 if displacement < 0.0 else 0.0
            shear = faces_friction(FACES, alpha, gap, sliding, squeeze_number * speed, slope)  # 2.51
            return moves * area * shear, 0.0, moves if moves != 0.0 else mode, gap
    force, stick_time, mode = contact.adhesive_contact(
        force, stick_time, mode, travelled, displacement, dt, stiffness, load, mu_0, mu_inf, tau
    )
    slips = mode != contact.STICK and mode * displacement > 0.0
    if slips and sliding >= ratio * load / area:
        return force, stick_time, mode, first_gap(abs(force) / area, sliding, load / area, alpha, slope, threshold)
    return force, stick_time, mode, 0.0


@kernel.law
def wet_law(parameters, state, displacement, dt, load, new_state):
    """Advance the Generic-Rayleigh model and return its friction; `parameters`: of the film, then of the Generic model."""
    film, dry = parameters[:FILM_SIZE], parameters[FILM_SIZE:]
    block = (film[0], film[1], film[2], film[3], film[4], film[5], film[6], film[7], film[8])
    position, height, tangential, normal, mass, edges, up, down = split_parameters(dry)
    mu_0, mu_inf, tau, period, longest = dry[2:7]
    n = position.size
    new_state[:] = state
    asperities = new_state[: 4 * n].reshape(4, n)
    force, stick_time, mode, place = asperities[0], asperities[1], asperities[2], asperities[3]
    gap = new_state[4 * n + 3 :]
    travelled, reach = np.empty(n), np.empty(n)
    steps = max(1, ceil(abs(displacement) / longest))
    travel, tick = displacement / steps, dt / steps
    inertia, damping = dry[7] / tick / tick, dry[8] / tick
    total = 0.0
    for _ in range(steps):
        contact.search_contacts(
            new_state[4 * n], travel, position, height, tangential, edges, period,
            force, stick_time, mode, place, travelled, reach,
        )  # fmt: skip
        new_state[4 * n] += travel
        for i in range(n):
            if gap[i] > 0.0:
                if mode[i] == contact.FREE:
                    gap[i] = 0.0  # the film is left behind
                else:
                    reach[i] += film[3] * (gap[i] - film[7])  # the tip rests on the boundary layer at h_thr
        before, rate = new_state[4 * n + 1], new_state[4 * n + 2]
        offset = max(load, 0.0) - damping * before - inertia * (before + rate * tick)
        separation = contact.balanced_separation(reach, normal, offset, damping + inertia, before)
        new_state[4 * n + 1], new_state[4 * n + 2] = separation, (separation - before) / tick
        total = 0.0
        for i in range(n):
            deflection = reach[i] - separation  # 2.4
            if deflection > 0.0:
                force[i], stick_time[i], mode[i], gap[i] = tip_contact(
                    block, gap[i], force[i], stick_time[i], mode[i], travelled[i], travel, tick,
                    tangential[i], normal[i], deflection, mu_0, mu_inf, tau,
                )  # fmt: skip
                total += force[i]
            else:
                force[i], stick_time[i], mode[i], gap[i] = 0.0, 0.0, contact.FREE, 0.0
        total += contact.inertial_force(travel / tick, height, separation, mass, place, up if travel > 0.0 else down)
    return total


@njit(OBSERVE_SIGNATURE, cache=True)
def _observe(law, parameters, state, position, dt, load, sums):
    """Play `position` from `state`, which becomes the last; write the sums of `RegimeCounts` to `sums` (5, n)."""
    n = int(parameters[FILM_SIZE])
    mode, gap = state[2 * n : 3 * n], state[4 * n + 3 :]
    for k in range(position.size):
        sums[0, k] = law(parameters, state, position[k] - position[k - 1], dt, load[k], state) if k > 0 else 0.0
        sums[1, k] = state[4 * n + 1]
        sums[2:, k] = 0.0
        for i in range(n):
            if mode[i] == contact.FREE:
                continue
            sums[2 if mode[i] == contact.STICK else 4 if gap[i] > 0.0 else 3, k] += 1.0


@dataclass(frozen=True)
class RegimeCounts:
    """At every sample (n,): friction `force`, `separation` z_b, and the numbers of tips in `stick`, `dry` and `wet` slip.

    `state` is the last.
    """

    force: Array
    separation: Array
    stick: Array
    dry: Array
    wet: Array
    state: Array


@dataclass(frozen=True, eq=False)
class GenericRayleighModel(AsperityModel):
    """The model `dry` (Generic, with load balance) whose tips have a `film` in slip above a `threshold`. Raises InputError."""

    law = staticmethod(wet_law)

    dry: GenericModel
    film: TipFilm
    threshold: SlidingThreshold

    def __post_init__(self) -> None:
        require_type("dry model", self.dry, GenericModel)
        require_type("film", self.film, TipFilm)
        require_type("threshold", self.threshold, SlidingThreshold)
        if isinstance(self.dry, FixedSeparationModel):
            raise InputError(
                "the dry model has a fixed separation; it needs a load balance, so that a film can lift the body"
            )
        check_threshold(self.film, self.threshold, self.dry.friction.mu_0, self.dry.friction.mu_inf)

    @cached_property
    def parameters(self) -> Array:
        """The parameters as the law takes them, float64 (9 + those of the Generic model,)."""
        f, t = self.film, self.threshold
        tip = (f.alpha, f.slope, f.area, f.step, f.sliding_per_velocity, f.squeeze_number)
        film = (*tip, f.ratio(t.gap), t.gap, t.dry_below)
        return np.concatenate((film, self.dry.parameters))

    @property
    def longest(self) -> float:
        """The longest displacement of one sample: that of the dry model."""
        return self.dry.longest

    def rest(self, load: float = 1.0) -> Array:
        """Return the state of a body just put down under `load`: undeflected, in stick where it touches, without films.

        Raises InputError.
        """
        return np.concatenate((self.dry.rest(load), np.zeros(self.dry.asperities.position.size)))

    def gaps(self, state: Array) -> Array:
        """Return the gap h [-] of each film, (..., N); 0 without film."""
        return state[..., -self.dry.asperities.position.size :]

    def observe(
        self, position: Array, dt: float, load: Array | float = 1.0, state: Array | None = None
    ) -> RegimeCounts:
        """Return the sums over the asperities at every sample of `position` (n,), `dt` apart, under `load` (scalar or (n,)).

        Begins as `trace` does. Raises InputError.
        """
        (force, separation, stick, dry, wet), last = self.play(_observe, position, dt, load, state)
        return RegimeCounts(force, separation, stick, dry, wet, last)

    def steady_state(self, velocity: Array | float, load: float = 1.0) -> Array:
        """Return the mean force of long sliding at constant `velocity`, same shape; 0 at velocity 0. Found by sliding.

        The mean is over a stroke of one period of the surface, or one unit, once it repeats to 1e-4. Raises InputError.
        """
        return np.vectorize(lambda v: self._compute_mean_force(float(v), load), otypes=[float])(
            check_real("velocity", velocity)
        )

    def _compute_mean_force(self, velocity: float, load: float) -> float:
        if velocity == 0.0:
            return 0.0
        surface = self.dry.surface
        pitches = max(1, surface.edges.size // 2)
        travel = surface.period / (pitches * SAMPLES_PER_PITCH)
        stroke = np.copysign(travel, velocity) * np.arange(pitches * SAMPLES_PER_PITCH + 1)
        state, before, mean = self.rest(load), np.inf, 0.0
        for _ in range(MOST_STROKES):
            run = self.observe(stroke, travel / abs(velocity), load, state)
            state, mean = run.state, float(run.force[1:].mean())
            if abs(mean - before) <= STEADY_TOLERANCE * abs(mean):
                break
            before = mean
        return mean
