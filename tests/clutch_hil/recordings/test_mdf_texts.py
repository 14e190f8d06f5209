"""Channels of text in MDF files: numbers, and on and off, are read; damage beside the rows is told."""

import struct
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from asammdf import Signal
from asammdf.blocks.v4_blocks import ChannelConversion

from protocols.files.mdf.conversions import convert_texts
from tests.clutch_hil.recordings.maps import find_refusal, import_by
from tests.clutch_hil.recordings.mdf_files import (
    FORCE,
    MAP,
    POSITION,
    ROWS,
    TIME,
    make_plain_signals,
    make_signal,
    write,
)

NUMBERS = [f"{value:.4f}" for value in POSITION]


def make_text(name: str, texts: list[str], encoding: str = "utf-8", **options: object) -> Signal:
    return make_signal(name, np.array([text.encode(encoding) for text in texts]), encoding=encoding, **options)


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("compression", [0, 1, 2])
def test_numbers_as_text_are_read(tmp_path: Path, encoding: str, compression: int) -> None:
    signals = [make_text("pos", NUMBERS, encoding, unit="mm"), make_signal("force", FORCE, unit="N")]
    run = import_by(tmp_path, write(tmp_path / "a.mf4", signals, compression=compression), MAP)
    np.testing.assert_allclose(run["position_m"], 1e-3 * np.array(NUMBERS, float), atol=1e-15)
    np.testing.assert_array_equal(run["motor_force_n"], FORCE)
    np.testing.assert_allclose(run["time_s"], TIME)


def test_numbers_as_text_in_the_rows_of_mdf_3_are_read(tmp_path: Path) -> None:
    signals = [make_text("pos", NUMBERS, "latin-1", unit="m"), make_signal("force", FORCE, unit="N")]
    run = import_by(tmp_path, write(tmp_path / "a.mdf", signals, version="3.30"), MAP)
    np.testing.assert_array_equal(run["position_m"], np.array(NUMBERS, float))


def test_on_and_off_as_text_are_a_status(tmp_path: Path) -> None:
    valve = make_text("valve", ["on" if row // 100 % 2 else "off" for row in range(ROWS)])
    columns = MAP + 'valve_1 = { from = "valve", unit = "1" }\n'
    run = import_by(tmp_path, write(tmp_path / "a.mf4", [*make_plain_signals(), valve]), columns)
    np.testing.assert_array_equal(run["valve_1"], np.arange(ROWS) // 100 % 2)


def make_table_of_texts(**entries: object) -> ChannelConversion:
    """A conversion of texts to numbers."""
    words = sum(key.startswith("text_") for key in entries)
    conversion = ChannelConversion(conversion_type=9, links_nr=4 + words, val_default=0.0, **entries)
    conversion.referenced_blocks = {key: value for key, value in entries.items() if key.startswith("text_")}
    return conversion


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16-le"])
def test_text_is_the_numbers_that_the_file_converts_it_to(tmp_path: Path, encoding: str) -> None:
    words = make_table_of_texts(text_0=b"low", val_0=-0.125, text_1=b"high", val_1=2500.0, text_2=b"high", val_2=1.0)
    texts = [["low", "high", "other"][row % 3] for row in range(ROWS)]
    signal = make_text("pos", texts, encoding, conversion=words, unit="mm")
    run = import_by(tmp_path, write(tmp_path / "a.mf4", [signal, make_signal("force", FORCE, unit="N")]), MAP)
    np.testing.assert_allclose(run["position_m"], np.tile([-0.125e-3, 2.5, 0.0], ROWS // 3), rtol=1e-12)


@pytest.mark.parametrize(("default", "other"), [(b"", "other"), (b"1.5", "1.5")])
def test_text_is_the_text_that_the_file_converts_it_to(default: bytes, other: str) -> None:
    blocks = {"input_0_addr": b"low\0", "output_0_addr": b"0.5", "default_addr": default}
    conversion = SimpleNamespace(conversion_type=10, ref_param_nr=3, referenced_blocks=blocks)
    assert convert_texts(conversion, ["low", "other"]) == ["0.5", other]


def test_text_with_a_conversion_from_numbers_is_refused(tmp_path: Path) -> None:
    levels = {"text_0": "low", "val_0": 1.0, "text_1": "high", "val_1": 2.0, "default": 0.0}
    level = make_text("pos", ["low", "high"] * (ROWS // 2), conversion=levels)
    path = write(tmp_path / "a.mf4", [level, make_signal("force", FORCE, unit="N")])
    assert "'pos' holds text with an unknown conversion" in find_refusal(tmp_path, path, MAP)


@pytest.mark.parametrize("place", ["offset", "length"])
@pytest.mark.parametrize("number", [1 << 40, 0xFFFFFFF0])
def test_a_text_beyond_its_data_is_refused(tmp_path: Path, place: str, number: int) -> None:
    signals = [make_text("pos", NUMBERS, unit="m"), make_signal("force", FORCE, unit="N")]
    path = write(tmp_path / "a.mf4", signals)
    content = bytearray(path.read_bytes())
    if place == "offset":
        step = len(NUMBERS[-1]) + 4
        row = content.index(struct.pack("<dQ", TIME[7], 7 * step))
        struct.pack_into("<Q", content, row + 8, number)
    else:
        struct.pack_into("<I", content, content.index(b"##SD") + 24, number & 0xFFFFFFFF or 0xFFFFFF)
    path.write_bytes(content)
    assert "a text is beyond the end of its data" in find_refusal(tmp_path, path, MAP)


@pytest.mark.parametrize("compression", [0, 1, 2])
def test_texts_that_the_file_marks_as_invalid_are_no_value(tmp_path: Path, compression: int) -> None:
    invalid = np.zeros(ROWS, bool)
    invalid[[3, 4, ROWS - 2]] = True
    force = make_signal("force", FORCE, unit="N", invalidation_bits=~invalid)  # another bit of the same byte
    text = make_text("pos", NUMBERS, unit="m", invalidation_bits=invalid)
    path = write(tmp_path / "a.mf4", [force, text], compression=compression)
    columns = '[columns]\ntime_s = { from = "time" }\nposition_m = { from = "pos" }\n'
    assert "position_m is not a number in row 3, one of 3 such rows" in find_refusal(tmp_path, path, columns)
    run = import_by(tmp_path, path, f"[file]\nresample_hz = {1.0 / (TIME[1] - TIME[0])}\n{columns}")
    wanted = np.interp(TIME, TIME[~invalid], np.array(NUMBERS, float)[~invalid])
    np.testing.assert_allclose(run["position_m"], wanted, atol=1e-12)
