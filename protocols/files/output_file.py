"""Output files: they appear only when they are complete, and no other file is lost by them.

One rule for all commands: a file that exists is replaced only with --overwrite, and one that is read by the command never.
"""

import contextlib
from collections.abc import Iterable, Iterator
from pathlib import Path

from protocols.errors import InputError


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Path to write a file to. It gets the name `path` at the end, and is removed after an exception. Raises InputError."""
    part = make_part_path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        part.rename(path)
    except OSError as error:
        raise InputError(f"file {path} cannot be written: {error.strerror or error}") from None
    finally:
        with contextlib.suppress(OSError):  # the folder itself may be missing
            part.unlink(missing_ok=True)


def check_new_file(path: Path, overwrite: bool = False, inputs: Iterable[Path] = ()) -> Path:
    """`path`, if a file can be created there and no other is lost by it. Raises InputError.

    overwrite: whether a file that exists may be replaced. inputs: files that are read; none of them is ever replaced.
    """
    if not path.parent.is_dir():
        raise InputError(f"folder {path.parent} of {path.name} does not exist")
    try:
        for target in (path, make_part_path(path)):
            if target.exists() and any(source.exists() and target.samefile(source) for source in inputs):
                raise InputError(
                    f"file {target} is read by this command and would be lost; give another name to write to"
                )
        if path.exists() and not path.is_file():
            raise InputError(f"file {path} cannot be written: it is {'a folder' if path.is_dir() else 'no file'}")
        if path.exists() and not overwrite:
            raise InputError(f"file {path} exists already; give another name, or --overwrite to replace it")
        for target in (path, make_part_path(path)):
            with contextlib.suppress(FileExistsError):
                target.touch(exist_ok=False)  # tried, as root has every right but cannot write everywhere
                target.unlink()
    except OSError as error:
        raise InputError(f"file {path} cannot be written: {error.strerror}") from None
    return path


def check_new_files(folder: Path, names: Iterable[str], overwrite: bool = False, inputs: Iterable[Path] = ()) -> None:
    """Check all files `names` in a `folder`, which may be missing, as `check_new_file` checks one. Raises InputError."""
    if folder.is_dir():
        inputs = tuple(inputs)
        for name in names:
            check_new_file(folder / name, overwrite, inputs)


def make_part_path(path: Path) -> Path:
    """Path of a file that gets the name `path` when it is complete."""
    return path.with_name(path.name + ".part")
