"""Damaged copies of a small file of each kind: read, or refused in one sentence; and most recordings get behind the opening."""

from pathlib import Path

import pytest

from benchmarks.mutations import Reach, play_copies
from benchmarks.sound_inputs import make_inputs
from benchmarks.sound_recordings import Sound, make_files
from protocols.errors import InputError
from tests.clutch_hil.recordings.test_hdf5_in_child import write_level73

COPIES = 60  # of each file, in all 25 s of computing; `python -m benchmarks.mutated_inputs` makes as many as are wanted
# Share of copies that must get behind the opening, or the damage says nothing of the readers; of 500 each had twice that.
# A changed byte fails the sum of a deflated variable; one JSON value, a database and a change are read whole or not at all
LEAST = {"MATLAB 5 deflated": 0.0, "JSON, columns": 0.0, "DBC": 0.0, "change of the plant": 0.0, "planned change": 0.0}
LEAST_INPUT = 0.02  # of the other inputs, which are read whole or not at all
INPUTS = (
    "parameters of the plant", "parameters of the controller", "limits of the guard", "scenario frozen_pressure_sensor",
    "scenario shift", "profile", "map of an import", "run", "journal", "batch of rows", "event", "request of another",
    "description of a node", "change of the plant", "change of the controller", "planned change", "frames",
)  # fmt: skip
NAMES = (
    "CSV", "text of a logger", "Parquet", "Feather", "JSON, objects", "JSON, columns", "MDF 4.10 deflated", "MDF 4.10",
    "MDF 3.30", "MATLAB 5 deflated", "MATLAB 5", "MATLAB 5, deflated after the damage", "MATLAB 4", "TDMS", "HDF5",
    "HDF5 in chunks", "MATLAB 7.3", "bus log, candump", "bus log, ASC", "bus log, TRC", "bus log, CSV of python-can",
    "bus log, SQLite of python-can", "bus log, BLF", "bus log, BLF deflated", "bus log, MF4", "DBC",
    "log of the bench",
)  # fmt: skip


@pytest.fixture(scope="module")
def sounds(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Sound]:
    folder = tmp_path_factory.mktemp("sound")
    return {sound.name: sound for sound in (*make_files(folder), *make_inputs(folder))}


def test_every_format_has_a_sound_file_that_is_read_whole(tmp_path: Path, sounds: dict[str, Sound]) -> None:
    assert tuple(sounds) == (*NAMES, *INPUTS)
    for sound in sounds.values():
        assert sound.play(copy_sound(sound, tmp_path)) is Reach.READ, sound.name


@pytest.mark.parametrize("name", [*NAMES, *INPUTS])
def test_damaged_copies_are_read_or_refused(
    tmp_path: Path, sounds: dict[str, Sound], name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    sound = sounds[name]
    copy = copy_sound(sound, tmp_path)
    good = copy.read_bytes()
    sound.play(copy)  # what is loaded once is not a copy's time or memory
    reached = play_copies(copy, good, COPIES, 1, sound.play, sound.damage)
    least = LEAST.get(name, LEAST_INPUT if name in INPUTS else 0.2)
    assert COPIES - reached[Reach.REFUSED] >= least * COPIES, reached
    assert capfd.readouterr() == ("", "")


def copy_sound(sound: Sound, folder: Path) -> Path:
    """A file like that of `sound`, which `play` may alter."""
    copy = folder / f"damaged{sound.file.suffix}"
    copy.write_bytes(sound.file.read_bytes())
    return copy


def test_a_copy_that_ends_the_library_is_one_sentence(tmp_path: Path) -> None:
    """As the HDF5 library does on some files: the process for many copies ends, and the next copy has another one."""
    from benchmarks.sound_recordings import _ManyByOne

    play = _ManyByOne(f"{__name__}:end_on_one")
    files = [write_level73(tmp_path / name) for name in ("a.mat", "ends.mat", "b.mat")]
    assert [play(file) for file in files] == [Reach.REFUSED] * 3


def end_on_one(path: Path) -> None:
    """In the other process."""
    import os

    if "ends" in path.name:
        os.abort()
    raise InputError(f"recording {path} is not liked")
