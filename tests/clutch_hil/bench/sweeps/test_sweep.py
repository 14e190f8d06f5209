"""Sweeps: the same table wherever it is computed, and cases of workers that die."""

import csv
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from typer.testing import CliRunner

import clutch_hil as ch
from clutch_hil.bench.sweeps import executors
from clutch_hil.bench.sweeps.executors import compute
from clutch_hil.command import make_application
from tests.processes import PATIENCE

SHORT = {"profile": "engagement", "seconds": 1.5}  # s: long enough to engage
SAMPLES = ch.grid({"friction_level.level": [0.8, 1.2], "controller.torque.integral_gain": [0.05, 0.4]})
KEPT = ("regime_error_nm", "rise_time_s", "fault", "peak_torque_nm")


@contextmanager
def dask_cluster(workers: int) -> Iterator[Any]:
    """A cluster of one process a worker; at its end every killed worker is there again.

    Dask starts a killed worker anew, and a cluster that closes meanwhile raises "can only join a started process".
    """
    from distributed import Client, LocalCluster

    with LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster
        with Client(cluster) as client:
            client.wait_for_workers(workers, timeout=PATIENCE)


def test_a_grid_has_every_combination() -> None:
    assert ch.grid({"a": [1, 2], "b": [3.0, 4.0]}) == [
        {"a": 1.0, "b": 3.0}, {"a": 1.0, "b": 4.0}, {"a": 2.0, "b": 3.0}, {"a": 2.0, "b": 4.0},
    ]  # fmt: skip


def test_random_points_are_in_their_ranges_and_a_hypercube_is_even() -> None:
    ranges = {"a": (0.0, 1.0), "b": (-5.0, 5.0)}
    for points in (ch.random(ranges, 50, seed=2), ch.latin_hypercube(ranges, 50, seed=2)):
        assert all(low <= point[name] <= high for point in points for name, (low, high) in ranges.items())
    strata = sorted(int((point["b"] + 5.0) / 10.0 * 50) for point in ch.latin_hypercube(ranges, 50, seed=2))
    assert strata == list(range(50))
    assert ch.random(ranges, 5, seed=2) == ch.random(ranges, 5, seed=2) != ch.random(ranges, 5, seed=3)


@pytest.mark.parametrize(
    "samples",
    [
        lambda: ch.grid({"a": []}),
        lambda: ch.grid({str(i): range(100) for i in range(20)}),
        lambda: ch.random({}, 3),
        lambda: ch.random({"a": (0.0, 1.0)}, 0),
        lambda: ch.random({"a": (2.0, 1.0)}, 3),
        lambda: ch.latin_hypercube({"a": (0.0, float("inf"))}, 3),
        lambda: ch.latin_hypercube({"a": (0.0, 1.0)}, 10**12),
    ],
)
def test_samples_that_cannot_be_are_refused(samples) -> None:
    with pytest.raises(ch.InputError):
        samples()


@pytest.fixture(scope="module")
def table() -> pa.Table:
    return ch.sweep(SAMPLES, **SHORT, seeds=(1, 2), measures=KEPT[:3], workers=1)


def test_a_sweep_has_a_row_a_run_in_order(table: pa.Table) -> None:
    assert table.column_names == ["friction_level.level", "controller.torque.integral_gain", "seed", *KEPT[:3]]
    rows = table.to_pylist()
    expected = [
        (s["friction_level.level"], s["controller.torque.integral_gain"], seed) for s in SAMPLES for seed in (1, 2)
    ]
    assert [tuple(row.values())[:3] for row in rows] == expected
    one = ch.measure_run(
        ch.simulate(**SHORT, seed=2, plant={"friction_level.level": 1.2}, controller={"torque.integral_gain": 0.4})
    )
    np.testing.assert_equal({name: rows[-1][name] for name in KEPT[:3]}, {name: one[name] for name in KEPT[:3]})


def test_two_processes_compute_the_same_table(table: pa.Table) -> None:
    message: list[tuple[int, int]] = []
    again = ch.sweep(
        SAMPLES,
        **SHORT,
        seeds=(1, 2),
        measures=KEPT[:3],
        workers=2,
        progress=lambda done, of: message.append((done, of)),
    )
    assert again.equals(table) or again.to_pandas().equals(table.to_pandas())  # not-a-number equals itself there
    assert message == [(k, 8) for k in range(1, 9)]


def test_effects_of_a_sweep_are_on_in_every_run() -> None:
    """Also where they come from a generator, and one is named alone."""
    samples = ch.grid({"friction_level.level": [0.8, 1.2]})
    several = ch.sweep(samples, **SHORT, effects=(name for name in ["internal_leakage"]), workers=1)
    assert several.equals(ch.sweep(samples, **SHORT, effects="internal_leakage", workers=1))
    assert not several.equals(ch.sweep(samples, **SHORT, workers=1))


@pytest.mark.needs("distributed")
@pytest.mark.parametrize("workers", [1, 2, 4])
def test_a_dask_cluster_computes_the_same_table(table: pa.Table, workers: int) -> None:
    with dask_cluster(workers) as cluster:
        again = ch.sweep(SAMPLES, **SHORT, seeds=(1, 2), measures=KEPT[:3], address=cluster.scheduler_address)
    assert again.to_pandas().equals(table.to_pandas())


@pytest.mark.needs("distributed")
def test_cases_of_a_killed_dask_worker_are_done_again(table: pa.Table) -> None:
    with dask_cluster(2) as cluster:
        killed: list[int] = []

        def kill(done: int, of: int) -> None:
            if not killed:
                killed.append(next(iter(cluster.workers.values())).process.pid)
                os.kill(killed[0], signal.SIGKILL)

        again = ch.sweep(
            SAMPLES, **SHORT, seeds=(1, 2), measures=KEPT[:3], address=cluster.scheduler_address, progress=kill
        )
    assert killed
    assert again.to_pandas().equals(table.to_pandas())


@pytest.mark.needs("distributed")
def test_a_case_that_kills_every_dask_worker_is_named() -> None:
    with dask_cluster(1) as cluster:
        address = cluster.scheduler_address
        with pytest.raises(ch.InputError, match=f"case 7 killed every worker that computed it at {address}"):
            list(compute(os._exit, [7], address=address))


@pytest.mark.needs("distributed")
def test_a_cluster_that_ends_meanwhile_is_told() -> None:
    from distributed import LocalCluster

    cluster = LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None)
    results = compute(time.sleep, [0.1, 60.0], address=cluster.scheduler_address)
    next(results)
    cluster.close()
    with pytest.raises(ch.InputError, match="is gone; 1 of 2 cases are not computed"):
        next(results)


@pytest.mark.needs("distributed")
def test_a_cluster_begins_no_further_case_when_a_sweep_is_broken_off() -> None:
    with dask_cluster(1) as cluster:
        results = compute(time.sleep, [0.1, *[10.0] * 50], address=cluster.scheduler_address)
        next(results)
        began = time.monotonic()
        results.close()
        assert time.monotonic() - began < PATIENCE  # of 500 s


def test_processes_end_at_once_when_a_sweep_is_broken_off() -> None:
    results = compute(time.sleep, [0.1, 600.0, 600.0], workers=2)
    next(results)
    results.close()
    assert not multiprocessing.active_children()


def test_the_command_sweeps_as_python_does(tmp_path: Path) -> None:
    arguments = [
        "--profile",
        "engagement",
        "--seconds",
        "1.5",
        "--vary",
        "friction_level.level=0.8:1.2:2",
        "--seeds",
        "2",
    ]
    done = CliRunner().invoke(
        make_application(), ["simulate", *arguments, "--workers", "2", "--out", str(tmp_path), "--json"]
    )
    assert done.exit_code == 0, done.output
    samples = ch.grid({"friction_level.level": [0.8, 1.2]})
    table = ch.sweep(samples, **SHORT, seeds=(1, 2), measures=KEPT[:2], workers=1)
    runs = [list(row.values()) for row in table.to_pylist()]
    assert json.loads(done.stdout)["runs"] == runs
    (file,) = tmp_path.glob("*-sweep.csv")
    header, *rows = csv.reader(file.read_text().splitlines())
    assert header == table.column_names
    assert [list(map(float, row)) for row in rows] == runs


def _slow_square(value: float) -> float:
    time.sleep(0.3)
    return value * value


def test_cases_of_a_killed_process_are_done_again() -> None:
    results = compute(_slow_square, range(8), workers=2)
    outcome = dict([next(results)])
    children = Path(f"/proc/self/task/{threading.get_native_id()}/children").read_text().split()
    workers = [pid for pid in map(int, children) if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]
    os.kill(workers[0], signal.SIGKILL)
    outcome |= dict(results)
    assert outcome == {k: k * k for k in range(8)}


ENDLESS = """
import os, sys, time
from pathlib import Path
from clutch_hil.bench.sweeps.executors import compute

def wait(name):
    Path(name).write_text(str(os.getpid()), encoding="utf-8")
    time.sleep(600.0)

if __name__ == "__main__":
    list(compute(wait, sys.argv[1:], 2))
"""


def test_processes_of_a_program_that_is_killed_end(tmp_path: Path) -> None:
    script = tmp_path / "endless.py"
    script.write_text(ENDLESS, encoding="utf-8")
    files = [tmp_path / "one", tmp_path / "two"]
    with subprocess.Popen([sys.executable, script, *files]) as program:
        wait_for(lambda: all(file.exists() and file.read_text() for file in files))
        program.kill()
    workers = [int(file.read_text()) for file in files]
    wait_for(lambda: not any(is_running(worker) for worker in workers))


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def is_running(process: int) -> bool:
    try:
        return "\nState:\tZ" not in Path(f"/proc/{process}/status").read_text(encoding="utf-8")
    except OSError:
        return False


def _die(value: float) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_cases_that_kill_every_worker_are_given_up() -> None:
    with pytest.raises(ch.InputError, match="workers died 3 times; 2 of 2 cases are not computed"):
        list(compute(_die, range(2), workers=1))


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"samples": []}, "no samples"),
        ({"samples": SAMPLES, "seeds": []}, "no seeds"),
        ({"samples": SAMPLES, "seeds": [1, -1]}, "seed is -1"),
        ({"samples": [{"friction_level.level": 0.9}], "scenario": "shift"}, "friction_level.level"),  # of which clutch?
        ({"samples": SAMPLES, "profile": "no_such"}, "profile 'no_such' does not exist"),
        ({"samples": SAMPLES, "seconds": float("nan")}, "a run of nan s is not possible"),
        ({"samples": [{"a": 1.0}, {"b": 1.0}]}, "all samples need the same"),
        ({"samples": [{"friction_level.level": 99.0}]}, "friction_level.level"),
        ({"samples": [{"controller.no.such": 1.0}]}, "no.such"),
        ({"samples": SAMPLES, "measures": ["beauty"]}, "measure 'beauty' is unknown"),
        ({"samples": SAMPLES, "workers": 0}, "workers is 0; allowed are 1 to 256"),
        ({"samples": SAMPLES, "seeds": range(10**6)}, "runs are not possible; allowed are 1 to 1000000"),
        (
            {"samples": SAMPLES, "workers": 2, "address": "tcp://127.0.0.1:1"},
            "workers = 2 and a cluster at",
        ),
    ],
)
def test_a_sweep_that_cannot_be_is_refused_before_anything_is_computed(
    arguments: dict, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(executors, "ProcessPoolExecutor", lambda *_, **__: pytest.fail("something is computed"))
    with pytest.raises(ch.InputError, match=sentence):
        ch.sweep(**arguments)


def test_a_broken_pool_is_what_the_library_says_of_a_dead_worker() -> None:
    assert issubclass(BrokenProcessPool, executors.BrokenExecutor)
