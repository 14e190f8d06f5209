"""A folder of its own for the local buses of each test, and other processes on them."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.protocols.local_bus.participants import Process


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("CLUTCH_HIL_BUS_DIR", str(tmp_path))
    return tmp_path


@pytest.fixture
def start() -> Iterator[Callable[..., Process]]:
    processes: list[Process] = []

    def start_one(script: str, *arguments: str) -> Process:
        processes.append(Process(script, *arguments))
        return processes[-1]

    yield start_one
    for process in processes:
        process.popen.kill()
        process.popen.communicate()
