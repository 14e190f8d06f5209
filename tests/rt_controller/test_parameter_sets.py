"""The parameters of a controller and its guard, as its files give them. Each test has the module as argument, so that it can
run on mutants (tests/mutation)."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from types import ModuleType

import pytest

import rt_controller.loop.parameter_sets
from protocols.can.frames import FrameCodec, load_frames
from protocols.errors import InputError
from protocols.files.parameters import load_defaults
from tests.mutation.mutants import load_mutant, parse_plain
from tests.rt_controller.node_bench import written

SIZED = "[guard]\nmotor_range = 393.216\npressure_range = 25\ndata_key = 2577\n"
LARGER = SIZED + "motor_torque = 240\nslip_speed = 62.8\npressure = 12\n"
MOTOR: FrameCodec = load_frames()["MOTOR_COMMAND"]

_load_once = cache(load_defaults)  # the two files do not change


@pytest.fixture
def parameter_sets() -> ModuleType:
    module = load_mutant(parse_plain(rt_controller.loop.parameter_sets))
    module.load_defaults = _load_once  # type: ignore[attr-defined]
    return module


@contextmanager
def limited(text: str) -> Iterator[None]:
    """The guard's limits changed by a file with a `text`."""
    before = os.environ.pop("CLUTCH_HIL_LIMITS", None)
    with written(text) as path:
        os.environ["CLUTCH_HIL_LIMITS"] = str(path)
        try:
            yield
        finally:
            del os.environ["CLUTCH_HIL_LIMITS"]
            if before is not None:
                os.environ["CLUTCH_HIL_LIMITS"] = before


# --- files -----------------------------------------------------------------------------------------------------------


def make_calibration(rig: str) -> str:
    parts = "".join(
        f"[{part}.torque]\ndemand_limit = {value}\n" for part, value in (("controller", 21.0), ("controller_b", 22.0))
    )
    return f'[calibration]\nrig = "{rig}"\n{parts}'


def test_parameters_are_those_of_the_file_that_changes_the_shipped_ones(parameter_sets: ModuleType) -> None:
    shipped = parameter_sets.load_controller_parameters()
    assert shipped["torque.demand_limit"].value == 30.0
    assert "guard.pressure" not in shipped
    with written("[torque]\ndemand_limit = 12.5\n") as path:
        changed = parameter_sets.load_controller_parameters(path)
        assert {name for name in shipped if changed[name] != shipped[name]} == {"torque.demand_limit"}
        assert parameter_sets.load_node_parameters(path)["torque.demand_limit"].value == 12.5


def test_of_a_calibration_each_controller_takes_its_part(parameter_sets: ModuleType) -> None:
    for clutch, rig, part, demand in (
        (None, "wet_clutch", "controller", 21.0), ("a", "power_shift", "controller", 21.0),
        ("b", "power_shift", "controller_b", 22.0),
    ):  # fmt: skip
        assert parameter_sets.name_calibration_part(clutch) == part
        with written(make_calibration(rig)) as path:
            for load in (parameter_sets.load_controller_parameters, parameter_sets.load_node_parameters):
                assert load(path, clutch)["torque.demand_limit"].value == demand


def test_a_calibration_of_another_rig_is_refused(parameter_sets: ModuleType) -> None:
    for clutch, rig, other in ((None, "wet_clutch", "power_shift"), ("b", "power_shift", "wet_clutch")):
        with written(make_calibration(other)) as path, pytest.raises(InputError, match=f"allowed is '{rig}'"):
            parameter_sets.load_controller_parameters(path, clutch)
    assert (parameter_sets.RIG, parameter_sets.RIG_OF_TWO) == ("wet_clutch", "power_shift")


def test_the_shipped_parameters_are_those_of_controller_and_guard(parameter_sets: ModuleType) -> None:
    shipped = parameter_sets.load_shipped_parameters()
    assert {"torque.demand_limit", "guard.pressure"} <= set(shipped)
    assert parameter_sets.load_node_parameters() == shipped


def test_the_values_of_the_layout_are_those_that_describe_the_database(parameter_sets: ModuleType) -> None:
    assert parameter_sets.select_layout_values(parameter_sets.load_limits()) == {
        "motor_range": 65.536, "pressure_range": 10.0, "data_key": 0.0,
    }  # fmt: skip


# --- contradictions --------------------------------------------------------------------------------------------------


def test_the_voltage_may_reach_the_guards_limit_and_no_more(parameter_sets: ModuleType) -> None:
    with written("[pressure]\nvoltage_limit = 4.0\n") as path:
        parameter_sets.load_node_parameters(path)
    with written("[pressure]\nvoltage_limit = 4.125\n") as path, pytest.raises(InputError) as refused:
        parameter_sets.load_node_parameters(path)
    assert str(refused.value) == "parameter pressure.voltage_limit = 4.125 V is above the guard's limit of 4 V"


CONTRADICTIONS = {
    "[torque]\npressure_limit = 9.0": "torque.pressure_limit = 9 bar is above the guard's limit of 5 bar",
    "[lock]\npressure_limit = 5.1": "lock.pressure_limit = 5.1 bar is above the guard's limit of 5 bar",
    "[pressure]\nslow_above = 6.0": "pressure.slow_above = 6 bar is above the guard's limit of 5 bar",
    "[phases]\nmotor_torque_limit = 60.0": "phases.motor_torque_limit = 60 Nm is above the guard's limit of 40 Nm",
    "[phases]\nfill_pressure = 2.0": "model.contact_pressure = 2.35 bar is not below phases.fill_pressure = 2 bar",
    "[model]\ncontact_pressure = 6.0\n[phases]\nfill_pressure = 2.6": (
        "model.contact_pressure = 6 bar is not below phases.fill_pressure = 2.6 bar"
    ),
    "[model]\ncontact_pressure = 4.5": "model.contact_pressure = 4.5 bar is not below torque.pressure_limit = 4.5 bar",
    "[phases]\nlost_pressure = 2.35": "phases.lost_pressure = 2.35 bar is not below model.contact_pressure = 2.35 bar",
    "[phases]\nreleased_pressure = 3.0": "phases.released_pressure = 3 bar is not below model.contact_pressure",
}


def test_parameters_that_contradict_each_other_are_refused(parameter_sets: ModuleType) -> None:
    for text, sentence in CONTRADICTIONS.items():
        with written(f"{text}\n") as path, pytest.raises(InputError) as refused:
            parameter_sets.load_node_parameters(path)
        assert sentence in str(refused.value)
        if "is not below" in sentence:
            assert str(refused.value).endswith("would count as open while it is closed: change one of them")


def test_two_gears_must_differ(parameter_sets: ModuleType) -> None:
    with written("[driveline]\nratio_a = 2.0\n") as path, pytest.raises(InputError) as refused:
        parameter_sets.load_node_parameters(path)
    assert str(refused.value) == "parameters driveline.ratio_a and driveline.ratio_b are both 2; two gears must differ"
    with written("[driveline]\nratio_a = 1.5\n") as path:
        parameter_sets.load_node_parameters(path)


def test_limits_that_protect_from_nothing_are_refused(parameter_sets: ModuleType) -> None:
    text = parameter_sets.LIMITS.read_text()
    assert text.count("[1.0, 59.4]") == 1
    with written(text.replace("[1.0, 59.4]", "[1.0, 70.0]")) as path:
        parameter_sets.LIMITS = path  # type: ignore[attr-defined]
        with pytest.raises(InputError, match=r"guard\.pressure has 70 bar"):
            parameter_sets.load_node_parameters()


# --- pressures that follow the contact pressure ----------------------------------------------------------------------

MAPS = ("model.coulomb_intercept", "model.viscous_intercept", "model.beta_onset")
FOLLOWING = ("phases.released_pressure", "phases.lost_pressure", "pressure.floor", "phases.fill_pressure")


def test_the_pressures_that_a_file_leaves_out_follow_its_contact_pressure(parameter_sets: ModuleType) -> None:
    shipped = parameter_sets.load_controller_parameters()
    for contact in (0.3, 1.2, 3.9, 10.0):
        with written(f"[model]\ncontact_pressure = {contact}\n") as path:
            own = parameter_sets.load_controller_parameters(path)
        share = contact / shipped["model.contact_pressure"].value
        assert {name for name in shipped if own[name] != shipped[name]} == {
            "model.contact_pressure", *FOLLOWING, *MAPS,
        }  # fmt: skip
        for name in FOLLOWING[:3]:
            assert own[name].value == pytest.approx(share * shipped[name].value, rel=1e-12)
        assert own["phases.fill_pressure"].value == pytest.approx(contact + 0.25, abs=1e-12)


def test_a_pressure_that_a_file_gives_does_not_follow(parameter_sets: ModuleType) -> None:
    given = (
        "[model]\ncontact_pressure = 1.2\n[phases]\nlost_pressure = 0.2\n[pressure]\nfloor = 2.0\n"  # 2.0: as shipped
    )
    with written(given) as path:
        own = parameter_sets.load_controller_parameters(path)
        assert [own[name].value for name in FOLLOWING[1:3]] == [0.2, 2.0]
        assert own["phases.released_pressure"].value < 0.6
    with written("[torque]\ndemand_limit = 12.5\n") as path:  # without a contact pressure nothing follows
        own, shipped = parameter_sets.load_controller_parameters(path), parameter_sets.load_controller_parameters()
        assert [own[name] for name in FOLLOWING] == [shipped[name] for name in FOLLOWING]


TORQUES = ("phases.torque_mismatch", "phases.touch_torque", "trim.floor", "lock.rate", "adaptation.torque_floor")
TORQUE_GAINS = ("torque.proportional_gain", "torque.integral_gain")


def test_thresholds_and_torque_gains_follow_a_slope_of_another_size(parameter_sets: ModuleType) -> None:
    shipped = parameter_sets.load_controller_parameters()
    for slope, size in ((108.0, 10.0), (2.16, 0.2), (20.0, 1.0), (5.5, 1.0)):
        with written(f"[model]\ncoulomb_slope = {slope}\n[lock]\nleast = 7.0\n") as path:
            own = parameter_sets.load_controller_parameters(path)
        for name in TORQUES:
            assert own[name].value == pytest.approx(size * shipped[name].value, rel=1e-12)
        for name in TORQUE_GAINS:
            assert own[name].value == pytest.approx(shipped[name].value / size, rel=1e-12)
        assert own["lock.least"].value == 7.0  # as given
        assert own["pressure.integral_gain"] == shipped["pressure.integral_gain"]


def test_a_slow_valve_of_a_large_clutch_has_both_factors(parameter_sets: ModuleType) -> None:
    shipped, slow = parameter_sets.load_controller_parameters(), "[pressure]\nvalve_frequency = 10.0\n"
    with written(slow) as path:
        slower = parameter_sets.load_controller_parameters(path)["pressure.integral_gain"].value
    slower /= shipped["pressure.integral_gain"].value
    assert slower < 0.5
    with written(f"[model]\ncoulomb_slope = 54.0\n{slow}") as path:
        own = parameter_sets.load_controller_parameters(path)
    assert own["lock.rate"].value == pytest.approx(5.0 * slower * shipped["lock.rate"].value, rel=1e-12)
    assert own["torque.integral_gain"].value == pytest.approx(
        slower / 5.0 * shipped["torque.integral_gain"].value, rel=1e-12
    )
    assert own["pressure.slow_rate"].value == pytest.approx(slower * shipped["pressure.slow_rate"].value, rel=1e-12)


def test_what_follows_keeps_its_bounds(parameter_sets: ModuleType) -> None:
    with written("[model]\ncoulomb_slope = 0.1\n") as path:
        own = parameter_sets.load_controller_parameters(path)
    assert own["phases.touch_torque"].value == own["phases.touch_torque"].bounds[0]
    assert own["torque.proportional_gain"].value == own["torque.proportional_gain"].bounds[1]


# --- limits of the law that follow the guard's -----------------------------------------------------------------------


def test_without_a_file_of_limits_the_shipped_ones_hold(parameter_sets: ModuleType) -> None:
    values = parameter_sets.load_node_parameters()
    assert [values[name].value for name in ("guard.motor_torque", "phases.motor_torque_limit")] == [40.0, 40.0]
    assert values["phases.speed_limit"].value == 26.2


def test_the_limits_of_the_law_follow_those_of_a_larger_bench(parameter_sets: ModuleType) -> None:
    with limited(LARGER):
        own = parameter_sets.load_node_parameters()
    expected = {
        "guard.motor_torque": 240.0, "phases.motor_torque_limit": 240.0, "phases.speed_limit": 2.0 * 26.2,
        "lock.pressure_limit": 4.72 / 5.0 * 12.0, "torque.pressure_limit": 4.5 / 5.0 * 12.0, "torque.demand_limit": 180.0,
        "phases.contact_band": 2.5 * 0.05, "phases.frozen_change": 2.5 * 0.05, "phases.fill_timeout": 1.5,
    }  # fmt: skip
    assert {name: own[name].value for name in expected} == pytest.approx(expected)


def test_what_follows_the_guard_stays_within_its_own_bounds(parameter_sets: ModuleType) -> None:
    with limited("[guard]\npressure = 2.6\nslip_speed = 1.1\n"):
        own = parameter_sets.load_node_parameters()
    assert [own[f"{part}.pressure_limit"].value for part in ("lock", "torque")] == [2.5, 2.5]
    assert own["phases.speed_limit"].value == 1.0


def test_a_limit_of_the_law_that_a_user_gives_stays(parameter_sets: ModuleType) -> None:
    with limited(LARGER), written("[phases]\nmotor_torque_limit = 100\n") as path:
        own = parameter_sets.load_node_parameters(path)
    assert own["phases.motor_torque_limit"].value == 100.0
    assert own["phases.speed_limit"].value == pytest.approx(2.0 * 26.2)


def test_a_slip_limit_above_what_the_frames_carry_is_refused(parameter_sets: ModuleType) -> None:
    most = 0.001 * 2**15  # rad/s, a signed signal of 16 bits
    for slip in (most - 0.01, most):
        with limited(f"[guard]\nslip_speed = {slip!r}\n"):
            parameter_sets.check_slip_limit(parameter_sets.load_limits(), MOTOR)
    with limited(f"[guard]\nslip_speed = {most + 0.01!r}\n"):
        limits = parameter_sets.load_limits()
        sentence = (
            r"guard\.slip_speed of \S+\.toml has 32\.778 rad/s; allowed is up to 32\.768 rad/s, .* frames --speed"
        )
        with pytest.raises(InputError, match=sentence):
            parameter_sets.check_slip_limit(limits, MOTOR)
    with pytest.raises(InputError, match=r"guard\.slip_speed has 32\.778 rad/s"):  # the limits of an own limits.toml
        parameter_sets.check_slip_limit(limits, MOTOR)


def test_a_file_of_limits_that_cannot_be_read_is_named(parameter_sets: ModuleType) -> None:
    with limited(LARGER):
        os.environ["CLUTCH_HIL_LIMITS"] = "no_such.toml"
        with pytest.raises(InputError, match=r"no_such\.toml"):
            parameter_sets.load_limits()
