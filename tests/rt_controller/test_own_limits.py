"""The guard's limits of a bench of another size, by a file that CLUTCH_HIL_LIMITS names, and the law's limits that follow."""

from pathlib import Path

import pytest

from protocols.can.frames import load_frames
from protocols.can.size import write_sized_text
from protocols.errors import InputError
from rt_controller.loop import node
from rt_controller.loop.node import OWN_LIMITS, ControllerNode, load_limits

LARGER = "[guard]\nmotor_range = 393.216\nmotor_torque = 240\nslip_speed = 62.8\n"


@pytest.fixture
def larger(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A bench of 300 Nm and 100 rad/s; the file with its limits."""
    database, limits = tmp_path / "own.dbc", tmp_path / "limits.toml"
    database.write_text(write_sized_text(300.0, 100.0), encoding="utf-8")
    limits.write_text(LARGER)
    monkeypatch.setenv(OWN_LIMITS, str(limits))
    monkeypatch.setattr(node, "load_frames", lambda clutch="a": load_frames(database, clutch))
    return limits


def test_without_such_a_file_the_shipped_limits_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(OWN_LIMITS, raising=False)
    assert load_limits()["guard.motor_torque"].value == 40.0
    assert ControllerNode().parameters["phases.motor_torque_limit"].value == 40.0


@pytest.mark.usefixtures("larger")
def test_the_guard_and_the_limits_of_the_law_are_those_of_the_larger_bench() -> None:
    made = ControllerNode()
    guard = made.settings["guard"][0]
    assert int(guard["motor"]) == 40000  # counts: 240 Nm of 393.216, as 40 of 65.536
    assert float(guard["turn"]) == pytest.approx(2.0 * float(31.4 * 163840 / 6.283185307179586 * 1e-3))
    assert made.parameters["phases.motor_torque_limit"].value == pytest.approx(240.0)
    assert made.parameters["phases.speed_limit"].value == pytest.approx(2.0 * 26.2)


@pytest.mark.usefixtures("larger")
def test_a_limit_of_the_law_that_a_user_gives_stays(tmp_path: Path) -> None:
    own = tmp_path / "controller.toml"
    own.write_text("[phases]\nmotor_torque_limit = 100\n")
    assert ControllerNode(parameters_file=own).parameters["phases.motor_torque_limit"].value == 100.0


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[guard]\nmotor_torque = 240\n", "guard.motor_torque has 240 Nm; allowed is less than guard.motor_range, 65.536 Nm"),
        ("[guard]\nmotor_range = 400\n", "the guard's are 0.006103515625 and 0, as guard.motor_range is 400 Nm"),
        (LARGER.replace("62.8", "150"), "guard.slip_speed has 150 rad/s; allowed is up to 100 rad/s"),
        (LARGER + "pressure = 12\n", "guard.pressure"),
        (LARGER + "torque = 12\n", "guard.torque"),
        ("guard", "limits.toml cannot be read"),
    ],
)  # fmt: skip
def test_limits_that_are_none_or_of_another_bench_are_refused(larger: Path, text: str, told: str) -> None:
    larger.write_text(text)
    with pytest.raises(InputError) as refused:
        ControllerNode()
    assert told in str(refused.value)


def test_a_file_that_is_missing_is_named(larger: Path) -> None:
    larger.unlink()
    with pytest.raises(InputError, match=r"limits\.toml"):
        ControllerNode()
