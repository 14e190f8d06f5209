"""The first minute: on an empty kernel cache every command says what it does, and can be ended."""

import itertools
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path

import pytest

from clutch_hil.bench.progress import ActivityLine, progress_bar
from clutch_hil.bench.services import Services
from protocols.errors import InputError, InterruptionError
from protocols.kernels.compiling import COMPILING
from protocols.kernels.progress_notice import PROGRESS_NOTICE
from protocols.realtime.stopping import Stop
from tests.first_start import PATIENCE, RECORD, FirstStart, begin, list_words, read_record, start_on_empty_cache

FIRST, SILENCE = 5.0, 10.0  # s
LINE = 1.0  # s that a line takes to come from a busy machine


@contextmanager
def busy(count: int = 2) -> Iterator[None]:
    """Processes that compute beside what is tested."""
    processes = [subprocess.Popen(["sh", "-c", "while :; do :; done"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


@pytest.fixture
def started(local_bus: str, tmp_path: Path) -> tuple[FirstStart, Path]:
    """A first start beside busy processes, and a cache with its kernels: that with which this session began, if it did."""
    cache = tmp_path / "kernels"
    if RECORD in os.environ:
        record = Path(os.environ[RECORD])
        kernels = shutil.ignore_patterns("*.lock", "*.tmp.*")  # others compile into the session's cache meanwhile
        shutil.copytree(record.parent, cache, ignore=kernels)
        return read_record(record), cache
    cache.mkdir()
    with busy():
        return start_on_empty_cache(cache, local_bus, tmp_path), cache


def test_up_is_never_silent_and_builds_each_kernel_once(
    started: tuple[FirstStart, Path], local_bus: str, tmp_path: Path
) -> None:
    start, cache = started
    times, lines = start.times, start.lines
    assert start.code in (0, 1), lines  # a busy machine may be too late for its samples
    assert start.out.startswith("{")  # nothing else is on stdout
    compiled = next(i for i, line in enumerate(lines) if "plant: kernels are compiled" in line)
    assert times[1] < FIRST + LINE
    gaps = [after - before for before, after in itertools.pairwise(times[: compiled + 2])]
    assert max(gaps) < SILENCE + LINE
    assert any(re.search(r"compiling kernels: \d+ done, now \w+, \d+ s", line) for line in lines)
    assert not any("\r" in line for line in lines)
    data = sorted(cache.rglob("*.nbc"))
    assert data
    again = begin(cache, *list_words(local_bus, tmp_path, 1.0))
    _, errors = again.communicate(timeout=PATIENCE)
    assert "compil" not in errors  # kernels survive
    assert sorted(cache.rglob("*.nbc")) == data


# Pairwise, as every case compiles on all CPUs until it is ended. Each command is ended at its first word, when it loads, or
# at the word that it compiles. `up` and the plant, which load most, are ended at both moments. Each moment meets both
# signals.
LOADS, COMPILES = "", r"compiling kernels: \d+ done, now"
ENDINGS = (
    ("simulate", LOADS, signal.SIGTERM),
    ("controller", COMPILES, signal.SIGINT),
    ("up", LOADS, signal.SIGINT),
    ("up", COMPILES, signal.SIGTERM),
    ("plant", LOADS, signal.SIGTERM),
    ("plant", COMPILES, signal.SIGINT),
)


@pytest.mark.parametrize(("command", "moment", "number"), ENDINGS)
def test_it_can_be_ended_while_it_starts(
    command: str, moment: str, number: signal.Signals, local_bus: str, tmp_path: Path
) -> None:
    rest = {
        "simulate": ["--out", str(tmp_path / "runs"), "--seconds", "500"],
        "up": ["--bus", local_bus, "--out", str(tmp_path / "runs"), "--seconds", "1000"],
    }.get(command, ["--bus", local_bus])
    process = begin(tmp_path / "kernels", command, *rest)
    assert process.stderr
    assert any(re.search(moment, line) for line in process.stderr)  # it has said what it does
    process.send_signal(number)
    out, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130, out + errors
    assert errors.strip().splitlines()[-1].startswith("interrupted: ")
    assert "compiled kernels are stored" in errors
    assert not list(tmp_path.rglob("*.part"))


SWALLOWS = """
import os, signal
from clutch_hil.command import run_main
from protocols.errors import InputError
from protocols.kernels.compiling import COMPILING

def run():
    COMPILING.kernels += {kernels}
    try:
        os.kill(os.getpid(), signal.SIGINT)
    except KeyboardInterrupt:  # as ctypes does in a callback of the compiler
        COMPILING.kernels.clear()
    raise InputError("the law cannot be compiled: no compiled object yet")

run_main(run)
"""


@pytest.mark.parametrize(("kernels", "code", "last"), [(["move"], 130, "interrupted: "), ([], 2, "error: the law")])
def test_an_interruption_that_a_compiler_swallows_is_no_wrong_input(kernels: list[str], code: int, last: str) -> None:
    """Of a command that neither compiles nor loads a wrong input is told, although it was asked to end."""
    done = subprocess.run(
        [sys.executable, "-c", SWALLOWS.format(kernels=kernels)], capture_output=True, text=True, timeout=PATIENCE
    )
    assert done.returncode == code, done.stderr
    assert done.stderr.strip().splitlines()[-1].startswith(last)


IN_A_CALLBACK = """
import ctypes, os, signal, time
from clutch_hil.command import run_main
from protocols.kernels.compiling import COMPILING

@ctypes.CFUNCTYPE(None)
def notify():
    os.kill(os.getpid(), signal.SIGINT)

def run():
    COMPILING.kernels.append("move")
    notify()
    time.sleep(60)

run_main(run)
"""


def test_an_interruption_in_a_callback_is_repeated_and_one_line() -> None:
    """The compiler calls Python for each kernel that it has made."""
    done = subprocess.run([sys.executable, "-c", IN_A_CALLBACK], capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 130, done.stderr
    assert re.fullmatch("interrupted: .*\n", done.stderr)


def test_a_service_that_does_not_start_is_named_with_its_last_word(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clutch_hil.bench.services._START_TIMEOUT", 3.0)
    monkeypatch.setattr("clutch_hil.bench.services._NOTICE_DELAY", 0.5)
    monkeypatch.setattr(
        "clutch_hil.bench.services.list_command",
        lambda *arguments: ["sh", "-c", "echo kernels are compiled: 3 in 1 s >&2; exec sleep 60"],
    )
    sentence: list[str] = []
    with Stop() as stop, Services({"controller": []}) as services, pytest.raises(InputError) as error:
        services.wait_for_rings(stop, sentence.append)
    assert (
        "the controller had not started 3 s after its last message 'kernels are compiled: 3 in 1 s' (limit 3 s"
        in str(error.value)
    )
    assert "CPUs" in str(error.value)
    assert sentence[0] == "controller: kernels are compiled: 3 in 1 s"
    assert sentence[1].startswith("waiting for controller to start, ")


def test_who_stops_services_that_start_is_told_what_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clutch_hil.bench.services.list_command", lambda *arguments: ["sleep", "60"])
    with Stop() as stop, Services({"plant": []}) as services:
        stop.asked = True
        with pytest.raises(InterruptionError, match="nothing was written; compiled kernels are stored"):
            services.wait_for_rings(stop, lambda line: None)


KERNEL = """
import sys
from numba import njit
from protocols.kernels.compiling import COMPILING

@njit(cache=True)
def kernel(x):
    return x + 1

for value in eval(sys.argv[1]):
    print(kernel(value))
print(COMPILING.compiled)
"""


def test_processes_compile_a_kernel_once_and_never_mix_types(tmp_path: Path) -> None:
    """Numba's own cache gives two types the same file when two processes save at once."""
    script = tmp_path / "kernel.py"
    script.write_text(KERNEL)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    orders = ["[1, 1.5]", "[1.5, 1]", "[1, 1.5]", "[1.5, 1]"]

    def run() -> list[list[str]]:
        processes = [
            subprocess.Popen([sys.executable, str(script), order], stdout=subprocess.PIPE, text=True, env=environment)
            for order in orders
        ]
        return [process.communicate(timeout=PATIENCE)[0].split() for process in processes]

    first = run()
    assert [answer[:2] for answer in first] == [["2", "2.5"], ["2.5", "2"], ["2", "2.5"], ["2.5", "2"]]
    assert [answer[2] for answer in run()] == ["0"] * len(orders)  # all are on disk
    assert len(list((tmp_path / "kernels").rglob("*.nbc"))) == 2


@pytest.mark.parametrize(
    ("place", "note"),
    [
        ("", ""),
        ("/tmp/clutch-hil-unkept-1/clutch-hil/2", "; compiled kernels cannot be stored here: set NUMBA_CACHE_DIR .*"),
    ],
)
def test_progress_is_told_by_a_thread_that_ends(
    place: str, note: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from protocols.kernels.progress_notice import ProgressNotice

    monkeypatch.setattr("protocols.kernels.progress_notice._QUIET_SECONDS", 0.05)
    monkeypatch.setattr(COMPILING, "kernels", ["advance"])
    monkeypatch.setenv("NUMBA_CACHE_DIR", place)
    threads = threading.active_count()
    with ProgressNotice() as starting:
        time.sleep(0.5)
        starting.end()
        assert threading.active_count() == threads
    lines = capsys.readouterr().err.splitlines()
    assert re.fullmatch(rf"compiling kernels: \d+ done, now advance, \d+ s{note}", lines[0])


def collect_reports(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], doing: AbstractContextManager
) -> list[str]:
    """What is said beside `doing`, which says nothing."""
    monkeypatch.setattr("protocols.kernels.progress_notice._QUIET_SECONDS", 0.01)
    monkeypatch.setattr("protocols.kernels.progress_notice._REPORT_PERIOD", 0.05)
    with PROGRESS_NOTICE, doing:
        time.sleep(2.0)
    return capsys.readouterr().err.splitlines()


def test_who_computes_without_a_word_is_told(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = collect_reports(monkeypatch, capsys, nullcontext())
    assert len(lines) >= 2
    assert all(re.fullmatch(r"working for \d s", line) for line in lines)


def test_without_a_terminal_a_progress_bar_is_lines(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with progress_bar("friction models", quiet=False) as progress:
        progress(3.0, 12)
        assert collect_reports(monkeypatch, capsys, Stop()) == ["friction models: 25 % done"]


def test_without_a_terminal_a_status_is_lines(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with ActivityLine("waiting for a bus", quiet=False) as doing:
        doing.update("bench here: 500 samples, lost 0")
        assert collect_reports(monkeypatch, capsys, Stop()) == ["bench here: 500 samples, lost 0"]


def test_a_line_that_stays_the_same_comes_again_later(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("protocols.kernels.progress_notice._REPEAT_PERIOD", 0.4)
    with progress_bar("identify", quiet=False) as progress:
        progress(1.0, 10)
        assert 2 <= len(collect_reports(monkeypatch, capsys, Stop())) <= 5


@pytest.mark.parametrize("doing", [Stop(), progress_bar("bar", quiet=True), ActivityLine("doing", quiet=True)])
def test_who_tells_by_himself_is_not_told(
    doing: AbstractContextManager, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert collect_reports(monkeypatch, capsys, doing) == []
