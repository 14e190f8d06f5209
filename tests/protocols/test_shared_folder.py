"""Folders of shared memory: one a process, gone with it, even when it is killed."""

import subprocess
import sys
from pathlib import Path

from protocols.realtime.shared_folder import SharedFolder

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
