"""The structure of the virtual tribometer is the thesis's: transfer functions, eigenfrequencies, steps."""

from dataclasses import replace

import numpy as np
import pytest

from clutch_hil.thesis.tribometer.tribometer_identification import stiffness as dry_stiffness
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.rigs.tribometer import Tribometer, load_nominal, make_chains
from plant_sim.rigs.tribometer_structure import Chain, compute_response
from protocols.errors import InputError

TANGENTIAL, NORMAL = make_chains(load_nominal())
BARE_TANGENTIAL, BARE_NORMAL = (replace(c, table_damping=0.0, coupling_damping=0.0) for c in (TANGENTIAL, NORMAL))
FREQUENCY = np.linspace(1.0, 500.0, 300)  # Hz, the band of sec. 3.10
S = 2j * np.pi * FREQUENCY
STIFFNESS, DAMPING = 3.0e4, 5.0  # Nm/rad and Nm s/rad, of a contact


def make_held_motor(chain: Chain) -> tuple[np.ndarray, np.ndarray]:
    """State space of the two-mass model of fig 3.6(a): the motor angle is the input."""
    a, _ = chain.make_state_space(STIFFNESS, DAMPING)
    kept = [0, 1, 3, 4]
    return a[np.ix_(kept, kept)], a[kept, 2]


def test_the_transfer_function_of_torsion_is_that_of_the_state_space() -> None:
    a, b = make_held_motor(BARE_TANGENTIAL)
    torque = compute_response(a, b, np.array([-BARE_TANGENTIAL.table_stiffness, 0.0, 0.0, 0.0]), FREQUENCY)
    np.testing.assert_allclose(BARE_TANGENTIAL.transmitted_torque(S, STIFFNESS, DAMPING), torque, rtol=1e-9)


def test_the_transfer_function_of_the_normal_direction_is_that_of_the_state_space() -> None:
    a, b = BARE_NORMAL.make_state_space(4e7, 4e3)
    table = compute_response(a, b[:, 1], np.eye(6)[0], FREQUENCY)
    np.testing.assert_allclose(BARE_NORMAL.deflection(S, 4e7, 4e3), table, rtol=1e-9)


def test_at_rest_the_springs_are_in_series() -> None:
    k_d, k_eff = TANGENTIAL.table_stiffness, TANGENTIAL.coupling_stiffness
    series = 1.0 / (1.0 / k_d + 1.0 / STIFFNESS + 1.0 / k_eff)
    assert TANGENTIAL.transmitted_torque(np.array([0j]), STIFFNESS)[0] == pytest.approx(-series, rel=1e-12)
    assert NORMAL.deflection(np.array([0j]), 4e7)[0] == pytest.approx(1.0 / NORMAL.table_stiffness, rel=1e-12)


@pytest.mark.parametrize("chain", [BARE_TANGENTIAL, BARE_NORMAL])
def test_eigenfrequencies_are_the_poles_of_the_state_space(chain: Chain) -> None:
    poles = np.linalg.eigvals(chain.make_state_space(STIFFNESS)[0])
    assert np.abs(poles.real).max() < 1e-6 * np.abs(poles).max()
    result = np.sort(poles.imag[poles.imag > 0.0]) / (2.0 * np.pi)
    np.testing.assert_allclose(chain.compute_eigenfrequencies(STIFFNESS), result, rtol=1e-6)


def test_resonances_are_those_of_section_3_10() -> None:
    stiffness = Tribometer(MaxwellSlip(np.ones(1), np.ones(1))).contact_stiffness
    table_alone = np.sqrt(TANGENTIAL.table_stiffness / TANGENTIAL.inertia[0])  # as the hammer test finds it
    assert table_alone / (2.0 * np.pi) == pytest.approx(222.0, abs=0.5)
    assert TANGENTIAL.compute_eigenfrequencies(dry_stiffness(1400.0))[0] == pytest.approx(170.0, abs=0.5)
    assert NORMAL.compute_eigenfrequencies(float(stiffness(58.0)))[0] == pytest.approx(186.0, abs=0.5)
    assert NORMAL.compute_eigenfrequencies(float(stiffness(1200.0)))[1] == pytest.approx(288.0, abs=0.5)


def test_eigenfrequencies_with_the_drive_held_lie_between_those_with_it_free() -> None:
    free, held = (
        TANGENTIAL.compute_eigenfrequencies(STIFFNESS),
        TANGENTIAL.compute_eigenfrequencies(STIFFNESS, drive_held=True),
    )
    assert free[0] < held[0] < free[1] < held[1] < free[2]


def test_two_steps_are_one_of_twice_the_length() -> None:
    once, twice = TANGENTIAL.discretise(2e-4), TANGENTIAL.discretise(1e-4)
    again = twice[:, :6] @ twice + np.hstack([np.zeros((6, 6)), twice[:, 6:]])
    np.testing.assert_allclose(again, once, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    "changed", [{"inertia": (1.0, 0.0, 1.0)}, {"table_stiffness": 0.0}, {"coupling_damping": -1.0}]
)
def test_what_is_no_structure_is_refused(changed: dict[str, object]) -> None:
    with pytest.raises(InputError, match=r"above 0|0 or more"):
        replace(TANGENTIAL, **changed)  # type: ignore[arg-type]
