"""State of the systemd units that run a bench."""

import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

_FOLDERS = tuple(map(Path, ("etc/systemd/system", "usr/lib/systemd/system", "lib/systemd/system")))
_PREFIX = "clutch-hil"
_TIMEOUT = 5.0  # s for systemctl to answer
_PROPERTIES = "Id,ActiveState,SubState,StatusText,NRestarts"


class UnitState(NamedTuple):
    """active: active, activating, inactive, failed, or unknown. text: status sent by the service. restarts: by systemd."""

    name: str
    active: str
    text: str = ""
    restarts: int = 0

    def __str__(self) -> str:
        """Return the state in a few words."""
        again = f", restarted {self.restarts} times" if self.restarts else ""
        return f"{self.name} {self.active}{f' ({self.text})' if self.text else ''}{again}"


def list_units(root: Path = Path("/")) -> list[str]:
    """Return the names of the bench services that are installed below `root`."""
    return sorted({path.name for folder in _FOLDERS for path in (root / folder).glob(f"{_PREFIX}*.service")})


def read_states(names: Iterable[str]) -> list[UnitState]:
    """Return the state of each unit; unknown where systemd does not run."""
    wanted = list(names)
    command = ["systemctl", "show", f"--property={_PROPERTIES}", *wanted]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT, check=True)
    except (OSError, subprocess.SubprocessError):
        return [UnitState(name, "unknown") for name in wanted]
    states = [_read_state(block) for block in done.stdout.strip().split("\n\n") if block]
    return states or [UnitState(name, "unknown") for name in wanted]


def _read_state(block: str) -> UnitState:
    properties = dict(line.partition("=")[::2] for line in block.splitlines())
    restarts = properties.get("NRestarts", "")
    return UnitState(
        properties.get("Id", ""), properties.get("ActiveState", "unknown"), properties.get("StatusText", ""),
        int(restarts) if restarts.isdigit() else 0,
    )  # fmt: skip
