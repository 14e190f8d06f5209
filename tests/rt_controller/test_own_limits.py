"""The guard's limits of a bench of another size, by a file that CLUTCH_HIL_LIMITS names, and the law's limits that follow. Each
test has the module as argument, so that it can run on mutants (tests/mutation)."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType

import pytest

import rt_controller.loop.node
from protocols.can.frames import load_frames
from protocols.can.size import write_sized_text
from protocols.errors import InputError
from tests.rt_controller.node_bench import NodeBench, written

SIZED = "[guard]\nmotor_range = 393.216\npressure_range = 25\ndata_key = 2577\n"  # of the database below
LARGER = SIZED + "motor_torque = 240\nslip_speed = 62.8\npressure = 12\n"
FOLDER = TemporaryDirectory()
DATABASE = Path(FOLDER.name) / "own.dbc"
DATABASE.write_text(write_sized_text(300.0, 100.0, 25.0), encoding="utf-8")


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    for name in ("run_cycle", "receive_before_start", "load_defaults", "load_frames"):  # which the tests replace
        monkeypatch.setattr(rt_controller.loop.node, name, getattr(rt_controller.loop.node, name))
    return rt_controller.loop.node


@contextmanager
def limited(node: ModuleType, text: str, database: Path | None = None) -> Iterator[None]:
    """A bench with the limits of a `text`, and the frames of a `database`, the shipped ones for None."""
    if database:
        node.load_frames = lambda clutch="a": load_frames(database, clutch)  # type: ignore[attr-defined]
    before = os.environ.get(node.OWN_LIMITS)
    with written(text) as path:
        os.environ[node.OWN_LIMITS] = str(path)
        try:
            yield
        finally:
            del os.environ[node.OWN_LIMITS]
            if before is not None:
                os.environ[node.OWN_LIMITS] = before
            node.load_frames = load_frames  # type: ignore[attr-defined]


def read_value(node: ModuleType, name: str, **more: Path) -> float:
    return float(NodeBench(node, **more).node.parameters[name].value)


def test_without_such_a_file_the_shipped_limits_hold(node: ModuleType) -> None:
    assert node.load_limits()["guard.motor_torque"].value == 40.0
    assert read_value(node, "phases.motor_torque_limit") == 40.0
    assert read_value(node, "phases.speed_limit") == 26.2


def test_the_guard_and_the_limits_of_the_law_are_those_of_the_larger_bench(node: ModuleType) -> None:
    with limited(node, LARGER, DATABASE):
        made = NodeBench(node).node
        guard = made.settings["guard"][0]
        assert int(guard["motor"]) == 40000  # counts: 240 Nm of 393.216, as 40 of 65.536
        assert float(guard["turn"]) == pytest.approx(62.8 * 163840 / 6.283185307179586 * 1e-3)
        assert made.parameters["guard.motor_torque"].value == 240.0
        assert made.parameters["phases.motor_torque_limit"].value == pytest.approx(240.0)
        assert made.parameters["phases.speed_limit"].value == pytest.approx(2.0 * 26.2)
        assert int(guard["pressure"]) == 983  # counts: 12 bar of 25 bar in 2048
        assert made.parameters["lock.pressure_limit"].value == pytest.approx(4.72 / 5.0 * 12.0)
        assert made.parameters["torque.pressure_limit"].value == pytest.approx(4.5 / 5.0 * 12.0)
        assert made.parameters["torque.demand_limit"].value == pytest.approx(180.0)
        assert made.parameters["phases.contact_band"].value == pytest.approx(2.5 * 0.05)
        assert made.parameters["phases.frozen_change"].value == pytest.approx(2.5 * 0.05)
        assert made.parameters["phases.fill_timeout"].value == 1.5


def test_what_follows_the_guard_stays_within_its_own_bounds(node: ModuleType) -> None:
    with limited(node, "[guard]\npressure = 2.6\nslip_speed = 1.1\n"):
        assert read_value(node, "lock.pressure_limit") == 2.5
        assert read_value(node, "torque.pressure_limit") == 2.5
        assert read_value(node, "phases.speed_limit") == 1.0


def test_a_limit_of_the_law_that_a_user_gives_stays(node: ModuleType) -> None:
    with limited(node, LARGER, DATABASE), written("[phases]\nmotor_torque_limit = 100\n") as own:
        assert read_value(node, "phases.motor_torque_limit", parameters_file=own) == 100.0
        assert read_value(node, "phases.speed_limit", parameters_file=own) == pytest.approx(2.0 * 26.2)


def test_the_slip_is_limited_to_what_the_frames_carry(node: ModuleType) -> None:
    for database, most in ((None, 0.001 * 2**15), (DATABASE, 100.0)):
        for slip, allowed in ((most - 0.01, True), (most, True), (most + 0.01, False)):
            limits = ("[guard]\n" if database is None else SIZED) + f"slip_speed = {slip!r}\n"
            with limited(node, limits, database):
                if allowed:
                    NodeBench(node)
                    continue
                most_allowed = rf"up to {most:g} rad/s, .* frames --speed"
                sentence = rf"guard\.slip_speed of \S+\.toml has {slip:g} rad/s; allowed is {most_allowed}"
                with pytest.raises(InputError, match=sentence):
                    NodeBench(node)


def test_limits_that_are_none_or_of_another_bench_are_refused(node: ModuleType) -> None:
    for text, sentence in (
        (
            "[guard]\nmotor_torque = 240\n",
            "guard.motor_torque has 240 Nm; allowed is less than guard.motor_range, 65.536 Nm",
        ),
        (SIZED.replace("393.216", "400"), "the guard's are 0.006103515625 and 0, as guard.motor_range is 400 Nm"),
        (SIZED.replace("= 25\n", "= 20\n"), "the guard's are 0.009765625 and 0, as guard.pressure_range is 20 bar"),
        (
            SIZED.replace("2577", "2576"),
            "the key of its data IDs is 2577; guard.data_key is 2576: CLUTCH_HIL_LIMITS must name",
        ),
        (SIZED + "pressure = 24.8\n", "guard.pressure has 24.8 bar; allowed is up to 24.75 bar"),
        (LARGER + "torque = 12\n", "guard.torque"),
        ("guard", "written.toml cannot be read"),
    ):
        with limited(node, text, DATABASE), pytest.raises(InputError) as refused:
            NodeBench(node)
        assert sentence in str(refused.value)


def test_a_file_that_is_missing_is_named(node: ModuleType) -> None:
    with limited(node, LARGER, DATABASE):
        os.environ[node.OWN_LIMITS] = "no_such.toml"
        with pytest.raises(InputError, match=r"no_such\.toml"):
            NodeBench(node)
