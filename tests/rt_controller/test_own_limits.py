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
from rt_controller.loop.parameter_sets import OWN_LIMITS
from tests.rt_controller.node_bench import NodeBench, written

SIZED = "[guard]\nmotor_range = 393.216\npressure_range = 25\ndata_key = 2577\n"  # of the database below
LARGER = SIZED + "motor_torque = 240\nslip_speed = 62.8\npressure = 12\n"
FOLDER = TemporaryDirectory()
DATABASE = Path(FOLDER.name) / "own.dbc"
DATABASE.write_text(write_sized_text(300.0, 100.0, 25.0), encoding="utf-8")


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    for name in ("run_cycle", "receive_before_start", "load_frames"):  # which the tests replace
        monkeypatch.setattr(rt_controller.loop.node, name, getattr(rt_controller.loop.node, name))
    return rt_controller.loop.node


@contextmanager
def limited(node: ModuleType, text: str, database: Path | None = None) -> Iterator[None]:
    """A bench with the limits of a `text`, and the frames of a `database`, the shipped ones for None."""
    if database:
        node.load_frames = lambda clutch="a": load_frames(database, clutch)  # type: ignore[attr-defined]
    before = os.environ.get(OWN_LIMITS)
    with written(text) as path:
        os.environ[OWN_LIMITS] = str(path)
        try:
            yield
        finally:
            del os.environ[OWN_LIMITS]
            if before is not None:
                os.environ[OWN_LIMITS] = before
            node.load_frames = load_frames  # type: ignore[attr-defined]


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
