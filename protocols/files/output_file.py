"""Output files: they appear only when they are complete, and no other file is lost by them.

One rule for all commands: a file that exists is replaced only with --overwrite, and one that is read by the command never.
Until it is complete a file is called NAME.part. Its writer keeps that locked, so that no second one writes it meanwhile.
"""

import contextlib
import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

from protocols.errors import InputError
from protocols.input_file import check_name

_SUFFIX = ".part"
_HIDDEN = f".{'[a-z0-9_]' * 8}{_SUFFIX}"  # pattern of the folders that `tempfile` names
_UNLOCKED = 60.0  # s from making a folder to locking it, at most: a younger one is not judged
_found_free: set[Path] = set()  # checked by this process, which may not replace them: they must be free at the end, too


@contextlib.contextmanager
def without_new_folders(folder: Path) -> Iterator[None]:
    """After an exception, remove `folder` and those above it that are missing now, as far as they are empty."""
    missing = [
        one for one in (folder, *folder.parents) if not os.path.exists(one)
    ]  # no error for one above which nothing may be read
    try:
        yield
    except BaseException:
        for one in missing:
            with contextlib.suppress(OSError):  # something is in it
                one.rmdir()
        raise


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Path to write a file to. It gets the name `path` at the end, and is removed after an exception. Raises InputError."""
    try:
        with without_new_folders(path.parent):
            path.parent.mkdir(parents=True, exist_ok=True)
            with open_part(path):
                part = make_part_path(path)
                try:
                    yield part
                    put_in_place(part, path)
                except BaseException:
                    with contextlib.suppress(OSError):  # the folder itself may be missing
                        part.unlink(missing_ok=True)
                    raise
    except OSError as error:
        raise InputError(f"file {path} cannot be written: {error.strerror or error}") from None


@contextlib.contextmanager
def whole_files(folder: Path, mode: int = 0o777) -> Iterator[Path]:
    """Folder to write files to. At the end they are moved into `folder`, and after an exception all are removed.

    mode: rights of `folder` where it is made. Raises InputError.
    """
    try:
        with without_new_folders(folder):
            folder.mkdir(mode, parents=True, exist_ok=True)
            _remove_abandoned(folder)
            with tempfile.TemporaryDirectory(prefix=".", suffix=_SUFFIX, dir=folder) as name, _locked(Path(name)):
                try:
                    yield Path(name)
                except InputError as error:
                    raise InputError(str(error).replace(name, str(folder))) from None
                parts = {folder / part.name: part for part in sorted(Path(name).iterdir())}
                for path in parts:
                    _check_still_free(path)
                for path, part in parts.items():
                    put_in_place(part, path)
    except OSError as error:
        raise InputError(f"folder {folder} cannot be written: {error.strerror or error}") from None


def _remove_abandoned(folder: Path) -> None:
    """Remove hidden folders that `whole_files` has left in `folder` where it was killed: nobody keeps their lock."""
    for abandoned in folder.glob(_HIDDEN):
        with contextlib.suppress(OSError):  # another command's, or no folder
            if time.time() - abandoned.stat().st_mtime > _UNLOCKED:
                with _locked(abandoned) as free:
                    if free:
                        shutil.rmtree(abandoned)


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[bool]:
    """Keep a folder locked, or say that it cannot be: another command locks it, or the drive locks nothing."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            locked = True
        except OSError:
            locked = False
        yield locked
    finally:
        os.close(descriptor)


def open_part(path: Path) -> BinaryIO:
    """Open a new, empty file for what `path` is to contain; it is locked while it is open.

    It is made again where somebody removed it before it was locked. Raises InputError where another writer has it, OSError
    where it cannot be made.
    """
    check_can_be_file(path)
    part = make_part_path(path)
    while True:
        file = part.open("ab")  # what another writer has written stays; it is emptied below
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
            raise InputError(
                f"file {path} is being written by another command; wait for its end, or give another name"
            ) from None
        except OSError:  # some network drives lock nothing
            pass
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(part.stat(), os.fstat(file.fileno())):
                file.seek(0)
                file.truncate()
                return file
        file.close()


def put_in_place(part: Path, path: Path) -> None:
    """Give the complete file `part` the name `path`. Raises InputError where that has appeared since `check_new_file`."""
    _check_still_free(path)
    part.rename(path)
    _found_free.discard(path.absolute())


def check_new_file(path: Path, overwrite: bool = False, inputs: Iterable[Path] = ()) -> Path:
    """`path`, if a file can be created there and no other is lost by it. Raises InputError.

    overwrite: whether a file that exists may be replaced. inputs: files that are read; none of them is ever replaced. Where it
    may not be replaced, this holds until the file gets its name.
    """
    check_can_be_file(path)
    if not os.path.isdir(path.parent):
        raise InputError(f"folder {path.parent} of {path.name} does not exist")
    try:
        for target in (path, make_part_path(path)):
            if target.exists() and any(os.path.exists(source) and target.samefile(source) for source in inputs):
                raise InputError(
                    f"file {target} is read by this command and would be lost; give another name to write to"
                )
        if path.exists() and not path.is_file():
            raise InputError(f"file {path} cannot be written: it is {'a folder' if path.is_dir() else 'no file'}")
        if path.exists() and not overwrite:
            raise InputError(f"file {path} exists already; give another name, or --overwrite to replace it")
        trial = path.with_name(f"{path.name}.{os.getpid()}")  # a name of its own: others may be writing `path`
        trial.touch()  # tried, as root has every right but cannot write everywhere
        trial.unlink()
    except OSError as error:
        raise InputError(f"file {path} cannot be written: {error.strerror}") from None
    _note(path, overwrite)
    return path


def check_new_files(folder: Path, names: Iterable[str], overwrite: bool = False, inputs: Iterable[Path] = ()) -> None:
    """Check all files `names` in a `folder`, which may be missing, as `check_new_file` checks one. Raises InputError."""
    inputs, exists = tuple(inputs), os.path.isdir(folder)
    for name in names:
        if exists:
            check_new_file(folder / name, overwrite, inputs)
        else:
            _note(folder / name, overwrite)


def make_part_path(path: Path) -> Path:
    """Path of a file that gets the name `path` when it is complete."""
    return path.with_name(path.name + _SUFFIX)


def check_can_be_file(path: Path) -> None:
    """Raise InputError for a path that names a folder, such as . and /, whatever the rights of the user."""
    check_name(path, "file")
    if not path.name:  # . and /, beside which there is no NAME.part
        raise InputError(f"file {path} cannot be written: it is a folder")


def _note(path: Path, overwrite: bool) -> None:
    """Keep in mind whether the file `path`, which is free, may be replaced."""
    (_found_free.discard if overwrite else _found_free.add)(path.absolute())


def _check_still_free(path: Path) -> None:
    if path.absolute() in _found_free and path.exists():
        raise InputError(
            f"file {path} was written by another command meanwhile; give another name, or --overwrite to replace it"
        )
