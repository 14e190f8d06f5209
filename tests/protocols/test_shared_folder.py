"""Folders of shared memory: one a process, gone with it, even when it is killed."""

import subprocess
import sys
from pathlib import Path

import pytest

from clutch_hil.command import write_summary
from protocols.errors import InputError
from protocols.realtime.shared_folder import SharedFolder, list_dead_folders, remove_dead_folders

HOLD = (
    "from protocols.realtime.shared_folder import SharedFolder; f = SharedFolder(); print(f.path, flush=True); input()"
)


def test_a_folder_is_removed_with_what_is_in_it() -> None:
    folder = SharedFolder()
    (folder.path / "ring").write_bytes(bytes(10))
    folder.remove()
    assert not folder.path.exists()


def test_folders_of_the_living_stay_and_those_of_the_dead_go() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HOLD], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        path = Path(other.stdout.readline().strip())
        SharedFolder().remove()
        assert path.exists()
        other.kill()
        other.wait()
        assert path.exists()
        SharedFolder().remove()
        assert not path.exists()


def test_a_folder_without_an_owner_goes() -> None:
    """Its owner was killed before it locked it, or another process wrote into it while it was removed."""
    folder = SharedFolder()
    (folder.path / "owner").unlink()
    (folder.path / "plant.json").write_text("{}")
    assert folder.path in list_dead_folders()
    remove_dead_folders()
    assert not folder.path.exists()


def test_a_service_whose_bench_was_killed_does_not_make_its_folder_again() -> None:
    folder = SharedFolder()
    folder.remove()
    with pytest.raises(InputError, match="its folder does not exist"):
        write_summary(folder.path / "plant.json", {})
    assert not folder.path.exists()
