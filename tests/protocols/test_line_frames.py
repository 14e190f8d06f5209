"""Usual lines of text logs: what is parsed at once is what python-can's reader makes of the same file, to the bit."""

import random
from pathlib import Path

import numpy as np
import pytest

from protocols.errors import InputError
from protocols.files.bus_logs.bus_frames import BusLog
from protocols.files.bus_logs.bus_log import read_bus_log

HEAD = "date Wed Nov 25 03:01:09.978 2026\nbase hex  timestamps absolute\ninternal events logged\n"
# Lines of every kind, with what is not usual between what is
CANDUMP = [
    "(1700000000.123456) can0 123#0011223344556677", "(0.5) can1 123#", "(1.000001) can0 1ABCDEF0#AA R",
    "(2.25)   vcan7    7ff#0102  T", "(3.0) 2 001#FF", "(3.5) 02 001#FF", "(12345678901234567890.5) can0 1#00",
    "(9007199254.740993) can0 100#01", "(90071992547.409931) can0 100#01", "(4.1) can0 800#00",
    "(4.2) can0 20000080#0000000000000000",
    "(5.) can0 100#00", "(6) can0 100#00", "(6.5) can0 100#R4", "(6.6) can0 100##1AABB", "(6.7) can0 100#0",
    "(6.8) can0 100#001122334455667788", "# remark", "", "(7.5) can0 00000123#AB", "(8.5) can0 100#AB X", "(8.6) can(0 100#AB",
    "(8.7) can0 100#AB R ", " (8.8) can0 100#AB", "(8.9) can0\t100#AB",
    "(9.0) ca\u00e9 100#AB", "(0.1234567890123456789) can0 100#AB",
]  # fmt: skip
ASC = [
    "   0.000100 1  100             Rx   d 8 00 11 22 33 44 55 66 77", "1.5 2 123x Tx d 2 AA BB", "1.6 1 1FFFFFFFx Rx d 0",
    "1.7 1 100 Rx d 3 01 02 03  Length = 240015 BitCount = 124 ID = 256", "1.8 1 100 Rx d 4 01 02", "1.9 1 900 Rx d 1 00",
    "2.0 1 100 Rx r", "2.1 1 ErrorFrame", "2.2 01 100 Rx d 1 05", "2.3 12 7FF Rx d 1 0F", "2.4 1 100 TxRq d 1 00",
    "2.5 CANFD 1 Rx 100 a 1 0 8 8 00 11 22 33 44 55 66 77 0 0 0 0 0 0 0 0", "// remark", "End TriggerBlock",
    "2.6 1 418fef1fex Rx d 1 00", "2.7 1 100 rx d 1 00", "2.8 1 100 Rx d 1 0G", "2.9 1a 100 Rx d 1 00", "3 1 100 Rx d 1 00",
    "3.1 1 100 Rx d 9 00 11 22 33 44 55 66 77 88", "3.2 1 100 Rx d 1 001", "3.3 0 100 Rx d 1 01",
]  # fmt: skip


def read_by_python_can(path: Path, monkeypatch: pytest.MonkeyPatch) -> BusLog:
    with monkeypatch.context() as patched:
        patched.setattr("protocols.files.bus_logs.bus_log._find_usual_lines", lambda *_: None)
        return read_bus_log(path)


def check_equal(path: Path, monkeypatch: pytest.MonkeyPatch) -> BusLog:
    """Both ways give the same frames, counts and notes."""
    wanted, log = read_by_python_can(path, monkeypatch), read_bus_log(path)
    assert (log.channels, log.damaged, log.cut, log.notes) == (
        wanted.channels,
        wanted.damaged,
        wanted.cut,
        wanted.notes,
    )
    for name in ("stamps", "ids", "flags", "channel", "lengths"):
        np.testing.assert_array_equal(getattr(log, name), getattr(wanted, name), err_msg=name)
    assert [log.read_data(row) for row in range(len(log))] == [wanted.read_data(row) for row in range(len(wanted))]
    return log


@pytest.mark.parametrize("kind", ["candump", "asc"])
@pytest.mark.parametrize("line_break", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("ends", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_lines_of_every_kind_are_read_as_python_can_reads_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, line_break: str, ends: bool, seed: int
) -> None:
    draw = random.Random(seed)
    kinds = CANDUMP if kind == "candump" else ASC
    lines = [kinds[0], kinds[0], *(draw.choice(kinds[:4] + kinds) for _ in range(400))]
    text = (HEAD if kind == "asc" else "") + "\n".join(lines) + "\n"
    text = text.replace("\n", line_break)
    path = tmp_path / "bus.log"
    path.write_bytes(text.encode() if ends else text.encode()[: -3 - draw.randrange(12)])
    monkeypatch.setattr("protocols.files.bus_logs.line_frames._PART", 3000)  # a part ends within lines
    assert len(check_equal(path, monkeypatch)) > 100


@pytest.mark.parametrize("cut", range(1, 40))
def test_a_log_that_ends_anywhere_is_cut_as_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cut: int) -> None:
    path = tmp_path / "bus.log"
    path.write_text("".join(f"({k}.5) can0 100#{k:016X} R\n" for k in range(20))[:-cut])
    check_equal(path, monkeypatch)


def test_a_log_of_damaged_lines_is_refused_as_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "bus.log"
    path.write_text("(1.5) can0 100#00\n(1.6) can0 100#00\n" + "(1.5) can0 100#0G\n" * 3000)
    for read in (read_bus_log, lambda path: read_by_python_can(path, monkeypatch)):
        with pytest.raises(InputError, match="is not a frame"):
            read(path)
    few = "(1.5) can0 100#00\n" * 4000 + "(1.5) can0 100#0G\n" * 3000
    path.write_text(few)
    assert check_equal(path, monkeypatch).damaged == 3000


@pytest.mark.parametrize("count", [256, 257])
def test_as_many_channels_as_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    path = tmp_path / "bus.log"
    path.write_text("".join(f"({k}.5) c{k} 100#00\n" for k in range(count)))
    if count > 256:
        for read in (read_bus_log, lambda path: read_by_python_can(path, monkeypatch)):
            with pytest.raises(InputError, match="more than 256 channels: it is damaged"):
                read(path)
    else:
        assert len(check_equal(path, monkeypatch).channels) == 256


def test_times_are_rounded_as_float_rounds_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    draw = random.Random(3)
    texts = [
        f"{draw.randrange(10 ** draw.randrange(1, 12))}.{draw.randrange(10**9):0{draw.randrange(1, 10)}d}"
        for _ in range(3000)
    ]
    path = tmp_path / "bus.log"
    path.write_text("".join(f"({text}) can0 100#00\n" for text in texts))
    assert sorted(check_equal(path, monkeypatch).stamps.tolist()) == sorted(map(float, texts))
