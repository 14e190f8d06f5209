"""The four services under a manager, as systemd starts them: when they are ready, and whether they are alive."""

import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from protocols.realtime.child import list_command
from tests.processes import ONE_CPU
from tests.protocols.manager import PATIENCE, Manager

RATE = "250"  # Hz: as in test_services.py
WATCHDOG = 2.0  # s, that of the units
SILENCE = 1.5  # s without a ping: three periods of them


class Unit:
    """A command with a manager of its own."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.manager = Manager(str(folder / arguments[0]))
        environment = os.environ | {
            "NOTIFY_SOCKET": self.manager.address, "WATCHDOG_USEC": str(round(WATCHDOG * 1e6)),
        }  # fmt: skip
        self.process = subprocess.Popen(
            list_command(*arguments), env=environment, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )

    def await_word(self, word: str) -> list[str]:
        """What it told until `word` came."""
        return self.manager.await_word(word, lambda: self.process.poll() is None)

    def end(self) -> list[str]:
        """Stop it; return what it told then."""
        self.process.send_signal(signal.SIGTERM)
        self.process.communicate(timeout=PATIENCE)
        return self.manager.read()

    def kill(self) -> None:
        """Leave nothing."""
        self.process.kill()
        self.process.communicate()
        self.manager.close()


@pytest.fixture
def bench(local_bus: str, tmp_path: Path) -> Iterator[dict[str, Unit]]:
    """Plant and controller, in which one waits for the other."""
    common = ("--bus", local_bus, "--rate", RATE, "--no-telemetry", *ONE_CPU)
    with ExitStack() as stack:
        units = {}
        for name in ("controller", "plant"):
            units[name] = Unit(tmp_path, name, *common)
            stack.callback(units[name].kill)
            waited_for = {"controller": "samples of a plant, or rig,", "plant": "a controller"}[name]
            if name == "controller":
                sentence = units[name].await_word(f"STATUS=waits for {waited_for} on {local_bus}")
                sentence += units[name].await_word("EXTEND_TIMEOUT_USEC=30000000")
                assert "READY=1" not in sentence  # its loop does not run without a plant
        yield units


def test_plant_and_controller_are_ready_when_the_loop_is_closed_and_alive_while_it_runs(
    bench: dict[str, Unit], local_bus: str
) -> None:
    for name, does in (("controller", "controls"), ("plant", "simulates")):
        assert f"STATUS={does} at {RATE} Hz on {local_bus}" in bench[name].await_word("READY=1")
        bench[name].await_word("WATCHDOG=1")
    controller = bench["controller"]
    controller.process.send_signal(signal.SIGSTOP)
    controller.manager.read(0.6)
    controller.manager.read()
    assert controller.manager.read(SILENCE) == []  # systemd would end it
    controller.process.send_signal(signal.SIGCONT)
    controller.await_word("WATCHDOG=1")
    for unit in bench.values():
        assert "STOPPING=1" in unit.end()
        assert unit.process.returncode in (0, 1)  # 1: the controller had a fault while it was stopped


@pytest.mark.parametrize("arguments", [("record", "a.parquet"), ("view", "--web", "--no-open")])
def test_recorder_and_view_are_ready_before_a_bench_comes(arguments: tuple[str, ...], tmp_path: Path) -> None:
    unit = Unit(tmp_path, *arguments, "--bus", "local:nobody")
    try:
        assert "STATUS=waits for a bench" in unit.await_word("READY=1")
        unit.await_word("WATCHDOG=1")
        unit.await_word("WATCHDOG=1")
        unit.process.send_signal(signal.SIGSTOP)
        unit.manager.read()
        assert unit.manager.read(SILENCE) == []
        unit.process.send_signal(signal.SIGCONT)
        unit.end()
        assert unit.process.returncode == 130  # stopped before there was a result
    finally:
        unit.kill()
