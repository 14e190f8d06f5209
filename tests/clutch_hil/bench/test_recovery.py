"""Recovery: what a killed recorder leaves becomes run files."""

import os
import random
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from clutch_hil.bench.recording import Recording
from clutch_hil.bench.recovery import recover, recover_folder
from clutch_hil.bench.sealed import SealedRecording
from clutch_hil.bench.unseal import read_truth
from protocols.errors import InputError
from protocols.files.journal import Journal, list_journals
from protocols.files.runs import REQUIRED, read_run
from protocols.node import Column
from tests.clutch_hil.live.running import run_command as command
from tests.processes import service

RATE = 1000
PLANT = [*(Column(name, "1", name) for name in REQUIRED), Column("truth_torque_nm", "Nm", "the truth")]
CONTROLLER = [Column("sample_tick", "1", "tick"), Column("torque_demand_nm", "Nm", "M_d")]
METADATA = {"rig": "wet_clutch", "sample_rate_hz": RATE, "settings": {"rate": RATE, "seed": 7}, "plant_parameters": {}}


def record(path: Path, rows: int, kind: type[Recording] = Recording) -> Recording:
    """A recording that has taken `rows` rows, in pieces; it is neither finished nor left."""
    recording = kind(path, PLANT, [CONTROLLER], RATE)
    recording.keep_journal(METADATA)
    for first in range(0, rows, 100):
        ticks = np.arange(first, min(first + 100, rows), dtype=float)
        plant = np.ones((len(ticks), len(PLANT)))
        plant[:, 0] = ticks / RATE
        answered = np.append(ticks, ticks[-1] + 1.0)  # a row is joined once a later sample is answered
        recording.add(plant, np.column_stack([answered, 0.5 * answered]))
    return recording


def write_killed_journal(path: Path, rows: int, kind: type[Recording] = Recording) -> Path:
    """The journal of a recorder that is killed after `rows` rows."""
    if not (child := os.fork()):
        record(path, rows, kind)
        os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)
    (journal,) = list_journals(path.parent)
    return journal


@pytest.mark.parametrize("rows", [2, 1234, 45_000])
def test_every_row_is_recovered(tmp_path: Path, rows: int) -> None:
    result = recover(write_killed_journal(tmp_path / "run.parquet", rows))
    run = read_run(tmp_path / "run.parquet")
    assert (result.file, result.samples) == (tmp_path / "run.parquet", rows)
    np.testing.assert_array_equal(run["time_s"], np.arange(rows) / RATE)
    np.testing.assert_array_equal(run["controller_sample_tick"], np.arange(rows))
    assert run.metadata["rig"] == "wet_clutch"
    assert "killed" in run.metadata["incomplete"]
    assert run.units["truth_torque_nm"] == "Nm"
    assert [path.name for path in tmp_path.iterdir()] == ["run.parquet"]


def test_a_blind_run_stays_blind(tmp_path: Path) -> None:
    journal = write_killed_journal(tmp_path / "run.parquet", 500, SealedRecording)
    assert journal.name == "run.truth.parquet.journal"  # it shows the truth, and its name says so
    recover(journal)
    run = read_run(tmp_path / "run.parquet")
    assert "truth_torque_nm" not in run.columns
    assert "seed" not in run.metadata["settings"]
    _, whole = read_truth(tmp_path / "run.parquet")
    assert len(whole["truth_torque_nm"]) == 500
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.parquet", "run.truth.parquet"]


def test_a_run_that_was_to_be_replaced_stays(tmp_path: Path) -> None:
    with record(tmp_path / "run.parquet", 300) as first:
        first.finish(METADATA)
    before = (tmp_path / "run.parquet").read_bytes()
    assert recover(write_killed_journal(tmp_path / "run.parquet", 20)).file == tmp_path / "run-recovered.parquet"
    assert (tmp_path / "run.parquet").read_bytes() == before


@pytest.mark.parametrize("kind", [Recording, SealedRecording])
def test_a_run_that_was_complete_is_not_written_twice(tmp_path: Path, kind: type[Recording]) -> None:
    """Its recorder was killed before it removed the journal."""
    journal = write_killed_journal(tmp_path / "run.parquet", 300, kind)
    content = journal.read_bytes()
    recover(journal)
    files = sorted(path.name for path in tmp_path.iterdir())
    journal.write_bytes(content)
    result = recover(journal)
    assert (result.file, result.samples, result.was_complete) == (tmp_path / "run.parquet", 300, True)
    assert "was complete" in str(result)
    assert sorted(path.name for path in tmp_path.iterdir()) == files


def test_an_unfinished_file_without_a_journal_is_removed_once_its_writer_is_dead(tmp_path: Path) -> None:
    """A recorder that is killed before its first row leaves no journal."""
    living = Recording(tmp_path / "living.parquet", PLANT, [CONTROLLER], RATE)
    if not (child := os.fork()):
        Recording(tmp_path / "dead.parquet", PLANT, [CONTROLLER], RATE)
        os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)
    assert len(list(tmp_path.iterdir())) == 2
    recover_folder(tmp_path, print)
    assert [path.name for path in tmp_path.iterdir()] == ["living.parquet.part"]
    rows = np.ones((3, len(PLANT)))
    rows[:, 0] = np.arange(3) / RATE
    living.add(rows, np.ones((3, len(CONTROLLER))))
    living.finish(METADATA)
    assert len(read_run(tmp_path / "living.parquet")["time_s"]) == 3


@pytest.mark.parametrize("rows", [0, 1])
def test_fewer_than_two_rows_are_no_run(tmp_path: Path, rows: int) -> None:
    result = recover(write_killed_journal(tmp_path / "run.parquet", rows))
    assert (result.file, result.samples) == (None, rows)
    assert not list(tmp_path.iterdir())


def test_a_living_recorder_is_left_alone(tmp_path: Path) -> None:
    sentence: list[str] = []
    with record(tmp_path / "run.parquet", 300) as recording:
        assert recover_folder(tmp_path, sentence.append) == []
        recording.finish(METADATA)
    assert sentence == []
    assert [path.name for path in tmp_path.iterdir()] == ["run.parquet"]


def test_what_is_no_journal_of_a_run_stays_and_is_told(tmp_path: Path) -> None:
    (tmp_path / "x.parquet.journal").write_bytes(b"something else")
    other = Journal(tmp_path / "y.parquet", [Column("angle_rad", "rad", "no time")], {})
    other.append(np.ones((50, 1)))
    other.close()
    sentence: list[str] = []
    recover_folder(tmp_path, sentence.append)
    assert "x.parquet.journal" in sentence[0]
    assert "lacks the column time_s" in sentence[1]
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["x.parquet.journal", "y.parquet.journal"]


def test_an_error_keeps_the_samples_until_then(tmp_path: Path) -> None:
    kept = r"the plant was killed; the 300 samples until then are in .*run.parquet"
    with pytest.raises(InputError, match=kept), record(tmp_path / "run.parquet", 300):
        raise InputError("the plant was killed")
    run = read_run(tmp_path / "run.parquet")
    assert len(run["time_s"]) == 300
    assert run.metadata["incomplete"] == "the plant was killed"
    assert [path.name for path in tmp_path.iterdir()] == ["run.parquet"]


def test_the_command(tmp_path: Path) -> None:
    write_killed_journal(tmp_path / "run.parquet", 300)
    done = command("recover", str(tmp_path))
    assert done.exit_code == 0
    assert done.stdout.endswith("verdict: 1 of 1 recovered\n")
    assert f"wrote:   {tmp_path / 'run.parquet'}  (300 samples)" in done.stdout
    assert "nothing to recover" in command("recover", str(tmp_path)).stdout
    assert "none does not exist" in str(command("recover", str(tmp_path / "none")).exception)
    assert "is not a journal of a run" in str(command("recover", str(tmp_path / "run.parquet")).exception)
    (tmp_path / "x.parquet.journal").write_bytes(b"something else")
    assert command("recover", str(tmp_path)).exit_code == 1


@pytest.mark.parametrize("victim", ["up", "plant", "controller"])
def test_a_killed_process_of_a_bench_costs_less_than_a_second(tmp_path: Path, local_bus: str, victim: str) -> None:
    """The last second may be in rings and in pieces under way."""
    bench = "--bus", local_bus, "--profile", "engagement", "--out", str(tmp_path), "--no-telemetry"
    with service("up", *bench, stdout=subprocess.DEVNULL) as up:
        kill_and_judge(up, tmp_path, victim)


def kill_and_judge(up: "subprocess.Popen[str]", tmp_path: Path, victim: str) -> None:
    while not list_journals(tmp_path):
        assert up.poll() is None
        time.sleep(0.02)
    began = time.monotonic()
    time.sleep(random.Random(victim).uniform(2.0, 3.0))
    children = psutil.Process(up.pid).children()
    pids = {"up": up.pid} | {
        name: child.pid for child in children for name in ("plant", "controller") if name in child.cmdline()
    }
    os.kill(pids[victim], signal.SIGKILL)
    lived = time.monotonic() - began
    _, error = up.communicate(timeout=30)
    if victim == "up":
        recover_folder(tmp_path, print)
    else:
        assert "samples until then are in" in error
    (path,) = tmp_path.glob("*.parquet")
    run = read_run(path)
    assert run["time_s"][-1] > lived - 1.0
    assert run.metadata["incomplete"]
    assert [path] == list(tmp_path.iterdir())
