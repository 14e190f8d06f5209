"""Output files: they appear only when complete, and never replace another file unintentionally.

One rule for all commands: an existing file is replaced only with --overwrite; a file that the command reads is never replaced.
An incomplete file is called NAME.part. Its writer keeps it locked, so that no second writer uses it.
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
_UNLOCKED = 60.0  # s, longest time from creating a folder to locking it: younger folders are not removed
# Paths that did not exist when checked and must not be replaced: they must still be free at the end
_found_free: set[Path] = set()


@contextlib.contextmanager
def without_new_folders(folder: Path) -> Iterator[None]:
    """After an exception, remove `folder` and its parents if they are empty and were missing before."""
    missing = [
        one for one in (folder, *folder.parents) if not os.path.exists(one)
    ]  # no error for a folder whose parent cannot be read
    try:
        yield
    except BaseException:
        for one in missing:
            with contextlib.suppress(OSError):  # the folder is not empty
                one.rmdir()
        raise


def make_folder(folder: Path) -> None:
    """Create `folder` and its parents if they are missing. Raises InputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        kind = f"a link to {os.readlink(folder)}, which does not exist," if folder.is_symlink() else "a file"
        raise InputError(f"folder {folder} cannot be made: {kind} has this name") from None
    except OSError as error:
        raise InputError(f"folder {folder} cannot be made: {error.strerror or error}") from None


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a path to write a file to. It is renamed to `path` at the end, removed after an exception.

    Raises InputError.
    """
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
    """Yield a folder to write files to. At the end they are moved into `folder`; after an exception all are removed.

    mode: access rights of `folder` if it is created. Raises InputError.
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
    """Remove hidden folders of killed `whole_files` calls in `folder`: their lock is free."""
    for abandoned in folder.glob(_HIDDEN):
        with contextlib.suppress(OSError):  # of another command, or not a folder
            if time.time() - abandoned.stat().st_mtime > _UNLOCKED:
                with _locked(abandoned) as free:
                    if free:
                        shutil.rmtree(abandoned)


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[bool]:
    """Lock a folder. Yield False if another command locks it, or the drive does not support locks."""
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
    """Open a new, empty, locked file for the later content of `path`.

    It is created again if it was removed before it was locked. Raises InputError if another writer has it, OSError if it cannot
    be created.
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
    """Rename the complete file `part` to `path`. Raises InputError if `path` was created after `check_new_file`."""
    _check_still_free(path)
    part.rename(path)
    _found_free.discard(path.absolute())


def check_new_file(path: Path, overwrite: bool = False, inputs: Iterable[Path] = ()) -> Path:
    """Return `path`, if a file can be created there without losing another one. Raises InputError.

    overwrite: whether an existing file may be replaced. inputs: files that are read; none of them is ever replaced. Without
    `overwrite`, the path is checked again before the file gets its name.
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
        trial = path.with_name(f"{path.name}.{os.getpid()}")  # a unique name: other processes may be writing `path`
        trial.touch()  # tested by writing, as root has every right but cannot write everywhere
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
    """Return the path of the incomplete file for `path`."""
    return path.with_name(path.name + _SUFFIX)


def check_can_be_file(path: Path) -> None:
    """Raise InputError for a path that denotes a folder, such as . and /, whatever the user's rights."""
    check_name(path, "file")
    if not path.name:  # . and /, for which there is no NAME.part
        raise InputError(f"file {path} cannot be written: it is a folder")


def _note(path: Path, overwrite: bool) -> None:
    """Remember whether the file `path`, which does not exist, may be replaced later."""
    (_found_free.discard if overwrite else _found_free.add)(path.absolute())


def _check_still_free(path: Path) -> None:
    if path.absolute() in _found_free and path.exists():
        raise InputError(
            f"file {path} was written by another command meanwhile; give another name, or --overwrite to replace it"
        )
