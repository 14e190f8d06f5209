"""Recordings of a running bench: what `clutch-hil record` writes is what `clutch-hil up` writes, and gaps are told."""

import json
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from clutch_hil.live.recording import bench_recording
from clutch_hil.live.tuning.tune import set_parameters
from protocols.errors import InputError, InterruptionError
from protocols.files.runs import read_run
from protocols.realtime.child import list_command
from protocols.realtime.notify import NoNotifier
from protocols.realtime.stopping import Stop
from protocols.telemetry.feed import Feed, NoBenchError, find_bench
from protocols.telemetry.session import open_consumer_session
from tests.clutch_hil.live.running import run_command
from tests.clutch_hil.live.scripted_bench import RATE, SECONDS
from tests.processes import PATIENCE, await_file, list_errors, service


def read_result(child: subprocess.Popen) -> dict[str, Any]:
    out, errors = child.communicate(timeout=PATIENCE)
    assert child.returncode == 0, out + errors
    return json.loads(out)


def find_refusal(*arguments: str) -> str:
    command = list_command(*arguments)
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 2
    assert len(list_errors(done.stderr)) == 1, done.stderr
    return done.stderr


def run_up(bus: str, out: Path, seconds: float = SECONDS) -> Any:
    return service("up", "--bus", bus, "--rate", str(RATE), "--seconds", str(seconds), "--out", str(out), "--json")


def test_a_bench_that_comes_between_two_looks_is_found() -> None:
    looks = iter([NoBenchError("no bench publishes telemetry"), "local:new@here"])

    def find() -> str:
        look = next(looks)
        if isinstance(look, NoBenchError):
            raise look
        return look

    assert bench_recording._wait_for_bench(find, Stop(), PATIENCE, NoNotifier()) == "local:new@here"


def test_who_ends_the_waiting_for_a_bench_has_no_recording() -> None:
    def find() -> str:
        raise NoBenchError("no bench publishes telemetry")

    stop = Stop()
    stop.asked = True
    with pytest.raises(InterruptionError, match="no bench was found; nothing was recorded"):
        bench_recording._wait_for_bench(find, stop, PATIENCE, NoNotifier())


def test_a_saved_view_that_exists_is_told_before_anything_is_recorded(tmp_path: Path) -> None:
    (tmp_path / "run.rrd").touch()
    with Stop() as stop, pytest.raises(InputError, match="exists already"):
        bench_recording.record(tmp_path / "run.rrd", None, None, 0.0, stop, lambda text: None)


# --- real processes


def test_record_and_up_write_the_same_values(local_bus: str, tmp_path: Path) -> None:
    path = tmp_path / "wire.mf4"
    with service("record", str(path), "--bus", local_bus, "--json") as recorder, run_up(local_bus, tmp_path) as bench:
        ours = read_run(Path(read_result(bench)["run"]))
        message = read_result(recorder)  # ends by itself: the bench is gone
    run = read_run(path)
    rows = len(ours["time_s"])
    assert message["rows_lost"] == {"plant": 0, "controller": 0}
    assert list(run.columns) == list(ours.columns)
    for name in ours.columns:
        np.testing.assert_array_equal(run[name][:rows], ours[name], err_msg=name)
    assert (run.units, run.meanings) == (ours.units, ours.meanings)
    assert run.metadata["bus"].startswith(ours.metadata["bus"])  # the bench's name tells folders of local buses apart
    for key in ("rig", "sample_rate_hz", "plant_parameters", "controller_parameters"):
        assert run.metadata[key] == ours.metadata[key], key
    assert not list(tmp_path.glob("*.part"))
    assert not list(tmp_path.glob("wire.mf4.*"))


def test_a_late_recorder_has_the_past_and_ctrl_c_keeps_the_file(local_bus: str, tmp_path: Path) -> None:
    path = tmp_path / "late"
    with run_up(local_bus, tmp_path, 60.0), open_consumer_session(None) as session:
        bench = wait_for_bench(session, local_bus)
        with Feed(session, bench, live=True) as feed:
            deadline = time.monotonic() + PATIENCE
            while not any(batch.node == "plant" and batch.end > 2 * RATE for batch in feed.read(0.1)):
                assert time.monotonic() < deadline
        with service("record", str(path), "--bus", local_bus, "--json") as recorder:
            await_file(tmp_path / "late.parquet.part")
            changed = set_parameters(session, bench, "controller", {"torque.proportional_gain": 0.02})["changed"]
            time.sleep(0.5)  # rows with the change: two looks of the recorder
            recorder.send_signal(signal.SIGINT)
            message = read_result(recorder)
    run = read_run(tmp_path / "late.parquet")
    assert message["good"]
    assert run["time_s"][0] == 0.0
    assert run["time_s"][-1] > 2.0
    assert [noted | change for noted, change in zip(run.metadata["parameter_changes"], changed, strict=True)] == (
        run.metadata["parameter_changes"]
    )
    assert run.metadata["controller_parameters"]["torque.proportional_gain"] == 0.012


def wait_for_bench(session: Any, bus: str) -> str:
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            return find_bench(session, bus)
        except InputError:
            assert time.monotonic() < deadline
            time.sleep(0.1)


# --- what is refused


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("run.xlsx",), "cannot be recorded as '.xlsx'; allowed are .asc, .blf, .csv, .log"),
        (("--seconds", "-1"), "--seconds -1 is not possible"),
        (("run.blf", "--router", "tcp/1.2.3.4:7447"), "leave --router out"),
        (("run.blf", "--bus", "can7"), "bus 'can7' does not exist"),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(tmp_path: Path, arguments: tuple[str, ...], sentence: str) -> None:
    assert sentence in find_refusal("record", *arguments)


@pytest.mark.parametrize("name", ["run.parquet", "run.csv", "run.rrd", "run.blf", "run"])
def test_a_file_that_is_there_is_not_recorded_over(tmp_path: Path, name: str) -> None:
    path = (tmp_path / name).with_suffix(Path(name).suffix or ".parquet")
    path.write_text("before")
    done = run_command("record", str(tmp_path / name), "--bus", "local:nobody", "--seconds", "0")
    assert str(done.exception) == f"file {path} exists already; give another name, or --overwrite to replace it"
    assert path.read_text() == "before"


def test_rows_of_an_earlier_recording_are_not_recorded_over(tmp_path: Path) -> None:
    (tmp_path / "run.csv.parquet").write_text("before")
    done = run_command("record", str(tmp_path / "run.csv"), "--bus", "local:nobody", "--seconds", "0")
    assert (
        str(done.exception)
        == f"file {tmp_path / 'run.csv.parquet'} exists already; give another name, or --overwrite to replace it"
    )


@pytest.mark.parametrize("name", ["run.parquet", "run.csv", "run.rrd", "run.log"])
def test_a_place_that_is_none_is_told_by_the_name_that_was_given(tmp_path: Path, name: str) -> None:
    done = run_command("record", str(tmp_path / "none" / name), "--bus", "local:nobody", "--seconds", "0")
    assert str(done.exception) == f"folder {tmp_path / 'none'} of {name} does not exist"
    assert not (tmp_path / "none").exists()
    done = run_command("record", f"/proc/{name}", "--bus", "local:nobody", "--seconds", "0")  # nobody makes files there
    assert str(done.exception).startswith(f"file /proc/{name} cannot be written: ")
