"""Installation of the units of a bench: record which files were written, and remove only these again.

The record is in /etc, which only root can write, because root removes what it lists.
"""

import contextlib
import hashlib
import json
import os
import shutil
import stat
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from clutch_hil.bench.host.unit_files import TARGET, UNITS, USER, name_unit
from protocols.errors import InputError

NOTE = Path("etc/clutch-hil/installed.json")
RECORDINGS, KERNELS = Path("var/lib/clutch-hil"), Path("var/cache/clutch-hil")
_FORMAT = 1  # version of the record
_TIMEOUT = 120.0  # s for a system command; stopping a unit may take 30 s
_MODE = 0o644
_NETWORKD = "systemd-networkd.service"
_LATENCY = Path("/dev/cpu_dma_latency")  # a udev rule changes its group and mode; they stay changed without the rule


class Removal(NamedTuple):
    """What an uninstall has removed, and what it has left, with the reason."""

    removed: list[Path]
    left: dict[Path, str]


class Installation:
    """Files of the units below the folder `root`; if root is /, the services of this machine are updated as well."""

    def __init__(self, root: Path) -> None:
        if not root.is_dir():
            raise InputError(f"folder {root} does not exist; it must be the root folder for the installed files")
        self.root = root.resolve()
        self._live = self.root == Path("/")

    @property
    def exists(self) -> bool:
        """Return whether units are installed here, or files of an earlier install were left."""
        return (self.root / NOTE).is_file()

    def install(
        self, files: Mapping[Path, str], links: Mapping[Path, str], bus: str, start: bool, overwrite: bool = False
    ) -> list[Path]:
        """Write `files` and `links`, by their paths below the root; return the paths. Files of an earlier install are replaced.

        bus: created by the files of networkd, and removed with them unless it existed before. start: start the units now.
        overwrite: also replace files that others have written or changed. Raises InputError.
        """
        before = self._read_note() if self.exists else None
        known: dict[str, str] = before["files"] if before else {}
        for path in (*files, *links):
            self._check_place(path, known, before["links"] if before else {}, overwrite)
        note = {
            "format": _FORMAT,
            "files": {str(path): _hash(text.encode()) for path, text in files.items()},
            "links": {str(path): target for path, target in links.items()},
            "folders": before["folders"] if before else [],
            "machine": before["machine"] if before else self._read_machine(bus),
        }
        try:
            self._write_note(note)
            for path, text in files.items():
                self._make_folders(path.parent, note["folders"])
                _write(self.root / path, text)
            for path, target in links.items():
                self._make_folders(path.parent, note["folders"])
                (self.root / path).unlink(missing_ok=True)
                (self.root / path).symlink_to(target)
            self._write_note(note)  # creates the folders
        except OSError as error:
            raise InputError(_explain(error)) from None
        if before:  # files of the earlier install that this one does not have
            self._remove_files({k: v for k, v in known.items() if k not in note["files"]}, purge=False)
            self._remove_links({k: v for k, v in before["links"].items() if k not in note["links"]})
        if self._live:
            self._take_effect(start)
        return [*files, *links]

    def uninstall(self, purge: bool = False) -> Removal:
        """Stop the units and remove the files of `install`. purge: also remove recordings, and files changed since then.

        The record stays while something is left, so that it can be purged later. Raises InputError.
        """
        if not self.exists:
            raise InputError(f"no units of clutch-hil are installed below {self.root}")
        note = self._read_note()
        if self._live:
            _run("systemctl", "stop", TARGET, *map(name_unit, UNITS))
        try:
            removed, left = self._remove_files(note["files"], purge)
            removed += self._remove_links(note["links"])
            if self._remove_folder(KERNELS):
                removed.append(KERNELS)
            if purge or not _has_files(self.root / RECORDINGS):
                removed += [RECORDINGS] if self._remove_folder(RECORDINGS) else []
            else:
                left[RECORDINGS] = f"it contains recordings of the user {USER}"
            if left:  # a later purge finds it
                remaining = {name: digest for name, digest in note["files"].items() if Path(name) in left}
                self._write_note({**note, "files": remaining, "links": {}})
            else:
                (self.root / NOTE).unlink()
                removed.append(NOTE)
            for folder in sorted(note["folders"], key=len, reverse=True):
                with contextlib.suppress(OSError):  # the folder has other files
                    (self.root / folder).rmdir()
        except OSError as error:
            raise InputError(_explain(error)) from None
        if self._live:
            self._undo(note["machine"], keep_user=RECORDINGS in left)
        return Removal(removed, left)

    def list_changes(self) -> dict[Path, str]:
        """Return the files that differ from their installed state, with what happened to them. Raises InputError."""
        changes = {}
        for name, digest in self._read_note()["files"].items():
            path = self.root / name
            if not path.is_file():
                changes[Path(name)] = "missing"
            elif _hash(path.read_bytes()) != digest:
                changes[Path(name)] = "changed"
        return changes

    def _check_place(self, path: Path, files: Mapping[str, str], links: Mapping[str, str], overwrite: bool) -> None:
        there = self.root / path
        if there.is_dir() and not there.is_symlink():
            raise InputError(f"{there} is a folder, but a file of that name must be installed")
        if overwrite or not (there.exists() or there.is_symlink()) or str(path) in links:
            return
        if str(path) not in files:
            raise InputError(f"file {there} exists, but clutch-hil has not written it; --overwrite replaces it")
        if _hash(there.read_bytes()) != files[str(path)]:
            raise InputError(f"file {there} was changed since it was installed; --overwrite replaces it")

    def _make_folders(self, folder: Path, made: list[str]) -> None:
        for path in reversed((folder, *folder.parents)):
            if not (self.root / path).is_dir():
                (self.root / path).mkdir()
                made.append(str(path))

    def _remove_files(self, files: Mapping[str, str], purge: bool) -> tuple[list[Path], dict[Path, str]]:
        removed, left = [], {}
        for name, digest in files.items():
            path = self.root / name
            if not path.is_file():
                continue
            if not purge and _hash(path.read_bytes()) != digest:
                left[Path(name)] = "it was changed since it was installed"
                continue
            path.unlink()
            removed.append(Path(name))
        return removed, left

    def _remove_links(self, links: Mapping[str, str]) -> list[Path]:
        removed = []
        for name, target in links.items():
            path = self.root / name
            if path.is_symlink() and os.readlink(path) == target:
                path.unlink()
                removed.append(Path(name))
        return removed

    def _remove_folder(self, folder: Path) -> bool:
        path = self.root / folder
        if not path.is_dir() or path.is_symlink():
            return False
        shutil.rmtree(path)
        return True

    def _read_note(self) -> dict[str, Any]:
        path = self.root / NOTE
        try:
            note: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            names = [*note["files"], *note["links"], *note["folders"]]
            if note["format"] != _FORMAT or any(Path(name).is_absolute() or ".." in Path(name).parts for name in names):
                raise ValueError
        except OSError as error:
            raise InputError(f"{path} cannot be read: {error.strerror}") from None
        except (ValueError, KeyError, TypeError):
            raise InputError(f"{path} is not a list of installed files of this version") from None
        return note

    def _write_note(self, note: Mapping[str, Any]) -> None:
        self._make_folders(NOTE.parent, note["folders"])
        _write(self.root / NOTE, json.dumps(note, indent=1) + "\n")

    def _read_machine(self, bus: str) -> dict[str, Any]:
        """Return the state before the first install, which the last uninstall restores."""
        if self._live:
            user, group = (bool(_ask("getent", database, USER)) for database in ("passwd", "group"))
            bus_there = Path(f"/sys/class/net/{bus}").exists()
            networkd = _ask("systemctl", "is-active", _NETWORKD) == "active"
        else:  # of a machine that has not started yet
            user, group = (_has_line(self.root / "etc" / file, f"{USER}:") for file in ("passwd", "group"))
            bus_there = False
            networkd = (self.root / "etc/systemd/system/multi-user.target.wants" / _NETWORKD).is_symlink()
        rights = _read_rights(_LATENCY) if self._live else None
        return {
            "user": user, "group": group, "networkd": networkd, "bus": bus, "bus_there": bus_there, "latency_rights": rights,
        }  # fmt: skip

    def _take_effect(self, start: bool) -> None:
        _run("systemd-sysusers", "/etc/sysusers.d/clutch-hil.conf", needed=True)
        _run("systemctl", "daemon-reload", needed=True)
        _run("udevadm", "control", "--reload")
        _run("udevadm", "trigger", "--action=change", "--sysname-match=cpu_dma_latency")
        if start:
            _run("systemctl", "reload-or-restart", _NETWORKD)
            _run("systemctl", "start", "--no-block", TARGET, needed=True)

    def _undo(self, machine: Mapping[str, Any], keep_user: bool) -> None:
        bus = str(machine.get("bus", ""))
        _run("systemctl", "reset-failed", "clutch-hil*")
        _run("udevadm", "control", "--reload")
        if bus.startswith("vcan") and not machine.get("bus_there", True):
            _run("ip", "link", "delete", bus)
        elif bus:  # its rules no longer start the bench
            _run("udevadm", "trigger", "--action=change", f"--sysname-match={bus}")
        _run("udevadm", "settle")
        _run("systemctl", "daemon-reload")
        if not machine.get("networkd", True) and _ask("systemctl", "is-enabled", _NETWORKD) != "enabled":
            _run("systemctl", "stop", _NETWORKD, "systemd-networkd.socket")
        if rights := machine.get("latency_rights"):
            _restore_rights(_LATENCY, rights)
        if not machine.get("user", True) and not keep_user:
            _run("userdel", USER)
            if not machine.get("group", True):  # userdel keeps a group that has other members
                _run("groupdel", USER)


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _write(path: Path, text: str) -> None:
    """Write a file completely. Raises OSError with its path, which the error of a full disk lacks."""
    part = path.with_name(path.name + ".part")
    try:
        part.write_text(text, encoding="utf-8")
        part.chmod(_MODE)
        part.rename(path)
    except OSError as error:
        with contextlib.suppress(OSError):  # the record does not list it
            part.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror, str(path)) from None


def _has_files(folder: Path) -> bool:
    return any(path.is_file() for path in folder.rglob("*"))


def _read_rights(path: Path) -> list[int] | None:
    """Return owner, group and mode of a file; None where it does not exist."""
    with contextlib.suppress(OSError):
        status = path.stat()
        return [status.st_uid, status.st_gid, stat.S_IMODE(status.st_mode)]
    return None


def _restore_rights(path: Path, rights: Sequence[int]) -> None:
    owner, group, mode = rights
    with contextlib.suppress(OSError):  # the file no longer exists
        os.chown(path, owner, group)
        path.chmod(mode)


def _has_line(path: Path, start: str) -> bool:
    return path.is_file() and any(line.startswith(start) for line in path.read_text(errors="replace").splitlines())


def _ask(*command: str) -> str:
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        done = subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT, check=False)
        return done.stdout.strip()
    return ""


def _run(*command: str, needed: bool = False) -> None:
    """Run a system command; where it is `needed` and fails, raise InputError with its reason."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT, check=False)
        lines = done.stderr.strip().splitlines() if done.returncode else []
        reason = (lines or [f"exit code {done.returncode}"])[-1] if done.returncode else ""
    except FileNotFoundError:
        reason = f"{command[0]} is not installed"
    except subprocess.TimeoutExpired:
        reason = f"no answer within {_TIMEOUT:g} s"
    if needed and reason:
        raise InputError(
            f"{' '.join(command)} failed: {reason}; the files are installed, `service uninstall` removes them"
        )


def _explain(error: OSError) -> str:
    need = "; it needs root: sudo" if isinstance(error, PermissionError) else ""
    return f"{error.filename} cannot be changed: {error.strerror}{need}"


def format_paths(paths: Iterable[Path], root: Path) -> list[str]:
    """Return one line for each path, below `root`."""
    return [f"  {root / path}" for path in paths]


def describe_left(left: Mapping[Path, str], root: Path) -> Sequence[str]:
    """Return one line for each path that was left, with its reason."""
    return [f"  {root / path}: {reason}" for path, reason in left.items()]
