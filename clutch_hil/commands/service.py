"""`clutch-hil service`: install the bench as systemd units, remove them, or report their state."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer

from clutch_hil.command import check_rate, report
from clutch_hil.commands.options import JSON
from protocols.errors import InputError, join_names

ACTION = typer.Argument(help="install, uninstall or status")
BUS = typer.Option(None, help="CAN interface: vcan0, or a card such as can0; vcan0 if not given")
RATE = typer.Option(None, help="rate of samples and commands, in Hz; 1000 if not given")
LOOP_CPU = typer.Option(None, help="CPU for the loops, kept free of other processes of the units; any if not given")
BITRATE = typer.Option(None, help="bit rate of a card, in bit/s; 1000000 if not given")
STARTED = typer.Option(
    [],
    "--start",
    help="unit that starts with the machine: plant, controller, recorder or view, may be given more than once; plant,"
    " controller and view if not given, without the plant on a card",
)
LATER = typer.Option(False, "--later", help="install: do not start the units now, only when the machine starts")
PURGE = typer.Option(False, "--purge", help="uninstall: remove recordings and changed files as well")
ROOT = typer.Option(Path("/"), help="root folder of the files; for an image of another machine")
OVERWRITE = typer.Option(False, help="install: also replace files that were written or changed by others")

_ALLOWED = {
    "install": {"bus", "rate", "cpu", "bitrate", "start", "later", "overwrite"},
    "uninstall": {"purge"},
    "status": set[str](),
}


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(service)


def service(
    action: str = ACTION,
    bus: str | None = BUS,
    rate: int | None = RATE,
    cpu: int | None = LOOP_CPU,
    bitrate: int | None = BITRATE,
    started: list[str] = STARTED,
    later: bool = LATER,
    purge: bool = PURGE,
    root: Path = ROOT,
    overwrite: bool = OVERWRITE,
    json_output: bool = JSON,
) -> None:
    """Install plant, controller, recorder and view as units of systemd, remove them, or tell how they are."""
    from clutch_hil.bench.host.installation import Installation
    from clutch_hil.bench.host.unit_files import BenchSettings, check_settings, read_paths

    given = {
        "bus": bus, "rate": rate, "cpu": cpu, "bitrate": bitrate, "start": started, "later": later, "purge": purge,
        "overwrite": overwrite,
    }  # fmt: skip
    _check_action(action, given)
    installation = Installation(root)
    if action == "install":
        default = BenchSettings()
        name = bus or default.bus
        virtual = default._replace(bus=name).is_virtual
        if bitrate is not None and virtual:
            raise InputError(f"--bitrate {bitrate} was given for {name}; a virtual bus has none")
        settings = check_settings(
            BenchSettings(
                name, check_rate(default.rate if rate is None else rate), cpu,
                default.bitrate if bitrate is None else bitrate,
                tuple(started) or tuple(one for one in default.started if virtual or one != "plant"),
                read_paths(os.environ),
            )
        )  # fmt: skip
        report(*_install(installation, settings, later, overwrite), json_output)
    elif action == "uninstall":
        report(*_uninstall(installation, purge), json_output)
    else:
        report(*_tell_status(installation), json_output)


def _check_action(action: str, given: dict[str, Any]) -> None:
    if action not in _ALLOWED:
        raise InputError(f"service {action!r} is unknown; allowed are {join_names(_ALLOWED)}")
    for name, value in given.items():
        if (value or value == 0) and value is not False and name not in _ALLOWED[action]:
            owner = next(one for one, names in _ALLOWED.items() if name in names)
            raise InputError(f"--{name} was given with service {action}; it is only for service {owner}")


def _install(installation: Any, settings: Any, later: bool, overwrite: bool) -> tuple[dict[str, Any], str, str, bool]:
    from clutch_hil.bench.host.installation import format_paths
    from clutch_hil.bench.host.unit_files import find_program, make_files, make_links

    program = find_program()
    links = make_links(settings)
    live = installation.root == Path("/")
    written = installation.install(make_files(settings, program), links, settings.bus, not later and live, overwrite)
    text = "\n".join(["wrote:", *format_paths(written, installation.root)])
    names = ", ".join(settings.started)
    verdict = f"installed for {settings.bus} at {settings.rate} Hz: {names} "
    verdict += "start now and with the machine" if live and not later else "start with the machine"
    document = {
        "root": str(installation.root),
        "wrote": [str(path) for path in written],
        "settings": settings._asdict(),
    }
    return document, text, verdict, True


def _uninstall(installation: Any, purge: bool) -> tuple[dict[str, Any], str, str, bool]:
    from clutch_hil.bench.host.installation import describe_left, format_paths

    removed, left = installation.uninstall(purge)
    lines: Sequence[str] = ["removed:", *format_paths(removed, installation.root)]
    if left:
        lines = [*lines, "left:", *describe_left(left, installation.root)]
    verdict = f"{len(removed)} files and folders removed"
    verdict += f", {len(left)} left; --purge removes these too" if left else ", nothing left"
    document = {
        "root": str(installation.root),
        "removed": [str(path) for path in removed],
        "left": {str(path): reason for path, reason in left.items()},
    }
    return document, "\n".join(lines), verdict, True


def _tell_status(installation: Any) -> tuple[dict[str, Any], str, str, bool]:
    from clutch_hil.bench.host.installation import describe_left
    from clutch_hil.bench.host.unit_state import list_units, read_states

    names = list_units(installation.root)
    if not names:
        return {"installed": False, "units": [], "changes": {}}, "units:   none", "no units are installed", True
    live = installation.root == Path("/")
    states = read_states(names) if live else []
    changes = installation.list_changes() if installation.exists else {}
    lines = [f"unit:    {state}" for state in states] or [f"unit:    {name}" for name in names]
    lines += ["changed since they were installed:", *describe_left(changes, installation.root)] if changes else []
    failed = [state.name for state in states if state.active == "failed"]
    active = sum(state.active == "active" for state in states)
    verdict = f"{len(names)} units installed" + (f", {active} active, {len(failed)} failed" if live else "")
    document = {
        "installed": True,
        "units": [state._asdict() for state in states] or [{"name": name} for name in names],
        "changes": {str(path): change for path, change in changes.items()},
    }
    return document, "\n".join(lines), verdict, not failed
