"""What is no MATLAB file, or a damaged one: one sentence, in bounded time and memory."""

import random
import struct
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import matio
import numpy as np
import pytest
from scipy.io import savemat

from clutch_hil.recordings.format import open_recording
from clutch_hil.recordings.matlab.level4 import is_level4
from clutch_hil.recordings.matlab.level5 import is_level5
from protocols.errors import InputError
from tests.clutch_hil.recordings.matlab_files import (
    MOST_MEMORY,
    MOST_SECONDS,
    F,
    Q,
    T,
    make_array,
    make_controldesk,
    make_element,
    make_level5,
    make_objects,
    measure_peak,
    read_values,
    write,
)


@pytest.mark.parametrize(
    "head",
    [
        b"time,torque\n0,1\n", b"\x00" * 200, b"MDF     4.10    ", b"TDSm" + bytes(100), b"PAR1" + bytes(60),
        b"LOGG" + bytes(140), b"(1.0) can0 100#00\n", b"t\tx\n0\t1\n", b"\xff\xfet\x00,\x00x\x00",
        struct.pack("<5i", 0, 3, 1, 0, 2) + b"\x01\x00",
        struct.pack("<5i", 2000, 3, 1, 0, 2) + b"a\x00", struct.pack("<5i", 0, -3, 1, 0, 2) + b"a\x00",
    ],
)  # fmt: skip
def test_a_file_of_another_format_is_not_taken_for_level_4(head: bytes) -> None:
    assert not is_level4(head)
    assert not is_level5(head)


def make_nested_cells(depth: int) -> bytes:
    inside = make_array(6, (1, 1), b"", make_element(9, struct.pack("<d", 1.0)))
    heads, size = [], len(inside)
    for level in range(depth):
        name = make_element(1, b"a" if level == depth - 1 else b"")
        head = make_element(6, struct.pack("<II", 1, 0)) + make_element(5, struct.pack("<ii", 1, 1)) + name
        size += len(head)
        heads.append(struct.pack("<II", 14, size) + head)
        size += 8
    return b"".join(reversed(heads)) + inside


def make_bomb() -> bytes:
    """A file of 3 MB that inflates to 3 GiB: a cell of an array of zeros, and of one behind it."""
    rows, columns, step = 1 << 16, 3 << 14, 1 << 24
    size = rows * columns
    flags = (
        make_element(6, struct.pack("<II", 9, 0))
        + make_element(5, struct.pack("<ii", rows, columns))
        + make_element(1, b"")
    )
    zeros = struct.pack("<II", 14, len(flags) + 8 + size) + flags + struct.pack("<II", 2, size)
    behind = make_array(6, (1, 1), b"", make_element(9, struct.pack("<d", 1.0)))
    cell = make_element(6, struct.pack("<II", 1, 0)) + make_element(5, struct.pack("<ii", 1, 2)) + make_element(1, b"c")
    packer = zlib.compressobj(9)
    packed = packer.compress(struct.pack("<II", 14, len(cell) + len(zeros) + size + len(behind)) + cell + zeros)
    packed += packer.flush(zlib.Z_FULL_FLUSH)
    block = packer.compress(bytes(step)) + packer.flush(zlib.Z_FULL_FLUSH)
    packed += block * (size // step) + packer.compress(behind) + packer.flush()
    return make_level5(struct.pack("<II", 15, len(packed)) + packed)


DAMAGED: dict[str, Callable[[], bytes]] = {
    "head only": lambda: make_level5(),
    "cut in a tag": lambda: make_level5(b"\x0e\x00\x00\x00"),
    "cut in an array": lambda: make_level5(make_array(6, (1, 60), b"t", make_element(9, T.tobytes()))[:-40]),
    "more numbers than bytes": lambda: make_level5(make_array(6, (50000, 50000), b"t", make_element(9, T.tobytes()))),
    "negative shape": lambda: make_level5(make_array(6, (-1, 60), b"t", make_element(9, T.tobytes()))),
    "2^62 cells": lambda: make_level5(make_array(1, (2**31 - 1, 2**31 - 1), b"c", b"")),
    "2^31 structures without fields": lambda: make_level5(
        make_array(2, (2**31 - 1, 1), b"s", make_element(5, b"\1\0\0\0") + make_element(1, b""))
    ),
    "unknown class": lambda: make_level5(make_array(99, (1, 1), b"x", b"")),
    "cells in cells 100000 deep": lambda: make_level5(make_nested_cells(100_000)),
    "many cells": lambda: make_level5(make_array(1, (500_000, 1), b"c", struct.pack("<II", 14, 0) * 500_000)),
    "level 4 with huge shape": lambda: struct.pack("<5i", 0, 2**31 - 1, 2**31 - 1, 0, 2) + b"a\x00",
    "neither of the two byte orders": lambda: make_level5(
        make_array(6, (1, 60), b"t", make_element(9, T.tobytes()))
    ).replace(b"IM", b"IN", 1),
    "7.3 cut after its first bytes": lambda: b"MATLAB 7.3 MAT-file".ljust(600),
}  # fmt: skip


@pytest.mark.parametrize("kind", DAMAGED)
def test_a_damaged_file_is_refused_in_one_sentence(tmp_path: Path, kind: str) -> None:
    file = tmp_path / "recording.mat"
    file.write_bytes(DAMAGED[kind]())
    begin, before = time.monotonic(), measure_peak()
    with pytest.raises(InputError, match=str(file)) as refused:
        open_recording(file)
    assert "\n" not in str(refused.value)
    assert time.monotonic() - begin < MOST_SECONDS
    assert measure_peak() - before < MOST_MEMORY


def test_a_zip_bomb_takes_neither_memory_nor_time(tmp_path: Path) -> None:
    file = tmp_path / "recording.mat"
    file.write_bytes(make_bomb())
    before, begin = measure_peak(), time.process_time()
    with pytest.raises(InputError, match="inflates to more than 1 GiB; save fewer variables in one file"):
        open_recording(file)
    assert time.process_time() - begin < MOST_SECONDS
    assert measure_peak() - before < MOST_MEMORY


def test_a_changed_byte_in_a_deflated_array_is_told(tmp_path: Path) -> None:
    file = write(tmp_path, {"t": np.random.default_rng(1).normal(size=5000)}, do_compression=True)
    raw = bytearray(file.read_bytes())
    raw[len(raw) // 2] ^= 1
    file.write_bytes(raw)
    with pytest.raises(InputError, match="damaged"):
        read_values(open_recording(file), "t")


SEEDS: dict[str, Callable[[Path], None]] = {
    "vectors": lambda file: savemat(file, {"t": T, "y": np.column_stack([Q, F]), "k": 2.0, "s": {"a": Q, "n": "x"}}),
    "deflated": lambda file: savemat(file, {"t": T, "s": {"a": {"b": Q}}, "c": np.array([T, "x"], object)}, do_compression=1),
    "level 4": lambda file: savemat(file, {"t": T, "y": np.column_stack([Q, F]), "n": "text"}, format="4"),
    "controldesk": lambda file: savemat(file, make_controldesk()),
    "objects": lambda file: matio.save_to_mat(file, make_objects(), version="v7", do_compression=False),
}  # fmt: skip


@pytest.mark.parametrize("seed", SEEDS)
def test_mutated_files_are_read_or_refused_in_one_sentence(tmp_path: Path, seed: str) -> None:
    original = tmp_path / "seed.mat"
    SEEDS[seed](original)
    raw, chance, before = original.read_bytes(), random.Random(seed), measure_peak()
    sentences: list[str] = []
    for number in range(60):
        file = tmp_path / f"{number}.mat"
        file.write_bytes(mutate_bytes(raw, chance))
        begin = time.monotonic()
        try:
            recording = open_recording(file)
            recording.read(recording.channels)
        except InputError as refused:
            sentences.append(str(refused))
        assert time.monotonic() - begin < MOST_SECONDS
    assert measure_peak() - before < MOST_MEMORY
    assert sentences
    assert not any("\n" in sentence for sentence in sentences)


def mutate_bytes(raw: bytes, chance: random.Random) -> bytes:
    """A file with a few changes: cut, bytes changed, numbers made huge, a piece lost or doubled."""
    data = bytearray(raw)
    kind, at = chance.randrange(5), chance.randrange(len(raw))
    piece = slice(at, at + chance.randrange(1, 200))
    if kind == 0:
        return bytes(data[:at])
    if kind == 1:
        for _ in range(10):
            data[chance.randrange(len(data))] = chance.randrange(256)
    elif kind == 2:
        at &= ~3
        data[at : at + 4] = chance.choice([b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", bytes(4), b"\x00\x00\x00\x40"])
    elif kind == 3:
        del data[piece]
    else:
        data[at:at] = data[piece]
    return bytes(data)
