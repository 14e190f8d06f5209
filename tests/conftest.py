"""How the tests share the machine, and fixtures for all of them.

`make test` plays them on workers (pytest-xdist), one more than CPUs. As long as there is something to compute, a part of them
does so, at low priority. The others play what runs in real time: first the soak, ten minutes that are mostly waited for, and
beside it what measures time. Without workers the tests run one after the other.
"""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path, PurePath
from typing import Any

import pytest
from hypothesis import settings

import protocols  # noqa: F401  # sets the number of BLAS threads before numpy is imported
from tests import first_start

TESTS = Path(__file__).parent
SOAK = "protocols/telemetry/test_soak.py"
# These two begin first of what computes, so that nobody waits for them at the end.
LONGEST = "clutch_hil/thesis/test_reproductions.py"
GUEST = "test_guest.py"
BOOT = "test_boot.py"  # a guest too, with systemd
# These measure time, or hold a bench at 1 kHz to what it is on a machine that is not full.
QUIET = (
    "plant_sim/effects/test_effect_speed.py",
    "clutch_hil/live/test_view.py",
    "protocols/local_bus",
    "protocols/telemetry",
    "clutch_hil/bench/test_can_log.py",
    "protocols/test_clock.py",
    "clutch_hil/bench/test_jitter.py",
    "clutch_hil/bench/test_timing_budget.py",
)
# These run services, or wait for threads, in real time, as the guest and each test on a `local_bus` do (`python -m tests` tells
# what follows from that).
IN_REAL_TIME = (
    *QUIET,
    "benchmarks/test_fault_matrix.py",
    "benchmarks/test_kills.py",
    "benchmarks/test_mutated_requests.py",
    "clutch_hil/discrepancy/test_demonstration.py",
    "clutch_hil/identify/test_identification_set.py",
    "plant_sim/effects/test_plug_in.py",
    "clutch_hil/live",
    "rt_controller/test_cycle.py",
    "protocols/test_exchange.py",
    "plant_sim/test_plant_calls.py",
    "plant_sim/test_plant_turn.py",
    "clutch_hil/bench/test_faults_told.py",
    "clutch_hil/bench/test_power_shift_bus.py",
    "protocols/test_realtime.py",
    "rt_controller/test_replay.py",
    "clutch_hil/bench/test_scenario_run.py",
    "clutch_hil/bench/test_services.py",
    "clutch_hil/bench/test_triggered_services.py",
    "rt_controller/test_turn.py",
    "vcan",
)
# These compute for long; `make quick` leaves them out, and what runs in real time.
SLOW = (
    "benchmarks",
    "clutch_hil/bench/test_bench_of_another_size.py",
    "clutch_hil/bench/test_every_state.py",
    "clutch_hil/bench/test_junit.py",
    "clutch_hil/bench/test_third_rig.py",
    "clutch_hil/bench/test_two_clutches.py",
    "clutch_hil/bench/test_units_tell.py",
    "clutch_hil/discrepancy",
    "clutch_hil/fitting",
    "clutch_hil/identify",
    "clutch_hil/recordings/test_bus_log_damage.py",
    "clutch_hil/recordings/test_hdf5_in_child.py",
    "clutch_hil/recordings/test_text_damage.py",
    "clutch_hil/test_public_api.py",
    "clutch_hil/thesis",
    "mutation",
    "plant_sim/effects",
    "plant_sim/friction",
    "plant_sim/test_wet_clutch_effects.py",
    "test_first_minute.py",
    "test_guest.py",
    "test_boot.py",
    "test_needs.py",
    "booted",
)
ORDER = ("soak", "quiet", "longest", "guest", "boot", "shared")
# The CPU time of a run, 58 to 72 min, is less than the soak's ten minutes on eight CPUs; a worker had up to 1.3 GB
MOST_WORKERS = 9
CPUS = len(os.sched_getaffinity(0))
LOW = 10  # nice value of what computes: beside what runs in real time it has a tenth of a CPU that both want
_KERNELS = pytest.StashKey[str]()

# An example that a busy machine gave no CPU for a while is no wrong one.
settings.register_profile("shared machine", deadline=None)
settings.load_profile("shared machine")


@cache
def choose_turn(file: str) -> str:
    """When the tests of a file, named from the folder of this one, have their turn: one of `ORDER`."""
    alone = {SOAK: "soak", LONGEST: "longest", GUEST: "guest", BOOT: "boot"}
    return alone.get(file) or ("quiet" if _is_in(file, QUIET) else "shared")


def is_real_time(file: str) -> bool:
    """Whether tests of a file depend on what else the machine does."""
    return _is_in(file, IN_REAL_TIME)


@cache  # asked for every test: without it a fifth of what collecting takes
def _is_in(file: str, places: tuple[str, ...]) -> bool:
    return any(PurePath(file).is_relative_to(place) for place in places)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        file = item.path.relative_to(TESTS).as_posix()
        if is_real_time(file) or file in (GUEST, BOOT) or "local_bus" in getattr(item, "fixturenames", ()):
            item.add_marker("real_time")
        if _is_in(file, SLOW):
            item.add_marker("slow")
    items.sort(key=lambda item: ORDER.index(choose_turn(item.path.relative_to(TESTS).as_posix())))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """Workers for `--numprocesses auto`: one for each CPU, and one more where what waits in real time is played, too."""
    return min(CPUS + (not config.option.markexpr), MOST_WORKERS)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """A worker gets a file at a time, in the order of the tests, but all that is quiet together; as long as there is something
    else, half of them play in real time, of two CPUs two."""
    from xdist.scheduler import LoadFileScheduling

    most_timed = 1 + CPUS // 2

    class Turns(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = super()._split_scope(nodeid)
            return "quiet" if choose_turn(_make_name(file)) == "quiet" else file

        def _assign_work_unit(self, node: Any) -> None:
            others = (work for other, work in self.assigned_work.items() if other is not node)
            busy = [_timed(scope) for work in others for scope, done in work.items() if not all(done.values())]
            wanted = (scope for scope in self.workqueue if _timed(scope) == (sum(busy) < most_timed))
            self.workqueue.move_to_end(next(wanted, next(iter(self.workqueue))), last=False)
            super()._assign_work_unit(node)

    def _timed(scope: str) -> bool:
        return scope == "quiet" or is_real_time(_make_name(scope))

    config.option.loadscopereorder = False
    return Turns(config, log)


def _make_name(path: str) -> str:
    """A file from the folder of this one."""
    return path.removeprefix(f"{TESTS.name}/")


@pytest.fixture(autouse=True, scope="module")
def _priority(request: pytest.FixtureRequest) -> None:
    """What computes does so at low priority; root alone may have its own back afterwards."""
    if os.geteuid() == 0:
        file = request.path.relative_to(TESTS).as_posix()
        os.setpriority(os.PRIO_PROCESS, 0, 0 if is_real_time(file) or file in (GUEST, BOOT) else LOW)


def pytest_configure(config: pytest.Config) -> None:
    """All workers and their processes share kernels in a place of their own, before Numba is imported.

    What services run is compiled before the workers begin: who waits for a service does not wait for a compiler, thrice at once
    on two CPUs. The first start of a bench does that, of which test_first_minute.py judges what it said. What the rest needs,
    one worker compiles and all have. Likewise pytest's own form of the tests is made once
    and kept even where the environment wants no byte code: else each worker would make it again.
    """
    if (
        signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    ):  # begun in the background of a shell; services would inherit that
        signal.signal(signal.SIGINT, signal.default_int_handler)
    whole = not config.option.markexpr  # a part, as of `make quick`, has the kernels beside the sources, from before
    if not whole:
        sys.dont_write_bytecode = False  # pytest's form of the tests stays for the next time: 12 s of CPU time a worker
    if not hasattr(config, "workerinput") and config.getoption("numprocesses", None) and whole:
        config.stash[_KERNELS] = os.environ["NUMBA_CACHE_DIR"] = tempfile.mkdtemp(prefix="clutch-hil-kernels-")
        record = os.environ[first_start.RECORD] = f"{config.stash[_KERNELS]}/first_start.json"
        compilers = [
            subprocess.Popen([sys.executable, "-m", *words], cwd=TESTS.parent)
            for words in (("tests.first_start", record), ("tests.kernels",))
        ]
        subprocess.run(  # what it finds wrong, workers find, too
            [sys.executable, "-m", "pytest", "--collect-only", "-qq"],
            cwd=TESTS.parent, env=os.environ | {"PYTEST_ADDOPTS": "", "PYTHONDONTWRITEBYTECODE": ""},
            stdout=subprocess.DEVNULL, check=False,
        )  # fmt: skip
        for compiler in compilers:
            if compiler.wait():
                raise pytest.UsageError(f"{compiler.args} ended with {compiler.returncode}")
    from tests import needs

    config.pluginmanager.register(needs, needs.__name__)


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
