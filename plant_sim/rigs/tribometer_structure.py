"""The two structural models of the tribometer: torsion and normal direction, one chain with a contact in it.

What            table (1) on its dynamometers, contact, upper disk (2), shaft and coupling, drive end (3)
Equation        I_1 q_1" + c_d q_1' + k_d q_1 = f,   I_2 q_2" + c_eff (q_2' - q_3') + k_eff (q_2 - q_3) = -f,
                I_3 q_3" + c_eff (q_3' - q_2') + k_eff (q_3 - q_2) = u,   f the force of the contact on the table
                linearised: f = k_kf (q_2 - q_1) + c_kf (q_2' - q_1')                        (system equations of sec. 3.10)
                k_eff = 1/(1/k_a + 1/k_b), shaft and bellows coupling in series
Assumptions     small motion of rigid bodies in one direction
Valid range     up to 500 Hz, the band of the thesis's identification
Not modelled    tilting modes of the table and the energy sink below the first resonance (sec. 3.10)
References      Janssens 2010, sec. 3.10, fig 3.6

Torsion: q [rad], u the motor torque; the thesis's two-mass model has the motor angle q_3 as input. Normal: q [m], downwards.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import pi

import numpy as np
from scipy.linalg import eigh, expm

from protocols.errors import InputError

Array = np.ndarray


@dataclass(frozen=True)
class Chain:
    """Structure of one direction: inertias I_1, I_2, I_3; table k_d, c_d; coupling k_eff, c_eff.

    In kg m^2, Nm/rad, Nm s/rad or in kg, N/m, Ns/m. Raises InputError.
    """

    inertia: tuple[float, float, float]
    table_stiffness: float
    table_damping: float
    coupling_stiffness: float
    coupling_damping: float

    def __post_init__(self) -> None:
        """Check that nothing is without inertia or stiffness, and that no damper drives."""
        if len(self.inertia) != 3 or not min(self.inertia) > 0.0:
            raise InputError(f"the inertias of the structure are {self.inertia}; three are needed, all above 0")
        if not min(self.table_stiffness, self.coupling_stiffness) > 0.0:
            raise InputError(
                f"the stiffnesses of table and coupling are {self.table_stiffness:g} and {self.coupling_stiffness:g};"
                " both must be above 0"
            )
        if not min(self.table_damping, self.coupling_damping) >= 0.0:
            raise InputError(
                f"the dampings of table and coupling are {self.table_damping:g} and {self.coupling_damping:g};"
                " both must be 0 or more"
            )

    def make_state_space(
        self,
        contact_stiffness: float = 0.0,
        contact_damping: float = 0.0,
        drive_stiffness: float = 0.0,
        drive_damping: float = 0.0,
    ) -> tuple[Array, Array]:
        """Return a (6, 6) and B (6, 2) of x' = A x + B (f, u), x = (q_1, q_2, q_3, q_1', q_2', q_3').

        f is a further contact force on top of the linear contact, u a force at the drive end on top of the drive's own
        stiffness and damping to the frame.
        """
        stiffness = _make_chain_matrix(
            self.table_stiffness, contact_stiffness, self.coupling_stiffness, drive_stiffness
        )
        damping = _make_chain_matrix(self.table_damping, contact_damping, self.coupling_damping, drive_damping)
        inverse = np.diag(1.0 / np.array(self.inertia))
        a = np.block([[np.zeros((3, 3)), np.eye(3)], [-inverse @ stiffness, -inverse @ damping]])  # sec. 3.10
        b = np.vstack([np.zeros((3, 2)), inverse @ np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]])])
        return a, b

    def discretise(self, dt: float, drive_stiffness: float = 0.0, drive_damping: float = 0.0) -> Array:
        """Return the exact step of `dt` [s] with f and u held: (6, 8), x_after = result @ (x, f, u). Read-only."""
        return _discretise(self, dt, drive_stiffness, drive_damping)

    def compute_eigenfrequencies(self, contact_stiffness: float, drive_held: bool = False) -> Array:
        """Return the undamped eigenfrequencies [Hz], rising: (3,) with a free drive end, (2,) with the drive end held."""
        n = 2 if drive_held else 3
        stiffness = _make_chain_matrix(self.table_stiffness, contact_stiffness, self.coupling_stiffness, 0.0)[:n, :n]
        squares = eigh(stiffness, np.diag(self.inertia[:n]), eigvals_only=True)
        return np.sqrt(np.clip(squares, 0.0, None)) / (2.0 * pi)

    def transmitted_torque(self, s: Array, contact_stiffness: float, contact_damping: float = 0.0) -> Array:
        """Return T/theta_3 of the two-mass model at complex frequencies `s` [rad/s], T = -k_d theta_1; c_d and c_eff left out.

        By the system equations of sec. 3.10. The transfer function printed there has k_eff + k_d in the factor of I_2, where
        its own system equations give k_eff + k_kf.
        """
        contact, table, disk = self._compute_factors(s, contact_stiffness, contact_damping)
        k_d, k_eff = self.table_stiffness, self.coupling_stiffness
        return contact * k_eff * k_d / (contact**2 - table * disk)  # sec. 3.10, T/theta_3

    def deflection(self, s: Array, contact_stiffness: float, contact_damping: float = 0.0) -> Array:
        """Return X_1/F of the three-mass model at complex frequencies `s` [rad/s]; c_d and c_eff left out.

        By the system equations of sec. 3.10. The transfer function printed there has k_eff + k_d in the factor of m_1, where
        its own system equations give k_kf + k_d.
        """
        contact, table, disk = self._compute_factors(s, contact_stiffness, contact_damping)
        k_eff = self.coupling_stiffness
        drive = self.inertia[2] * s**2 + k_eff
        return contact * k_eff / (drive * (disk * table - contact**2) - k_eff**2 * table)  # sec. 3.10, X_1/F

    def _compute_factors(
        self, s: Array, contact_stiffness: float, contact_damping: float
    ) -> tuple[Array, Array, Array]:
        """Return the dynamic stiffness of the contact, of the table and of the disk at `s`."""
        contact = contact_damping * s + contact_stiffness
        table = self.inertia[0] * s**2 + contact + self.table_stiffness
        disk = self.inertia[1] * s**2 + contact + self.coupling_stiffness
        return contact, table, disk


@lru_cache(maxsize=64)
def _discretise(chain: Chain, dt: float, drive_stiffness: float, drive_damping: float) -> Array:
    a, b = chain.make_state_space(0.0, 0.0, drive_stiffness, drive_damping)
    held = np.zeros((8, 8))
    held[:6, :6], held[:6, 6:] = a * dt, b * dt
    step = expm(held)[:6]
    step.flags.writeable = False
    return step


def compute_response(a: Array, b: Array, c: Array, frequency: Array) -> Array:
    """Return C (s I - A)^-1 B at s = 2 pi i `frequency` [Hz] (n,): complex (n,), for one input and one output.

    Input b (m,), output c (m,).
    """
    s = 2j * pi * np.asarray(frequency, float)[:, None, None]
    solved = np.linalg.solve(s * np.eye(len(a)) - a, np.broadcast_to(b[:, None], (len(s), len(b), 1)))
    return (c @ solved)[:, 0]


def _make_chain_matrix(table: float, contact: float, coupling: float, drive: float) -> Array:
    """Return the matrix (3, 3) of springs, or of dampers, in a chain from the frame through the contact to the drive."""
    return np.array(
        [
            [table + contact, -contact, 0.0],
            [-contact, contact + coupling, -coupling],
            [0.0, -coupling, coupling + drive],
        ]
    )
