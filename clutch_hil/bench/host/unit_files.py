"""Unit files: make the files with which systemd, networkd and udev run a bench, from the templates in deploy/systemd."""

import os
import re
import stat
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from protocols.errors import InputError, join_names
from protocols.realtime.rights import check_cpu

UNITS = ("plant", "controller", "recorder", "view")
TARGET = "clutch-hil.target"
USER = "clutch-hil"
_TREE = Path(__file__).parents[3]  # root of the source tree; an installed wheel has no deploy/
_SYSTEM = Path("etc/systemd/system")
_NETWORK = Path("etc/systemd/network")
_REAL_TIME = ("plant", "controller")
_INTERFACE = re.compile(
    r"[A-Za-z][A-Za-z0-9_]{0,14}"
)  # the kernel accepts 15 characters; these need no escapes in a unit's name
_SPECIAL = re.compile(r"[\s%$\"'\\:]")  # special characters of systemd, in commands and paths
_PLAIN = "paths without spaces, quotes, :, % and $"
_HIDDEN = tuple(map(Path, ("/home", "/root", "/run/user")))  # hidden by ProtectHome=
_TEMPORARY = tuple(map(Path, ("/tmp", "/var/tmp", "/dev/shm")))
_BITRATES = (10_000, 1_000_000)  # bit/s, range of classic CAN
_READABLE = stat.S_IROTH | stat.S_IXOTH
# Place in bench.conf -> environment variable with paths, which every process of a bench needs. They are repeated here because
# the module that declares them loads the compiler, which takes long; a test compares
PATH_VARIABLES = {"DATABASE": "CLUTCH_HIL_DATABASE", "LIMITS": "CLUTCH_HIL_LIMITS", "EFFECTS": "CLUTCH_HIL_EFFECTS"}


class BenchSettings(NamedTuple):
    """What to install. rate [Hz]; cpu: number of the CPU for the loops, None for any; bitrate [bit/s] of a real card.

    started: names of UNITS that start with the machine. paths: values of PATH_VARIABLES, by their places.
    """

    bus: str = "vcan0"
    rate: int = 1000
    cpu: int | None = None
    bitrate: int = 1_000_000
    started: Sequence[str] = ("plant", "controller", "view")
    paths: Mapping[str, str] = MappingProxyType({})

    @property
    def is_virtual(self) -> bool:
        """Return whether the bus is a virtual one of this machine, which is created too."""
        return self.bus.startswith("vcan")


class Program(NamedTuple):
    """The program that the units run: its interpreter, and the folders that it consists of."""

    python: Path
    tree: Path
    folders: tuple[Path, ...]


def find_program() -> Program:
    """Return the running program. Raises InputError where units could not run it."""
    folders = tuple(sorted({Path(sys.prefix), Path(sys.base_prefix), _TREE}))
    outer = tuple(one for one in folders if not any(one != other and one.is_relative_to(other) for other in folders))
    return check_program(Program(Path(sys.executable), _TREE, outer))


def check_program(program: Program) -> Program:
    """Return `program` if units can run it. Raises InputError."""
    if not (program.tree / "deploy/systemd").is_dir():
        raise InputError(f"{program.tree} has no deploy/systemd: install units from a clone of the repository")
    for path in (program.python, *program.folders):
        if _SPECIAL.search(str(path)):
            raise InputError(f"path {str(path)!r} cannot be in a unit; allowed are {_PLAIN}")
        if any(path.is_relative_to(folder) for folder in _TEMPORARY):
            raise InputError(
                f"{path} is in a temporary folder, which units cannot see; set up the project elsewhere, such as in /opt"
            )
        if path.stat().st_mode & _READABLE != _READABLE:
            raise InputError(f"{path} cannot be read by the user {USER} of the units: chmod -R o+rX {path}")
    return program


def check_settings(settings: BenchSettings) -> BenchSettings:
    """Return `settings` if they are valid for a bench. Raises InputError."""
    bus = settings.bus
    if not _INTERFACE.fullmatch(bus):
        raise InputError(f"bus {bus!r} is not a CAN interface for units; allowed are names such as vcan0 and can0")
    check_cpu(settings.cpu)
    low, high = _BITRATES
    if not low <= settings.bitrate <= high:
        raise InputError(f"bit rate {settings.bitrate} bit/s is not possible; allowed are {low} to {high} bit/s")
    unknown = [name for name in settings.started if name not in UNITS]
    if unknown:
        raise InputError(f"unit {unknown[0]!r} is unknown; allowed are {join_names(UNITS)}")
    return settings


def read_paths(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the values of PATH_VARIABLES, as absolute paths. Raises InputError for a path that units cannot read."""
    path_by_name = {}
    for place, variable in PATH_VARIABLES.items():
        paths = [Path(part).resolve() for part in environment.get(variable, "").split(os.pathsep) if part]
        for path in paths:
            _check_visible(path, f"{path} of {variable}")
        path_by_name[place] = os.pathsep.join(map(str, paths))
    return path_by_name


def _check_visible(path: Path, what: str) -> None:
    """Raise InputError where the user of the units cannot read `path`."""
    if _SPECIAL.search(str(path)):
        raise InputError(f"{what} cannot be in bench.conf; allowed are {_PLAIN}")
    if hidden := next((one for one in (*_HIDDEN, *_TEMPORARY) if path.is_relative_to(one)), None):
        raise InputError(f"{what} is below {hidden}, which units cannot see; move it, such as into /etc/clutch-hil")
    if not os.path.exists(path):
        raise InputError(f"{what} does not exist")
    for one in (path, *path.parents):
        needed = _READABLE if one == path and path.is_dir() else stat.S_IROTH if one == path else stat.S_IXOTH
        if one.stat().st_mode & needed != needed:
            raise InputError(f"{what} cannot be read by the user {USER} of the units: chmod o+rX {one}")


def make_files(settings: BenchSettings, program: Program) -> dict[Path, str]:
    """Return the content of each file, by its path below the root folder."""
    templates = program.tree / "deploy/systemd"
    words = {
        "PYTHON": str(program.python), "TREE": str(program.tree), "BUS": settings.bus, "BUS_UNIT": settings.bus,
        "RATE": str(settings.rate), "BITRATE": str(settings.bitrate), "HOMES": _hide_homes(program.folders),
        "CPU": "" if settings.cpu is None else f"--cpu {settings.cpu}", "AFFINITY": _keep_away(settings.cpu),
        **{place: settings.paths.get(place, "") for place in PATH_VARIABLES},
    }  # fmt: skip

    def fill(name: str) -> str:
        text = (templates / name).read_text(encoding="utf-8")
        return re.sub(r"@([A-Z_]+)@", lambda found: words[found[1]], text)

    files = {
        Path("etc/clutch-hil/bench.conf"): fill("bench.conf"),
        Path("etc/sysusers.d/clutch-hil.conf"): fill("sysusers.conf"),
        Path("etc/security/limits.d/clutch-hil.conf"): fill("limits.conf"),
        Path("etc/udev/rules.d/70-clutch-hil.rules"): fill("clutch-hil.rules"),
        _SYSTEM / TARGET: fill(TARGET),
        _SYSTEM / "clutch-hil-.service.d/10-common.conf": fill("common.conf"),
        _NETWORK / f"60-clutch-hil-{settings.bus}.network": fill(
            "vcan.network" if settings.is_virtual else "can.network"
        ),
    }
    if settings.is_virtual:
        files[_NETWORK / f"60-clutch-hil-{settings.bus}.netdev"] = fill("vcan.netdev")
    for name in UNITS:
        kind = "real_time" if name in _REAL_TIME else "ordinary"
        files[_SYSTEM / name_unit(name)] = fill(name_unit(name))
        files[_SYSTEM / f"{name_unit(name)}.d/20-{kind}.conf"] = fill(f"{kind}.conf")
    return files


def make_links(settings: BenchSettings) -> dict[Path, str]:
    """Return the links by which systemd starts the units with the machine, as made by `systemctl enable`."""
    links = {_SYSTEM / "multi-user.target.wants" / TARGET: f"/{_SYSTEM / TARGET}"}
    for name in settings.started:
        links[_SYSTEM / f"{TARGET}.wants" / name_unit(name)] = f"/{_SYSTEM / name_unit(name)}"
    return links


def name_unit(name: str) -> str:
    """Return the name of the unit of one of UNITS."""
    return f"clutch-hil-{name}.service"


def _hide_homes(folders: Sequence[Path]) -> str:
    seen = [path for path in folders if any(path.is_relative_to(home) for home in _HIDDEN)]
    if not seen:
        return "ProtectHome=yes"
    return "\n".join(["ProtectHome=tmpfs", *(f"BindReadOnlyPaths={path}" for path in seen)])


def _keep_away(cpu: int | None) -> str:
    """Return the line that keeps all but the loops off `cpu`: the loops bind themselves to it, other processes do not."""
    others = [str(one) for one in range(os.cpu_count() or 1) if one != cpu]
    return "" if cpu is None or not others else f"CPUAffinity={' '.join(others)}"
