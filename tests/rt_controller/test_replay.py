"""`clutch-hil replay`: answers are equal to the bit in one process, on a bus, and for all log formats."""

import json
import subprocess
import sys
import time
from pathlib import Path

import can
import pytest

from protocols.can.frames import load_frames
from protocols.errors import InputError
from rt_controller.loop.bench_log import Log
from rt_controller.loop.replay import answer_log_on_bus
from tests.processes import list_errors, play_here
from tests.rt_controller.bus_log import write_log

SECONDS = 3.0
ENCODER_B = load_frames(clutch="b")["ENCODER"]


def replay(*arguments: object) -> subprocess.CompletedProcess[str]:
    return play_here("replay", *arguments)


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


def test_a_log_from_before_the_claims_is_answered_as_then(log: Path, tmp_path: Path) -> None:
    """Its set-points have the data ID of the DBC; the answers are those of the same demand with a claim."""
    before = tmp_path / "before.log"
    write_log(before, SECONDS, claimed=False)
    summary = replay_summary(before)
    assert summary["cycles"] == summary["logged"] == summary["equal"] == SECONDS * 1000
    assert summary["sha256"] == replay_summary(log)["sha256"]
    assert summary["defects"] is None


def test_a_log_that_begins_in_a_run_has_no_corrupt_set_point(log: Path, tmp_path: Path) -> None:
    """Its first claim comes after some set-points, whose supervisor it tells."""
    part = tmp_path / "part.blf"
    with can.BLFReader(log) as messages, can.Logger(part) as writer:
        for message in messages:
            if message.timestamp > 1.512:
                writer(message)
    summary = replay_summary(part)
    assert summary["corrupt"] == 0
    assert summary["defects"] is None
    assert "the log begins after the start of its controller, whose state then is unknown" in replay(part).stdout


def test_a_command_that_was_left_out_changes_no_answer_after_it(log: Path, tmp_path: Path) -> None:
    """As in real time, where a controller that woke up late answers the newest sample only: its later counters are lower."""
    text = tmp_path / "bus.log"
    write_log(text, SECONDS)
    lines, valve = text.read_text().splitlines(), load_frames()["VALVE_COMMAND"]
    at = [i for i, line in enumerate(lines) if f" {valve.can_id:03X}#" in line]
    for i in at[1000:]:
        head, _, data = lines[i].partition("#")
        payload, end = bytes.fromhex(data[:16]), data[16:]
        lines[i] = f"{head}#{valve.pack_raw(valve.read_counter(payload) - 1, *valve.raw(payload)).hex().upper()}{end}"
    del lines[at[999]]
    text.write_text("\n".join(lines) + "\n")
    summary = replay_summary(text)
    assert summary["equal"] == summary["logged"] == SECONDS * 1000 - 1


def test_a_controller_on_a_bus_answers_the_same(log: Path, local_bus: str) -> None:
    summary, expected = replay_summary(log, "--bus", local_bus), replay_summary(log)
    assert summary["sha256"] == expected["sha256"]
    assert summary["equal"] == expected["cycles"]


NEVER_ANSWERS = """
import pathlib, signal, sys, time
def end(*_):
    pathlib.Path(sys.argv[1]).touch()
    sys.exit()
signal.signal(signal.SIGTERM, end)
time.sleep(60)
"""


def test_a_controller_that_is_given_up_is_asked_to_end(
    log: Path, local_bus: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As it then sends the safe commands; a killed one sends nothing."""
    command = [sys.executable, "-c", NEVER_ANSWERS, str(tmp_path / "safe")]
    monkeypatch.setattr("rt_controller.loop.replay.list_command", lambda *_: command)
    monkeypatch.setattr("rt_controller.loop.replay._START_TIMEOUT", 1.0)
    with pytest.raises(InputError, match="no controller started on "):
        answer_log_on_bus(local_bus, Log(log, None, exact=False), [])
    assert (tmp_path / "safe").exists()


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
    done = replay(text, "--json")
    assert done.returncode == 1  # the log has a defect, and answers differ
    assert json.loads(done.stdout)["sha256"] != replay_summary(log)["sha256"]


@pytest.fixture(scope="module")
def lines(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """A short log as lines of candump: a second."""
    path = tmp_path_factory.mktemp("lines") / "bus.log"
    write_log(path, 1.0)
    return path.read_text().splitlines(keepends=True)


def replay_lines(tmp_path: Path, lines: list[str], code: int, *arguments: object) -> dict:
    """The summary of a replay that ends with an exit code."""
    path = tmp_path / "bus.log"
    path.write_text("".join(lines))
    done = replay(path, *arguments, "--json")
    assert done.returncode == code, done.stdout + done.stderr
    return json.loads(done.stdout)


def test_of_two_channels_one_is_asked_for_and_its_replay_is_equal(tmp_path: Path, lines: list[str]) -> None:
    alone = replay_lines(tmp_path, lines, 0)
    other = [line.replace(lines[0].split()[1], "can7") for line in lines]
    both = [line for pair in zip(lines, other, strict=True) for line in pair]
    assert replay_lines(tmp_path, both, 0, "--channel", "can7")["sha256"] == alone["sha256"]
    done = replay(tmp_path / "bus.log")
    assert done.returncode == 2
    assert "on 2 channels" in done.stderr
    assert "can7; choose one with --channel" in done.stderr
    unrelated = [
        f"(1.0{n:05d}) can7 100#00112233445566{n % 256:02X}\n" for n in range(2000)
    ]  # a car with an identifier of ours
    summary = replay_lines(tmp_path, lines + unrelated, 0)
    assert summary["sha256"] == alone["sha256"]
    assert any("took channel" in note for note in summary["notes"])


def test_a_log_that_is_out_of_order_is_ordered(tmp_path: Path, lines: list[str]) -> None:
    alone = replay_lines(tmp_path, lines, 0)
    blocks = [lines[first : first + 100][::-1] for first in range(0, len(lines), 100)]
    summary = replay_lines(tmp_path, [line for block in blocks for line in block], 0)
    assert summary["sha256"] == alone["sha256"]
    assert any("not in order of time" in note for note in summary["notes"])


def test_frames_that_a_bus_port_ignores_are_ignored_and_counted(tmp_path: Path, lines: list[str]) -> None:
    alone = replay_lines(tmp_path, lines, 0)
    at, channel = len(lines) // 2, lines[0].split()[1]
    strange = [
        f"{lines[at].split()[0]} {channel} {what}\n" for what in ("100#R", f"100##1{'AA' * 64}", "00000100#0011")
    ]
    summary = replay_lines(tmp_path, [*lines[:at], *strange, *lines[at:]], 0)
    assert summary["sha256"] == alone["sha256"]
    assert summary["ignored"] == {"remote": 1, "CAN FD": 1, "extended": 1}
    assert summary["defects"] is None


def test_lost_corrupt_and_cut_are_counted_and_answers_that_differ_by_them_end_with_1(
    tmp_path: Path, lines: list[str]
) -> None:
    encoders = [index for index, line in enumerate(lines) if " 101#" in line]
    lost = replay_lines(tmp_path, [line for n, line in enumerate(lines) if n not in encoders[500:503]], 1)
    assert (lost["lost"], lost["corrupt"]) == (3, 0)
    assert lost["equal"] < lost["logged"]
    head, _, data = lines[encoders[500]].partition("#")
    broken = [*lines[: encoders[500]], f"{head}#{int(data[0], 16) ^ 1:X}{data[1:]}", *lines[encoders[500] + 1 :]]
    corrupt = replay_lines(tmp_path, broken, 1)
    assert (corrupt["lost"], corrupt["corrupt"]) == (0, 1)
    short = replay_lines(tmp_path, [*lines[: encoders[500]], f"{head}#00\n", *lines[encoders[500] :]], 0)
    assert (short["misshapen"], short["equal"]) == (1, short["logged"])
    cut = replay_lines(
        tmp_path, [*lines[: encoders[500]], lines[encoders[500]].rstrip()[:-7]], 0
    )  # what is there is answered equally
    assert "ends within line" in cut["cut"]
    assert "the log is cut" in cut["defects"]


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
        ("bus.parquet", "PAR1", "cannot be read: it is a Parquet file, as of a run; known are candump"),
        ("bus.txt", "x", "cannot be read: it begins with b'x'; known are candump, Vector ASC and BLF, PEAK TRC"),
        ("empty.log", "", "is empty"),
        ("car.log", "(1.0) can0 123#0011\n", "has no sample of a plant"),
        ("bad.blf", "this is no log", "cannot be read: "),
        (
            "two.log",
            f"(1.0) can0 {ENCODER_B.can_id:03X}#{ENCODER_B.pack_raw(0, 0, 0).hex()}",
            "is of a run of two clutches, whose controllers receive",
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
    assert len(list_errors(done.stderr)) == 1
