"""Lab: what `clutch-hil secure` writes for one role of a bench that others reach over a network.

The file is a zenoh configuration in JSON that includes keys and certificates, so a person needs only this file. Its `metadata`
name its owner. A command that accepts a router also accepts the path of such a file.
"""

import getpass
import json
import re
from datetime import UTC, datetime
from pathlib import Path
from shlex import quote
from typing import Any, NamedTuple

from protocols.errors import InputError

BENCH, OPERATOR, VIEWER = ROLES = ("bench", "operator", "viewer")
SUFFIX = ".json"
_ADDRESS = re.compile(r"(?!.*\.json$)[a-z][a-z0-9-]*/.")  # of a router: PROTOCOL/WHERE
_MOST_BYTES = 1 << 20  # of a file: one with its keys is 8 kB
_OTHERS = 0o077  # rights of group and others, which a private key file must not grant
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.@-]{0,59}")  # a part of a key of zenoh, and of a certificate


class Lab(NamedTuple):
    """A file for the network: its path, the role and name in its certificate, when that expires, and zenoh's settings."""

    path: Path
    role: str
    name: str
    expires: datetime
    settings: dict[str, Any]


def read_lab(network: str | None) -> Lab | None:
    """Return the lab file at the path `network`; None if `network` is a router's address or missing. Raises InputError."""
    if network is None or _ADDRESS.match(network):
        return None
    if not network.endswith(SUFFIX):
        raise InputError(
            f"zenoh router {network!r} cannot be reached; an address such as tcp/192.168.1.5:7447 is needed, or a file of"
            f" clutch-hil secure, which ends with {SUFFIX}"
        )
    path = Path(network)
    try:
        if not path.is_file():
            raise InputError(f"file {path} does not exist; `clutch-hil secure FOLDER` makes such files")
        if (mode := path.stat().st_mode & 0o777) & _OTHERS:
            raise InputError(
                f"file {path} has a private key and the mode {mode:04o}; allowed is 0600: chmod 600 {path}"
            )
        with path.open("rb") as file:
            text = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise InputError(f"file {path} cannot be read: {error.strerror}") from None
    if len(text) > _MOST_BYTES:
        raise InputError(f"file {path} has more than {_MOST_BYTES} bytes; files of `clutch-hil secure` are smaller")
    try:
        settings = json.loads(text)
        about = settings["metadata"]
        lab = Lab(path, about["role"], check_name(about["name"]), datetime.fromisoformat(about["expires"]), settings)
        remaining = lab.expires - datetime.now(UTC)
    except (ValueError, LookupError, TypeError, RecursionError):
        raise InputError(f"file {path} was not written by `clutch-hil secure`") from None
    if lab.role not in ROLES:
        raise InputError(f"file {path} is for the role {str(lab.role)[:60]!r}; allowed are {', '.join(ROLES)}")
    if remaining.total_seconds() <= 0.0:
        raise InputError(
            f"the certificate in {path} expired at {lab.expires:%Y-%m-%d %H:%M} UTC;"
            f" renew it: clutch-hil secure {quote(str(path.parent))} --overwrite"
        )
    return lab


def read_bench_lab(network: str | None) -> Lab | None:
    """Return the lab file for plant and controller, as `read_lab`. Raises InputError also for a file of another role."""
    lab = read_lab(network)
    if lab and lab.role != BENCH:
        raise InputError(f"{lab.path} is for the role {lab.role}; plant and controller need {BENCH}{SUFFIX}")
    return lab


def check_name(name: str) -> str:
    """Return `name` if it is valid as a person's name in a key and a certificate. Raises InputError."""
    if not _NAME.fullmatch(name):
        raise InputError(f"name {name[:60]!r} is not possible; allowed are 1 to 60 letters, digits and _ . @ -")
    return name


def find_asker_name(network: str | None) -> str:
    """Return the name under which this process requests changes: from its certificate, else its user. Raises InputError."""
    if lab := read_lab(network):
        if lab.role != OPERATOR:
            raise InputError(
                f"{lab.path} is for the role {lab.role}, which may not change anything; allowed is operator{SUFFIX}"
            )
        return lab.name
    try:
        user = getpass.getuser()
    except (KeyError, OSError):  # a user without a name, as in a container
        return "unknown"
    return re.sub(r"[^A-Za-z0-9_.-]", "_", user)[:60].lstrip("_.-") or "unknown"


def advise_start(network: str | None) -> str:
    """Return how to start a bench that `network` reaches: a router's address, a lab file, or None for this machine."""
    if lab := read_lab(network):
        address = lab.settings["connect"]["endpoints"][0].removeprefix("tls/").rpartition(":")[0]
        return f"start one at {address} with clutch-hil up --network {BENCH}{SUFFIX}, the file that was made with {lab.path}"
    if network:
        return f"start one with: clutch-hil up --router {network}"
    return "start one with: clutch-hil up, or name the network of one elsewhere with --network"


def choose_viewer_network(network: str | None) -> str | None:
    """Return the `network` for a viewer started beside services.

    For a bench's lab file it is the viewer file in the same folder.
    """
    lab = read_lab(network)
    return str(lab.path.with_name(VIEWER + SUFFIX)) if lab and lab.role == BENCH else network
