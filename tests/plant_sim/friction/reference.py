"""GMS and XGMS written from the thesis's equations with numpy and scipy: no step of ours, every change of mode an event."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

Array = np.ndarray
STICK, SLIP, WAIT = 0, 1, 2


@dataclass(frozen=True)
class Piece:
    """A stretch of motion without reversal: `duration` [s], velocity [m/s] of time since its start, load [N] and its rate."""

    duration: float
    velocity: Callable[[float], float]
    load: Callable[[float], float] = lambda t: 1.0
    load_rate: Callable[[float], float] = lambda t: 0.0


@dataclass(frozen=True)
class Reference:
    """n elements with stiffness k_i and weights alpha_i under s(v) = F_s (1 + (beta - 1) exp(-V_S/|v|)).

    `static_force` gives F_s [N] of the load and `static_slope` its derivative. `normalised`: XGMS,
    attraction C [1/s] of the normalised force m_i, F_i = m_i F_s; else GMS, attraction C [N/s]. `bounded`: passive XGMS, where
    a spring that cannot be stretched so fast waits: F_i grows by k_i |v| until it is m_i F_s.
    """

    static_force: Callable[[float], float]
    static_slope: Callable[[float], float]
    beta: float
    stribeck_velocity: float
    attraction: float
    stiffness: Array
    weights: Array
    normalised: bool
    bounded: bool
    resolution: int = 20  # least number of steps a piece; two events that fall into one step are missed

    def _compute_level(self, piece: Piece, t: float) -> float:
        """s(v)/F_s, without sign (1.5)."""
        return 1.0 + (self.beta - 1.0) * np.exp(-self.stribeck_velocity / abs(piece.velocity(t)))

    def _compute_share_rate(self, piece: Piece, t: float, share: Array) -> Array:
        """dm_i/dt of slip, along the motion (6.2.3)."""
        return self.attraction * (self.weights - share / self._compute_level(piece, t))

    def _compute_slip_rate(self, piece: Piece, t: float, along: Array, share: Array) -> Array:
        """dF_i/dt of slip, along the motion."""
        F_s = self.static_force(piece.load(t))
        if not self.normalised:
            return self.attraction * (self.weights - along / (F_s * self._compute_level(piece, t)))  # 5.4
        load_part = share * self.static_slope(piece.load(t)) * piece.load_rate(t)
        return F_s * self._compute_share_rate(piece, t, share) + load_part  # of F_i = m_i F_s

    def play(self, pieces: Sequence[Piece]) -> Array:
        """Sum of the element forces [N] at the end of every piece, from rest."""
        n = self.stiffness.size
        force, share, mode, last, ends = np.zeros(n), np.zeros(n), np.full(n, STICK), 0.0, []
        for piece in pieces:
            t = 0.0
            sign = float(np.sign(piece.velocity(0.5 * piece.duration)))
            if sign != last:
                mode = np.full(n, STICK)  # a reversal or a standstill
            last = sign
            along = sign * force
            while sign and t < piece.duration:
                t, along, share, mode = self._go_to_next_change(piece, t, along, share, mode)
            force = sign * along if sign else force
            ends.append(force.sum())
        return np.array(ends)

    def _go_to_next_change(self, piece: Piece, t: float, along: Array, share: Array, mode: Array):
        n, k = self.stiffness.size, self.stiffness

        def signs(t: float, y: Array) -> Array:
            """For each element what falls to 0 where its mode ends."""
            along, share = y[:n], y[n:]
            F_s = self.static_force(piece.load(t))
            to_slip = self.weights * F_s * self._compute_level(piece, t) - along  # W_i = alpha_i s(v)
            stretch = k * abs(piece.velocity(t)) - self._compute_slip_rate(piece, t, along, share)
            slips = stretch if self.bounded else np.ones(n)
            return np.where(mode == STICK, to_slip, np.where(mode == SLIP, slips, share * F_s - along))

        def rates(t: float, y: Array) -> Array:
            along, share = y[:n], y[n:]
            slip = self._compute_slip_rate(piece, t, along, share)
            return np.concatenate(
                [
                    np.where(mode == SLIP, slip, k * abs(piece.velocity(t))),  # 5.4
                    np.where(mode == STICK, 0.0, self._compute_share_rate(piece, t, share)),
                ]
            )

        def switched(t: float, along: Array, share: Array, mode: Array, ended: Array, old: int):
            F_s = self.static_force(piece.load(t))
            ended = ended & (mode == old)
            share = np.where(ended & (old == STICK), along / F_s, share)
            along = np.where(ended & (old == WAIT), share * F_s, along)
            return along, share, np.where(ended, WAIT if old == SLIP else SLIP, mode)

        for old, bound in ((STICK, 1e-12), (WAIT, -1e-12), (SLIP, -1e-12)):  # the velocity may jump between pieces
            along, share, mode = switched(t, along, share, mode, signs(t, np.r_[along, share]) <= bound, old)
        events = []
        for i in range(n):

            def ends(t: float, y: Array, i: int = i) -> float:
                return float(signs(t, y)[i])

            ends.terminal, ends.direction = True, -1.0
            events.append(ends)
        solution = solve_ivp(
            rates,
            (t, piece.duration),
            np.concatenate([along, share]),
            events=events,
            rtol=1e-11,
            atol=1e-13,
            max_step=piece.duration / self.resolution,
        )
        along, share = solution.y[:n, -1], solution.y[n:, -1]
        t, ended = solution.t[-1], np.array([times.size > 0 for times in solution.t_events])
        before = mode
        for old in (STICK, WAIT, SLIP):
            along, share, mode = switched(t, along, share, mode, ended & (before == old), old)
        return t, along, share, mode
