"""Schedule of the tests on the machine, and fixtures for all tests.

`make test` runs them on workers (pytest-xdist), one more than CPUs. While computing tests are left, some workers run these, at
low priority. The others run tests in real time: first the soak test, which mostly waits for ten minutes, and meanwhile those
that measure time. Without workers the tests run one after the other.
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
# The two longest computing tests. They start first, so that the run does not wait for them at the end.
LONGEST = "clutch_hil/thesis/test_reproductions.py"
GUEST = "test_guest.py"
BOOT = "test_boot.py"  # also a guest, with systemd
# These measure time, or check the timing of a bench at 1 kHz, which needs a machine that is not busy.
QUIET = (
    "plant_sim/effects/test_effect_speed.py",
    "clutch_hil/live/viewer/test_view.py",
    "protocols/local_bus",
    "protocols/telemetry",
    "clutch_hil/bench/test_can_log.py",
    "protocols/test_clock.py",
    "clutch_hil/bench/timing/test_jitter.py",
    "clutch_hil/bench/timing/test_timing_budget.py",
)
# These run services, or wait for threads, in real time, like the guest and each test on a `local_bus`. `python -m tests`
# repeats them if they fail.
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
# These compute for a long time. `make quick` leaves them out, and also tests in real time.
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
    "clutch_hil/bench/sweeps",
    "clutch_hil/test_public_api.py",
    "clutch_hil/test_public_arguments.py",
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
# On eight CPUs the CPU time of a run, 58 to 72 min, takes less than the soak test of ten minutes; a worker used up to 1.3 GB
MOST_WORKERS = 9
CPUS = len(os.sched_getaffinity(0))
LOW = 10  # nice value of computing tests: they get a tenth of a CPU that a test in real time also needs
_KERNELS = pytest.StashKey[str]()

# An example that took long because the machine was busy is not an error.
settings.register_profile("shared machine", deadline=None)
settings.load_profile("shared machine")


@cache
def choose_turn(file: str) -> str:
    """Return the group, one of ORDER, in which the tests of `file` run; `file` is relative to the folder tests."""
    alone = {SOAK: "soak", LONGEST: "longest", GUEST: "guest", BOOT: "boot"}
    return alone.get(file) or ("quiet" if _is_in(file, QUIET) else "shared")


def is_real_time(file: str) -> bool:
    """Return whether the tests of a file run in real time, so that they depend on the load of the machine."""
    return _is_in(file, IN_REAL_TIME)


@cache  # called for every test: without a cache it takes a fifth of the time of the collection
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


def pytest_make_parametrize_id(val: object, argname: str) -> str | None:
    """Name bytes by their argument, and pytest numbers them: packed bytes hold the time, and all workers need equal names."""
    return argname if isinstance(val, bytes) else None


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """Return the workers for `--numprocesses auto`: one for each CPU, and one more if tests in real time are included."""
    return min(CPUS + (not config.option.markexpr), MOST_WORKERS)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Return the scheduler. A worker gets one file at a time, in the order of the tests; all quiet tests go to one worker.

    While both kinds of tests are left, about half of the workers run tests in real time; with two CPUs, two workers do.
    """
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
    """Return a path relative to the folder tests."""
    return path.removeprefix(f"{TESTS.name}/")


@pytest.fixture(autouse=True, scope="module")
def _priority(request: pytest.FixtureRequest) -> None:
    """Set low priority for computing tests; only as root, because others cannot raise the priority again afterwards."""
    if os.geteuid() == 0:
        file = request.path.relative_to(TESTS).as_posix()
        os.setpriority(os.PRIO_PROCESS, 0, 0 if is_real_time(file) or file in (GUEST, BOOT) else LOW)


def pytest_configure(config: pytest.Config) -> None:
    """Give all workers and their processes one common kernel cache of this session, before Numba is imported.

    The kernels of services are compiled before the workers start. Otherwise several tests on two CPUs would wait for compilers
    instead of services. The first start of a bench compiles them; test_first_minute.py checks its messages. All other kernels
    are compiled by the first worker that needs them. The byte code of the tests, as pytest rewrites it, is also made once, even
    if the environment disables byte code; otherwise each worker would make it again.
    """
    if (
        signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    ):  # started in the background of a shell; services would inherit this
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # A part, such as `make quick`, uses the kernels of earlier runs, next to the sources
    whole = not config.option.markexpr
    if not whole:
        sys.dont_write_bytecode = False  # the tests' byte code is kept for the next run: 12 s of CPU time a worker
    if not hasattr(config, "workerinput") and config.getoption("numprocesses", None) and whole:
        config.stash[_KERNELS] = os.environ["NUMBA_CACHE_DIR"] = tempfile.mkdtemp(prefix="clutch-hil-kernels-")
        record = os.environ[first_start.RECORD] = f"{config.stash[_KERNELS]}/first_start.json"
        compilers = [
            subprocess.Popen([sys.executable, "-m", *words], cwd=TESTS.parent)
            for words in (("tests.first_start", record), ("tests.kernels",))
        ]
        subprocess.run(  # the workers also find the errors that it finds
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
    """A new local bus for this process and the processes that it starts."""
    folder = tempfile.mkdtemp(prefix="ch-")  # short: socket paths have at most 107 bytes
    monkeypatch.setenv("CLUTCH_HIL_BUS_DIR", folder)
    yield "local:bench"
    shutil.rmtree(folder)
