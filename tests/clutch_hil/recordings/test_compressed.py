"""Compressed recordings: read as what they hold, or refused in a sentence; nothing is left in the folder of temporary files."""

import bz2
import gc
import gzip
import io
import lzma
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from clutch_hil.recordings import unpacking
from clutch_hil.recordings.format import open_recording
from protocols.errors import InputError
from tests.clutch_hil.recordings.text_files import (
    SPEED,
    TIME,
    TORQUE,
    assert_right,
    convert_run,
    find_refusal,
    make_table,
    read,
)

TABLE = make_table().encode()


pytestmark = pytest.mark.usefixtures("folder")  # conftest.py


def make_zip(members: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return file.getvalue()


def compress_zstd(content: bytes) -> bytes:
    return bytes(pa.Codec("zstd").compress(content, asbytes=True))


def make_parquet() -> bytes:
    file = io.BytesIO()
    pq.write_table(pa.table({"time": TIME, "torque": TORQUE, "speed": SPEED}), file)
    return file.getvalue()


def make_hdf5() -> bytes:
    file = io.BytesIO()
    with h5py.File(file, "w") as made:
        for name, values in {"time": TIME, "torque": TORQUE, "speed": SPEED}.items():
            made[name] = values
    return file.getvalue()


PACKED: dict[str, Callable[[bytes], bytes]] = {
    "gzip": gzip.compress,
    "bzip2": bz2.compress,
    "xz": lzma.compress,
    "zstd": compress_zstd,
    "ZIP": lambda content: make_zip({"a/log.csv": content, "__MACOSX/a/._log.csv": b"x"}),
}


@pytest.mark.parametrize("packing", PACKED)
@pytest.mark.parametrize("content", [TABLE, make_parquet(), make_hdf5()], ids=["text", "Parquet", "HDF5"])
def test_a_compressed_recording_is_read_as_what_it_holds(
    tmp_path: Path, folder: Path, packing: str, content: bytes
) -> None:
    run = read(tmp_path, PACKED[packing](content))
    assert_right(run)
    assert convert_run(run).startswith(f"unpacked by {packing}")
    assert run.metadata["import"]["from"] == "a recording.csv"
    gc.collect()
    assert not list(folder.iterdir())


@pytest.mark.parametrize("packing", ["gzip", "bzip2", "xz"])
def test_parts_that_follow_each_other_are_one_file(tmp_path: Path, packing: str) -> None:
    half = len(TABLE) // 2
    assert_right(read(tmp_path, PACKED[packing](TABLE[:half]) + PACKED[packing](TABLE[half:])))


def test_options_of_the_file_inside_are_known(tmp_path: Path) -> None:
    assert_right(read(tmp_path, gzip.compress(b"1,2,3\nfrom here\n" + TABLE), "skip_lines = 2"))
    assert "file.dbc is not an option of" in find_refusal(tmp_path, gzip.compress(TABLE), 'dbc = "a.dbc"')


def test_a_refusal_names_the_compressed_file_and_leaves_nothing(tmp_path: Path, folder: Path) -> None:
    words = TABLE.replace(b"0.0000,1.4112", b"") + b"0.6,word,3\n0.61,1,3\n"
    refusal = find_refusal(tmp_path, make_zip({"log.csv": words}))
    assert f"recording {tmp_path / 'a recording.csv'} (log.csv): column 'torque' holds 'word' in line" in refusal
    gc.collect()
    assert not list(folder.iterdir())


def test_a_file_of_several_is_named_in_the_map(tmp_path: Path) -> None:
    archive = make_zip({"log.csv": TABLE, "other.csv": b"a,b\n1,2\n"})
    assert (
        "is a ZIP archive of 2 files: log.csv, other.csv; allowed is one, or member = 'log.csv' in [file] of a map"
        in find_refusal(tmp_path, archive)
    )
    assert_right(read(tmp_path, archive, 'member = "log.csv"'))
    assert "has no member 'lag.csv'; did you mean log.csv or other.csv?" in find_refusal(
        tmp_path, archive, 'member = "lag.csv"'
    )
    assert "compressed by gzip, of one file" in find_refusal(tmp_path, gzip.compress(TABLE), 'member = "log.csv"')
    assert "file.member is not an option of" in find_refusal(tmp_path, TABLE, 'member = "log.csv"')


def encrypt(archive: bytes) -> bytes:
    """Set the bit that says that members are encrypted, before each and in the directory."""
    for mark, place in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        at = archive.index(mark) + place
        archive = archive[:at] + struct.pack("<H", 1) + archive[at + 2 :]
    return archive


def remove_names(archive: bytes) -> bytes:
    """Make the name of a single letter in the directory a field that nobody reads."""
    at = archive.index(b"PK\x01\x02") + 28
    return archive[:at] + struct.pack("<HH", 0, 1) + archive[at + 4 :]


@pytest.mark.parametrize(
    ("content", "refusal"),
    [
        (encrypt(make_zip({"log.csv": TABLE})), "log.csv is encrypted; unpack it with its password"),
        (
            make_zip({"log.csv": TABLE}, zipfile.ZIP_LZMA),
            "log.csv is packed by method 14 of ZIP; allowed are stored, deflate",
        ),
        (make_zip({"a/": b""}), "is a ZIP archive of 0 files; allowed is one"),
        (remove_names(make_zip({"a": TABLE})), "is a ZIP archive of 0 files; allowed is one"),
        (make_zip({"log.csv": TABLE})[:400], "cannot be unpacked by ZIP: File is not a zip file"),
        (gzip.compress(gzip.compress(TABLE)), "holds another compressed file; unpack it"),
        (make_zip({"log.csv.gz": gzip.compress(TABLE)}), "(log.csv.gz) holds another compressed file; unpack it"),
        (gzip.compress(TABLE)[:-300], "cannot be unpacked by gzip: Compressed file ended before"),
        (gzip.compress(TABLE)[:-8] + bytes(8), "cannot be unpacked by gzip: CRC check failed"),
        (bz2.compress(TABLE)[:-300], "cannot be unpacked by bzip2: Compressed file ended before"),
        (lzma.compress(TABLE)[:-300], "cannot be unpacked by xz: it is cut"),
        (compress_zstd(TABLE)[:-300], "cannot be unpacked by zstd: "),
        (gzip.compress(b""), "cannot be read: it is empty"),
        (gzip.compress(b"%PDF-1.7"), "as it is a document or a picture"),
    ],
)
def test_what_cannot_be_unpacked_is_refused(tmp_path: Path, folder: Path, content: bytes, refusal: str) -> None:
    message = find_refusal(tmp_path, content)
    assert refusal in message
    assert str(tmp_path / "a recording.csv") in message
    assert str(folder) not in message
    assert not list(folder.iterdir())


@pytest.mark.parametrize("packing", PACKED)
def test_a_file_that_grows_without_end_is_refused_at_the_bound(
    tmp_path: Path, folder: Path, packing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unpacking, "MOST_UNPACKED", 3 * unpacking._PIECE)
    path = tmp_path / "bomb"
    path.write_bytes(PACKED[packing](bytes(16 * unpacking._PIECE)))
    with pytest.raises(InputError, match=r"bomb has more than .* GiB when unpacked, which is the most that is allowed"):
        open_recording(path)
    assert not list(folder.iterdir())


def test_a_dictionary_of_xz_above_the_bound_is_not_allocated(tmp_path: Path) -> None:
    filters = [{"id": lzma.FILTER_LZMA2, "preset": 0, "dict_size": 1 << 29}]
    path = tmp_path / "large.xz"
    path.write_bytes(lzma.compress(TABLE, filters=filters))
    with pytest.raises(InputError, match="cannot be unpacked by xz: Memory usage limit exceeded"):
        open_recording(path)


def test_a_channel_of_a_compressed_file_can_be_read_again(tmp_path: Path) -> None:
    path = tmp_path / "log.csv.gz"
    path.write_bytes(gzip.compress(TABLE))
    recording = open_recording(path)
    for _ in range(2):
        (signal,) = recording.read([recording.channels[1]])
        np.testing.assert_array_equal(signal.values, TORQUE)


def test_a_database_beside_a_compressed_log_is_found(tmp_path: Path) -> None:
    (tmp_path / "car.dbc").write_text('VERSION ""\nBU_: E\nBO_ 256 ENG: 8 E\n SG_ n : 0|16@1+ (0.5,0) [0|0] "rpm" E\n')
    log = "".join(f"({100.0 + 0.01 * row:.6f}) can0 100#{row:02X}00000000000000\n" for row in range(50))
    (tmp_path / "drive.log.gz").write_bytes(gzip.compress(log.encode()))
    recording = open_recording(tmp_path / "drive.log.gz", {"dbc": "car.dbc"})
    (signal,) = recording.read([channel for channel in recording.channels if channel.path == "ENG.n"])
    np.testing.assert_array_equal(signal.values, 0.5 * np.arange(50))
