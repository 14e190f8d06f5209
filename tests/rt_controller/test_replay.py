"""`clutch-hil replay`: answers are equal to the bit in one process, on a bus, and for all log formats."""

import json
import subprocess
import time
from pathlib import Path

import pytest

from protocols.can.frames import load_frames
from protocols.realtime import child
from tests.processes import PATIENCE, said
from tests.rt_controller.bus_log import write_log

SECONDS = 3.0
ENCODER_B = load_frames(clutch="b")["ENCODER"].can_id


def replay(*arguments: object) -> subprocess.CompletedProcess:
    command = child.clutch_hil("replay", *map(str, arguments))
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)


def replay_summary(*arguments: object) -> dict:
    done = replay(*arguments, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "bus.blf"
    write_log(path, SECONDS)
    return path


def test_every_answer_is_the_logged_one(log: Path) -> None:
    summary = replay_summary(log)
    assert summary["cycles"] == summary["logged"] == summary["equal"] == SECONDS * 1000
    assert summary["rate_hz"] == 1000


@pytest.mark.parametrize("suffix", [".log", ".asc"])
def test_the_format_of_the_log_does_not_matter(log: Path, tmp_path: Path, suffix: str) -> None:
    other = tmp_path / f"bus{suffix}"
    write_log(other, SECONDS)
    assert replay_summary(other)["sha256"] == replay_summary(log)["sha256"]


def test_a_controller_on_a_bus_answers_the_same(log: Path, local_bus: str) -> None:
    summary, expected = replay_summary(log, "--bus", local_bus), replay_summary(log)
    assert summary["sha256"] == expected["sha256"]
    assert summary["equal"] == expected["cycles"]


def test_another_law_is_another_answer(log: Path) -> None:
    summary = replay_summary(log, "--law", "feedforward")
    assert summary["sha256"] != replay_summary(log)["sha256"]
    assert 0 < summary["equal"] < summary["logged"]


def test_one_flipped_bit_in_the_log_is_another_answer(tmp_path: Path, log: Path) -> None:
    """A corrupt sample is refused, so the controller runs a cycle without it."""
    text = tmp_path / "bus.log"
    write_log(text, SECONDS)
    lines = text.read_text().splitlines()
    at = [i for i, line in enumerate(lines) if " 101#" in line][1500]
    head, _, data = lines[at].partition("#")
    lines[at] = f"{head}#{int(data[0], 16) ^ 1:X}{data[1:]}"
    text.write_text("\n".join(lines) + "\n")
    assert replay_summary(text)["sha256"] != replay_summary(log)["sha256"]


def test_it_is_faster_than_real_time(tmp_path: Path) -> None:
    path = tmp_path / "long.blf"
    write_log(path, 12.0)
    began = time.perf_counter()
    assert replay_summary(path)["cycles"] == 12_000
    taken = time.perf_counter() - began  # the start of the process included; 60 s of log took 4 s on a busy machine
    assert taken < 12.0


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("nosuch.blf", None, "does not exist"),
        ("bus.txt", "x", "cannot be read: No read support for unknown log format"),
        ("empty.log", "", "has no sample of a plant"),
        ("bad.blf", "this is no log", "cannot be read: "),
        (
            "two.log",
            f"(1.0) can0 {ENCODER_B:03X}#0000000000000000",
            "is of a run of two clutches, whose controllers hear",
        ),
    ],
)
def test_what_is_no_log_is_one_sentence(tmp_path: Path, name: str, content: str | None, words: str) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_text(content)
    done = replay(path)
    assert done.returncode == 2
    assert words in done.stderr
    assert len(said(done.stderr)) == 1
