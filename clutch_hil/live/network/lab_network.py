"""Network of a lab: a file for each role, for zenoh and every command of this project (protocols/telemetry/lab.py).

| role | may |
|---|---|
| bench | plant and controller: publish, answer, and accept changes from the operator; listens |
| operator | read, and request changes under its own name |
| viewer | read |

Each connection uses TLS, and both sides show a certificate of the same authority. The bench applies the rights, by the name in
the peer's certificate; anything that no rule allows is refused. Only the bench accepts connections, because the certificates
of the other roles are not server certificates.
"""

import base64
import json
import os
import socket
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import Any

from clutch_hil.live.network.certificates import Authority, Certificate, check_host
from protocols.errors import InputError
from protocols.files.output_file import check_new_files, whole_files
from protocols.telemetry.keys import PREFIX
from protocols.telemetry.lab import BENCH, OPERATOR, ROLES, SUFFIX, VIEWER, check_name
from protocols.telemetry.session import PORTS

_MOST_DAYS = 825  # longest validity of a server certificate that TLS clients accept (Apple, 2019)
_LOCAL_HOSTS = ("127.0.0.1", "localhost")
_PRIVATE_MODE = 0o600  # of a file with a private key
_PRIVATE_FOLDER = 0o700  # mode of a newly created folder of such files
_READ = ("alive", "record", "history", "last", "describe", "parameters", "event", "events", "request", "requests")


def make_lab(
    folder: Path, hosts: Sequence[str], operator: str, days: int, overwrite: bool
) -> tuple[dict[str, Any], str, str, bool]:
    """Write a file for each role to `folder`; return document, text, verdict and True. Raises InputError.

    hosts: addresses and names by which others reach the bench; they connect to the first. None: this machine only.
    operator: name in the operator's certificate. days: validity of the certificates.
    """
    if not 1 <= days <= _MOST_DAYS:
        raise InputError(f"certificates cannot hold {days} days; allowed are 1 to {_MOST_DAYS}")
    if check_name(operator) in (BENCH, VIEWER):
        raise InputError(f"the operator cannot have the name {operator}; it is the name of another role")
    names = [role + SUFFIX for role in ROLES]
    if os.path.exists(folder) and not os.path.isdir(folder):
        raise InputError(f"folder {folder} cannot be made: a file has this name")
    check_new_files(folder, names, overwrite)
    expires = (datetime.now(UTC) + timedelta(days=days)).replace(microsecond=0)
    files = describe_roles([check_host(host) for host in hosts] or _LOCAL_HOSTS, operator, Authority(expires), expires)
    _write_all(folder, files)
    where = hosts[0] if hosts else "this machine only"
    warnings = list(_warn_of_place(hosts[0])) if hosts else []
    lines = [f"read:    nothing; the bench is reached at {where}"]
    lines += [
        f"{'wrote:   ' if not i else '         '}{folder / (role + SUFFIX)}  {_USES[role]}"
        for i, role in enumerate(ROLES)
    ]
    lines += [f"warning: {text}" for text in warnings]
    verdict = (
        f"3 files, to {expires:%Y-%m-%d %H:%M} UTC; the files contain private keys: give each file only to its user"
    )
    document = {
        "files": [str(folder / name) for name in names], "expires": expires.isoformat(), "hosts": list(hosts),
        "operator": operator, "warnings": warnings,
    }  # fmt: skip
    return document, "\n".join(lines), verdict, True


_USES = {
    BENCH: "for clutch-hil up, plant and controller: --network FILE",
    OPERATOR: "for the person who tunes and injects",
    VIEWER: "for persons who watch and record",
}


def describe_roles(
    hosts: Sequence[str], operator: str, authority: Authority, expires: datetime
) -> dict[str, dict[str, Any]]:
    """Return zenoh's configuration by role, including keys and certificates."""
    where = "127.0.0.1" if hosts[0] == "localhost" else hosts[0]
    connect = [f"tls/{_bracket(where)}:{port}" for port in PORTS]
    # a name may mean another address on its own machine (Debian: 127.0.1.1), so the bench then listens on all addresses
    listen = connect if _is_address(where) else [f"tls/0.0.0.0:{port}" for port in PORTS]
    server = [*dict.fromkeys([*hosts, *_LOCAL_HOSTS, *_name_this_machine()])]
    return {
        BENCH: _make_configuration(BENCH, BENCH, expires, listen=listen)
        | {"transport": _make_transport("listen", authority, authority.issue_certificate(BENCH, server))}
        | {"access_control": _make_rights(operator)},
        OPERATOR: _make_configuration(OPERATOR, operator, expires, connect=connect)
        | {"transport": _make_transport("connect", authority, authority.issue_certificate(operator))},
        VIEWER: _make_configuration(VIEWER, VIEWER, expires, connect=connect)
        | {"transport": _make_transport("connect", authority, authority.issue_certificate(VIEWER))},
    }


def _make_configuration(
    role: str, name: str, expires: datetime, listen: Sequence[str] = (), connect: Sequence[str] = ()
) -> dict[str, Any]:
    return {
        "metadata": {"role": role, "name": name, "expires": expires.isoformat()},
        "mode": "peer",
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "listen": {"endpoints": list(listen)},
        "connect": {"endpoints": list(connect)},
    }


def _make_transport(side: str, authority: Authority, own: Certificate) -> dict[str, Any]:
    """Return zenoh's transport settings: TLS only, certificates on both sides; a link ends when its certificate expires."""
    tls = {
        "root_ca_certificate_base64": _encode_base64(authority.certificate),
        f"{side}_certificate_base64": _encode_base64(own.certificate),
        f"{side}_private_key_base64": _encode_base64(own.key),
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }
    return {"shared_memory": {"enabled": False}, "link": {"protocols": ["tls"], "tls": tls}}


def _make_rights(operator: str) -> dict[str, Any]:
    """Return the access control of the bench: who may do what over its connections. Anything without a rule is refused."""
    read = [f"{PREFIX}/*/*/{leaf}" for leaf in _READ]
    rules = [
        _make_rule(
            "bench tells",
            ["egress"],
            ["put", "delete", "reply", "declare_queryable", "liveliness_token"],
            [f"{PREFIX}/**"],
        ),
        _make_rule("reads", ["ingress"], ["query", "declare_subscriber"], read),
        _make_rule(
            "sees who lives", ["ingress"], ["liveliness_query", "declare_liveliness_subscriber"], [f"{PREFIX}/**"]
        ),
        _make_rule("changes", ["ingress"], ["query"], [f"{PREFIX}/*/*/change/{operator}"]),
    ]
    reading = [rule["id"] for rule in rules[:3]]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": name, "cert_common_names": [name]} for name in (VIEWER, operator)],
        "policies": [
            {"rules": reading, "subjects": [VIEWER, operator]},
            {"rules": [rules[3]["id"]], "subjects": [operator]},
        ],
    }


def _make_rule(name: str, flows: Sequence[str], messages: Sequence[str], keys: Sequence[str]) -> dict[str, Any]:
    return {
        "id": name, "permission": "allow", "flows": list(flows), "messages": list(messages), "key_exprs": list(keys),
    }  # fmt: skip


def _write_all(folder: Path, files: Mapping[str, Mapping[str, Any]]) -> None:
    """Write the file of every role, readable by its owner only; replace none before all are complete. Raises InputError."""
    try:
        with whole_files(folder, _PRIVATE_FOLDER) as parts:
            for role, content in files.items():
                flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
                with open(os.open(parts / (role + SUFFIX), flags, _PRIVATE_MODE), "w", encoding="utf-8") as file:
                    json.dump(content, file, indent=2)
    except OSError as error:
        raise InputError(f"folder {folder} cannot be written: {error.strerror or error}") from None


def _name_this_machine() -> Iterator[str]:
    """Yield the name of this machine, where a certificate can contain it."""
    name = socket.gethostname()
    try:
        yield check_host(name)
    except InputError:
        return


def _warn_of_place(host: str) -> Iterator[str]:
    """Yield a warning where `host`, to which others connect, is not this machine. The files may be for another machine."""
    try:
        places = {(place[0], place[4][0]) for place in socket.getaddrinfo(host, None, type=socket.SOCK_DGRAM)}
    except OSError:
        yield f"the name {host} is not known on this machine; others can connect only if it is known to them"
        return
    if not any(_has_address(family, str(address)) for family, address in places):
        what = "address" if _is_address(host) else "name"
        yield f"this machine does not have the {what} {host}; the bench can be reached there only on the machine that has it"


def _has_address(family: socket.AddressFamily, address: str) -> bool:
    """Return whether `address` is one of this machine, on which a socket can be bound."""
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as one:
            one.bind((address, 0))
    except OSError:
        return False
    return True


def _is_address(host: str) -> bool:
    try:
        ip_address(host)
    except ValueError:
        return False
    return True


def _bracket(host: str) -> str:
    """Return a host as a part of an endpoint, an IPv6 address in brackets."""
    return f"[{host}]" if ":" in host else host


def _encode_base64(text: str) -> str:
    return base64.b64encode(text.encode()).decode()
