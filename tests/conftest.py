"""How the tests share the machine, and fixtures for all of them.

`make test` plays them on three workers (pytest-xdist): one has the soak to itself, ten minutes that are mostly waited for; the
other two share all that computes or waits, and when that is done one of them plays what measures time, with nothing beside it
but the soak. Without workers the tests run in the same order, one after the other.
"""

import fcntl
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path, PurePath
from typing import Any

import pytest

import protocols  # noqa: F401  # sets the number of BLAS threads before numpy is imported

TESTS = Path(__file__).parent
SOAK = "telemetry/test_soak.py"
LONGEST = "test_reproductions.py"  # begins first, so that nobody waits for it at the end
# These measure time, or hold a bench at 1 kHz to what it is on a machine that is not full.
QUIET = (
    "effects/test_effect_speed.py",
    "live/test_view.py",
    "telemetry",
    "test_can_log.py",
    "test_clock.py",
    "test_jitter.py",
    "test_local_bus.py",
    "test_timing_budget.py",
)
# These run services, or wait for threads, in real time (`python -m tests` tells what follows from that).
IN_REAL_TIME = (
    *QUIET,
    "discrepancy/test_demonstration.py",
    "effects/test_plug_in.py",
    "live",
    "test_cycle.py",
    "test_exchange.py",
    "test_power_shift_bus.py",
    "test_realtime.py",
    "test_replay.py",
    "test_scenario.py",
    "test_services.py",
    "test_triggered_services.py",
    "test_turn.py",
    "vcan",
)
ORDER = ("soak", "longest", "shared", "quiet")
_KERNELS = pytest.StashKey[str]()


@cache
def turn(file: str) -> str:
    """When the tests of a file, named from the folder of this one, have their turn: one of `ORDER`."""
    if file in (SOAK, LONGEST):
        return "soak" if file == SOAK else "longest"
    return "quiet" if _in(file, QUIET) else "shared"


def in_real_time(file: str) -> bool:
    """Whether tests of a file depend on what else the machine does."""
    return _in(file, IN_REAL_TIME)


def _in(file: str, places: tuple[str, ...]) -> bool:
    return any(PurePath(file).is_relative_to(place) for place in places)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: ORDER.index(turn(item.path.relative_to(TESTS).as_posix())))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """A worker gets a file at a time, in the order of the tests, but all that is quiet together."""
    from xdist.scheduler import LoadFileScheduling

    class Turns(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = super()._split_scope(nodeid)
            return "quiet" if turn(file.removeprefix(f"{TESTS.name}/")) == "quiet" else file

    config.option.loadscopereorder = False
    return Turns(config, log)


def pytest_configure(config: pytest.Config) -> None:
    """All workers and their processes share kernels in a place of their own, before Numba is imported.

    What services run is compiled before the workers begin: who waits for a service does not wait for a compiler, thrice at once
    on two CPUs. What the rest needs, one worker compiles and all have. Likewise pytest's own form of the tests is made once.
    """
    if hasattr(config, "workerinput"):
        _save_one_after_the_other()
    elif config.getoption("numprocesses", None):
        config.stash[_KERNELS] = os.environ["NUMBA_CACHE_DIR"] = tempfile.mkdtemp(prefix="clutch-hil-kernels-")
        compilers = [
            subprocess.Popen([sys.executable, "-m", "tests.kernels", side], cwd=TESTS.parent)
            for side in ("plant", "shift", "controller")
        ]
        subprocess.run(  # what it finds wrong, workers find, too
            [sys.executable, "-m", "pytest", "--collect-only", "-qq"],
            cwd=TESTS.parent, env=os.environ | {"PYTEST_ADDOPTS": ""}, stdout=subprocess.DEVNULL, check=False,
        )  # fmt: skip
        for compiler in compilers:
            if compiler.wait():
                raise pytest.UsageError(f"{compiler.args} ended with {compiler.returncode}")


def _save_one_after_the_other() -> None:
    """Two processes that compile one function for different types at once can give both the same file (Numba's cache has no
    lock), and the next to load it would run the code of the other type. So saving takes a lock."""
    from numba.core.caching import IndexDataCacheFile

    lock, save = Path(os.environ["NUMBA_CACHE_DIR"]) / "lock", IndexDataCacheFile.save

    def locked(self: Any, key: Any, data: Any) -> None:
        with lock.open("w") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            save(self, key, data)

    IndexDataCacheFile.save = locked  # type: ignore[method-assign]


def pytest_unconfigure(config: pytest.Config) -> None:
    if _KERNELS in config.stash:
        shutil.rmtree(config.stash[_KERNELS], ignore_errors=True)


@pytest.fixture
def local_bus(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A local bus of its own, for this process and those it starts."""
    folder = tempfile.mkdtemp(prefix="ch-")  # short: socket paths hold 107 bytes
    monkeypatch.setenv("CLUTCH_HIL_BUS_DIR", folder)
    yield "local:bench"
    shutil.rmtree(folder)
