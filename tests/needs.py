"""Requirements of tests on the machine, in one table: how each is checked, and the command that installs it.

A test declares a requirement by `@pytest.mark.needs("vulkan")`, or checks it while it runs (`skip_without`). Without it the
test is skipped. For the names in `$CLUTCH_HIL_MUST_HAVE` a test fails instead: continuous integration installs these, so that
no test is lost silently. The end of a run lists the skipped tests and what would enable them (`list_skips`).
"""

import importlib.util
import os
import shutil
import subprocess
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import pytest

from benchmarks.friction_oracles import Exudyn, MuJoCo, OpenSees
from clutch_hil.bench.host.unit_files import find_program
from clutch_hil.live.viewer import graphics
from clutch_hil.thesis.measured_data import NEIGHBOUR_FOLDER, VARIABLE
from protocols.buses.bus import resolve
from protocols.errors import InputError
from protocols.realtime.rights import MEASURES, LoopRequest, is_possible
from tests.clutch_hil.live.viewer import chromium

FIELD_CASES = Path(os.environ.get(VARIABLE) or NEIGHBOUR_FOLDER) / "field_cases"
SCIPY_FILES = sorted(
    file
    for folder in importlib.util.find_spec("scipy.io").submodule_search_locations or ()
    for file in Path(folder).glob("matlab/tests/data/test*.mat")
)  # fmt: skip
MUST_HAVE = "CLUTCH_HIL_MUST_HAVE"
HEADING = "skipped, and what would enable it"


class Need(NamedTuple):
    """A requirement: `what` a test needs, a check whether it is `there`, and the command or advice that `brings` it."""

    what: str
    there: Callable[[], bool]
    brings: str

    @property
    def reason(self) -> str:
        """Reason for which a test without it is skipped."""
        return f"needs {self.what}: {self.brings}"


def _make_program_check(name: str) -> Callable[[], bool]:
    return lambda: shutil.which(name) is not None


def _can_mount() -> bool:
    return shutil.which("unshare") is not None and not subprocess.call(
        ["unshare", "--mount", "true"], stderr=subprocess.DEVNULL
    )


def _make_module_check(name: str) -> Callable[[], bool]:
    return lambda: importlib.util.find_spec(name) is not None


def _has_terminal() -> bool:
    with suppress(OSError):
        for end in os.openpty():
            os.close(end)
        return True
    return False


def _make_right(what: str, name: str) -> Need:
    (measure,) = (one for one in MEASURES if one.name == name)
    there = partial(is_possible, measure, LoopRequest(max(os.sched_getaffinity(0))))
    return Need(f"the right to {what}", there, f"run it as root, or: {measure.remedy}")


def _can_be_installed() -> bool:
    try:
        find_program()
    except InputError:
        return False
    return True


def _leave_to_test() -> bool:
    return True


NEEDS = {
    "vulkan": Need("a Vulkan driver", graphics.has_vulkan, graphics.INSTALL),
    "chromium": Need("Chromium", lambda: bool(chromium.PROGRAM), "apt-get install chromium"),
    "vcan0": Need(
        "the CAN interface vcan0, or the guest of tests/test_guest.py, which plays these where it can",
        lambda: resolve("auto") == "vcan0",
        "modprobe vcan && ip link add dev vcan0 type vcan && ip link set vcan0 up",
    ),
    "no vcan0": Need(
        "a machine without vcan0 to be of use",
        lambda: resolve("auto") != "vcan0",
        "nothing is lost, as the vcan tests run directly",
    ),
    "guest": Need(
        "a guest with a CAN kernel",
        _leave_to_test,
        "apt-get install user-mode-linux can-utils busybox-static gcc libc6-dev",
    ),
    "clock to set": Need(
        "a computer whose time of day may be set: the guest of tests/test_guest.py, which plays these where it can",
        lambda: "User Mode Linux" in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace"),
        "nothing is lost, as the guest plays them",
    ),
    "candump": Need("candump", _make_program_check("candump"), "apt-get install can-utils"),
    "tc": Need("tc", _make_program_check("tc"), "apt-get install iproute2"),
    "systemd-analyze": Need("systemd-analyze", _make_program_check("systemd-analyze"), "apt-get install systemd"),
    "systemd": Need(
        "systemd with networkd and udev, which a guest boots",
        lambda: all(Path("/lib/systemd", name).exists() for name in ("systemd", "systemd-networkd", "systemd-udevd")),
        "apt-get install systemd udev",
    ),
    "booted bench": Need(
        "a machine that has booted with the units of a bench: the guest of tests/test_boot.py, which plays these where it can",
        lambda: bool(os.environ.get("CLUTCH_HIL_GUEST")) and Path("/run/systemd/system").is_dir(),
        "nothing is lost, as the guest plays them",
    ),
    "lasting folder": Need(
        "a project in a folder that units of systemd can see",
        _can_be_installed,
        "clone it elsewhere than below /tmp, such as in /opt",
    ),
    "root": Need("root", lambda: os.geteuid() == 0, "run it as root"),
    "terminal": Need("a terminal that a program opens", _has_terminal, "mount -t devpts devpts /dev/pts"),
    "mount": Need(
        "the right to mount",
        lambda: os.geteuid() == 0 and _can_mount(),
        "run it as root (in a container, one with --cap-add SYS_ADMIN)",
    ),
    "real-time priority": _make_right("real-time priority", "real-time priority"),
    "memory locked": _make_right("lock memory", "memory locked"),
    "data": Need("measured data", _leave_to_test, f"set {VARIABLE} to a folder that has them (docs/measured_data.md)"),
    "field cases": Need(
        "the field cases",
        lambda: (FIELD_CASES / "README.md").is_file(),
        f"set {VARIABLE} to the folder that has field_cases",
    ),
    "scipy's files": Need(
        "the files of SciPy's own tests",
        lambda: bool(SCIPY_FILES),
        "pip install --force-reinstall scipy, with its tests",
    ),
    "pysindy": Need("pysindy", _make_module_check("pysindy"), "pip install -e '.[battery]'"),
    "sklearn": Need("scikit-learn", _make_module_check("sklearn"), "pip install -e '.[battery]'"),
    "distributed": Need("Dask", _make_module_check("distributed"), "pip install -e '.[dask]'"),
    "quiet": Need("a machine that lets processes run", _leave_to_test, "stop what else it computes"),
    **{
        oracle.package: Need(oracle.package, oracle.is_installed, oracle.install_command())
        for oracle in (Exudyn, MuJoCo, OpenSees)
    },
}


@cache
def is_there(name: str) -> bool:
    """Return whether this machine has the requirement `name` of NEEDS."""
    return NEEDS[name].there()


def skip_without(*names: str) -> None:
    """Skip the running test if one of these requirements is missing."""
    for name in names:
        if not is_there(name):
            skip(name)


def skip(name: str, result: str = "") -> NoReturn:
    """Skip the running test, which found the requirement `name` missing, with `result`; fail if the machine must have it."""
    reason = NEEDS[name].reason + (f" ({result})" if result else "")
    if name in _must_have():
        pytest.fail(f"{reason}; ${MUST_HAVE} says that it is here", pytrace=False)
    pytest.skip(reason)


def _must_have() -> list[str]:
    return [name.strip() for name in os.environ.get(MUST_HAVE, "").split(",") if name.strip()]


def list_skips(reports: Iterable[Any]) -> list[str]:
    """Return a line with the number of tests for each reason of a skip, the most frequent first."""
    reasons = Counter(_find_reason(report) for report in reports)
    return [f"{count:>4}  {reason}" for reason, count in reasons.most_common()]


def _find_reason(report: Any) -> str:
    sentence = report.longrepr
    return str(sentence[2] if isinstance(sentence, tuple) else sentence).removeprefix("Skipped: ")


def pytest_sessionstart() -> None:
    """Check that all names in $CLUTCH_HIL_MUST_HAVE are in the table."""
    for name in _must_have():
        if name not in NEEDS:
            raise pytest.UsageError(f"{MUST_HAVE} names {name!r}; allowed are {', '.join(NEEDS)}")


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test that is marked with a missing requirement."""
    for mark in item.iter_markers("needs"):
        skip_without(*mark.args)


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """List the skipped tests."""
    if lines := list_skips(terminalreporter.stats.get("skipped", ())):
        terminalreporter.section(HEADING)
        terminalreporter.write("\n".join(lines) + "\n")
