"""The first minute: on an empty kernel cache every command says what it does, and can be ended."""

import itertools
import os
import re
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
from protocols.realtime.child import clutch_hil
from protocols.realtime.stopping import Stop

FIRST, SILENCE = 5.0, 10.0  # s
LINE = 1.0  # s that a line takes to come from a busy machine
PATIENCE = 600.0  # s for all kernels, compiled on a busy machine


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


def begun(cache: Path, *arguments: str) -> subprocess.Popen[str]:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    return subprocess.Popen(
        clutch_hil(*arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )


def heard(process: subprocess.Popen[str]) -> tuple[list[float], list[str]]:
    """When each line on stderr came, after now [s], and the lines."""
    began, times, lines = time.monotonic(), [0.0], []
    assert process.stderr
    patience = threading.Timer(PATIENCE, process.kill)
    patience.start()
    for line in process.stderr:
        times.append(time.monotonic() - began)
        lines.append(line.rstrip("\n"))
    patience.cancel()
    return times, lines


def test_up_is_never_silent_and_builds_each_kernel_once(local_bus: str, tmp_path: Path) -> None:
    cache = tmp_path / "kernels"
    cache.mkdir()
    with busy():
        process = begun(
            cache, "up", "--bus", local_bus, "--rate", "250", "--seconds", "2", "--out", str(tmp_path), "--json"
        )
        times, lines = heard(process)
        assert process.stdout
        out = process.stdout.read()
        code = process.wait(PATIENCE)
    assert code in (0, 1), lines  # a busy machine may be too late for its samples
    assert out.startswith("{")  # nothing else is on stdout
    compiled = next(i for i, line in enumerate(lines) if "plant: kernels are compiled" in line)
    assert times[1] < FIRST + LINE
    gaps = [after - before for before, after in itertools.pairwise(times[: compiled + 2])]
    assert max(gaps) < SILENCE + LINE
    assert any(re.search(r"compiling kernels: \d+ done, now \w+, \d+ s", line) for line in lines)
    assert not any("\r" in line for line in lines)
    data = list(cache.rglob("*.nbc"))
    again = begun(cache, "up", "--bus", local_bus, "--rate", "250", "--seconds", "1", "--out", str(tmp_path), "--json")
    _, errors = again.communicate(timeout=PATIENCE)
    assert "compiling" not in errors  # kernels survive
    assert sorted(cache.rglob("*.nbc")) == sorted(data)


# Pairwise, as every case compiles on all CPUs until it is ended. Each command is ended early (0 s: it loads) or late (12 s: it
# compiles). `up` and the plant, which load most, are ended at both moments. Each moment meets both signals.
ENDINGS = (
    ("simulate", 0.0, signal.SIGTERM),
    ("controller", 12.0, signal.SIGINT),
    ("up", 0.0, signal.SIGINT),
    ("up", 12.0, signal.SIGTERM),
    ("plant", 0.0, signal.SIGTERM),
    ("plant", 12.0, signal.SIGINT),
)


@pytest.mark.parametrize(("command", "after", "number"), ENDINGS)
def test_it_can_be_ended_while_it_starts(
    command: str, after: float, number: signal.Signals, local_bus: str, tmp_path: Path
) -> None:
    rest = {
        "simulate": ["--out", str(tmp_path / "runs"), "--seconds", "500"],
        "up": ["--bus", local_bus, "--out", str(tmp_path / "runs"), "--seconds", "1000"],
    }.get(command, ["--bus", local_bus])
    process = begun(tmp_path / "kernels", command, *rest)
    assert process.stderr
    assert process.stderr.readline()  # it has said what it does
    time.sleep(after)
    process.send_signal(number)
    out, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130, out + errors
    assert errors.strip().splitlines()[-1].startswith("interrupted: ")
    assert "compiled kernels are kept" in errors
    assert not list(tmp_path.rglob("*.part"))


def test_a_service_that_does_not_start_is_named_with_its_last_word(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clutch_hil.bench.services._START_TIMEOUT", 3.0)
    monkeypatch.setattr("clutch_hil.bench.services._NOTICE_DELAY", 0.5)
    monkeypatch.setattr(
        "clutch_hil.bench.services.clutch_hil",
        lambda *arguments: ["sh", "-c", "echo kernels are compiled: 3 in 1 s >&2; exec sleep 60"],
    )
    told: list[str] = []
    with Stop() as stop, Services({"controller": []}) as services, pytest.raises(InputError) as error:
        services.rings(stop, told.append)
    assert "the controller had not started 3 s after it said 'kernels are compiled: 3 in 1 s' (limit 3 s" in str(
        error.value
    )
    assert "CPUs" in str(error.value)
    assert told[0] == "controller: kernels are compiled: 3 in 1 s"
    assert told[1].startswith("waiting for controller to start, ")


def test_who_stops_services_that_start_is_told_what_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clutch_hil.bench.services.clutch_hil", lambda *arguments: ["sleep", "60"])
    with Stop() as stop, Services({"plant": []}) as services:
        stop.asked = True
        with pytest.raises(InterruptionError, match="nothing was written, compiled kernels are kept"):
            services.rings(stop, lambda line: None)


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
        ("/tmp/clutch-hil-unkept-1/clutch-hil/2", "; compiled kernels cannot be kept here: set NUMBA_CACHE_DIR .*"),
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


def told(
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
    lines = told(monkeypatch, capsys, nullcontext())
    assert len(lines) >= 2
    assert all(re.fullmatch(r"at work for \d s", line) for line in lines)


def test_without_a_terminal_a_progress_bar_is_lines(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with progress_bar("friction models", quiet=False) as progress:
        progress(3.0, 12)
        assert set(told(monkeypatch, capsys, Stop())) == {"friction models: 25 % done"}


def test_without_a_terminal_a_status_is_lines(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with ActivityLine("waiting for a bus", quiet=False) as doing:
        doing.update("bench here: 500 samples, lost 0")
        assert set(told(monkeypatch, capsys, Stop())) == {"bench here: 500 samples, lost 0"}


@pytest.mark.parametrize("doing", [Stop(), progress_bar("bar", quiet=True), ActivityLine("doing", quiet=True)])
def test_who_tells_by_himself_is_not_told(
    doing: AbstractContextManager, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert told(monkeypatch, capsys, doing) == []
