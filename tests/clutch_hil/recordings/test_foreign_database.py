"""Databases of other buses: what of them has no certain meaning is left out, and a map that asks for it is told why."""

from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.channel import choose_channel
from clutch_hil.recordings.format import open_recording
from tests.clutch_hil.recordings.bus_logs import format_candump, make_message
from tests.clutch_hil.recordings.maps import find_refusal, import_by

ROWS = 60
RAW = np.arange(ROWS) - 30
DATABASE = """VERSION ""
BO_ 256 CLUTCH: 8 A
 SG_ TORQUE : 0|16@1- (0.5,0) [0|0] "Nm" B
 SG_ COUNT : 24|8@1+ (1,0) [0|0] "" B

BO_ 512 OTHER: 8 A
 SG_ SPEED : 7|16@0- (0.125,0) [0|0] "rad/s" B
"""
MAP = '[file]\ndbc = "car.dbc"\n[columns]\ntime_s = { from = "CLUTCH.time" }\ntorque_nm = { from = "CLUTCH.TORQUE" }\n'


def write(tmp_path: Path, database: str = DATABASE) -> Path:
    (tmp_path / "car.dbc").write_text(database)
    messages = [
        make_message(0.01 * n, 0x100, int(raw).to_bytes(2, "little", signed=True) + bytes((0, n % 256, 0, 0, 0, 0)))
        for n, raw in enumerate(RAW)
    ]
    path = tmp_path / "car.log"
    path.write_text(format_candump(messages))
    return path


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("(0.5,0)", "(0,0)", "CLUTCH.TORQUE: its factor is 0"),
        ("SG_ COUNT", "SG_ TORQUE", "CLUTCH.TORQUE: CLUTCH has 2 signals of this name"),
        ("BO_ 512", "BO_ 256", "CLUTCH.TORQUE: CLUTCH, OTHER have the identifier 0x100 in common"),
        ("24|8", "8|8", "CLUTCH.TORQUE: it overlaps with COUNT"),
        ("0|16@1-", "60|16@1-", "CLUTCH.TORQUE: its bits are not in the frame"),
        (
            "BO_ 512",
            "SIG_VALTYPE_ 256 TORQUE : 1;\n\nBO_ 512",
            "CLUTCH.TORQUE: it has 16 bits and is a float (SIG_VALTYPE_), which has 32 or 64",
        ),
    ],
)
def test_a_signal_without_a_certain_meaning_is_refused_with_the_reason(
    tmp_path: Path, old: str, new: str, why: str
) -> None:
    database = DATABASE.replace(old, new)
    if "SIG_VALTYPE_" in new:  # stands behind all messages
        database = DATABASE + new.partition("\n")[0] + "\n"
    assert f"left out {why}" in find_refusal(tmp_path, write(tmp_path, database), MAP)


def cut_frames(path: Path, digits: int, every: int = 1) -> None:
    """Shorten each frame, or each `every`th one, to its first `digits`."""
    lines = path.read_text().splitlines()
    cut = [line.partition("#")[0] + "#" + line.partition("#")[2][:digits] for line in lines]
    path.write_text("".join(f"{cut[n] if n % every == 0 else line}\n" for n, line in enumerate(lines)))


@pytest.mark.parametrize("digits", [4, 6, 14])
def test_the_signals_that_fit_into_short_frames_are_read(tmp_path: Path, digits: int) -> None:
    path = write(tmp_path)
    cut_frames(path, digits)
    run = import_by(tmp_path, path, MAP)
    np.testing.assert_array_equal(run["torque_nm"], 0.5 * RAW)
    told = f"{ROWS} frames of CLUTCH with fewer than 8 bytes: the signals whose bits they have are read"
    assert told in str(run.metadata["import"])


@pytest.mark.parametrize("digits", [0, 2])
def test_a_signal_that_no_frame_has_is_told(tmp_path: Path, digits: int) -> None:
    path = write(tmp_path)
    cut_frames(path, digits)
    path.write_text(path.read_text() + "(1.0) can0 200#0000000000000000\n")
    sentence = find_refusal(tmp_path, path, MAP.replace("CLUTCH.time", "OTHER.time"))
    why = "no frame has its bits" if digits else ""
    why = why or f"left out {ROWS} frames of CLUTCH with fewer than 8 bytes"
    assert "has no column 'CLUTCH.TORQUE'" in sentence
    assert why in sentence


def test_signals_of_frames_of_several_lengths_have_the_times_of_theirs(tmp_path: Path) -> None:
    path = write(tmp_path)
    cut_frames(path, 4, every=3)
    recording = open_recording(path, {"dbc": "car.dbc"})
    torque, count = (choose_channel(path, recording.channels, f"CLUTCH.{name}") for name in ("TORQUE", "COUNT"))
    assert (torque.raster, count.raster) == ("CLUTCH", "CLUTCH[8 bytes]")
    signals = recording.read([torque, count])
    np.testing.assert_array_equal(signals[0].values, 0.5 * RAW)
    there = np.arange(ROWS)[np.arange(ROWS) % 3 > 0]
    np.testing.assert_array_equal(signals[1].values, there)
    np.testing.assert_allclose(signals[1].time, 0.01 * there, atol=1e-9)


def test_a_message_that_is_there_twice_alike_is_read(tmp_path: Path) -> None:
    twice = DATABASE + DATABASE.partition("\n")[2].partition("\n\n")[0] + "\n"
    run = import_by(tmp_path, write(tmp_path, twice), MAP)
    np.testing.assert_array_equal(run["torque_nm"], 0.5 * RAW)
