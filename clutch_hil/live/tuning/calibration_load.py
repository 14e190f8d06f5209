"""`clutch-hil tune --calibration`: load a calibration into the controller of a running bench, and optionally into its plant.

Everything is checked before any change: rig, names, units, bounds, and that no clutch is engaged. A map that changes while a
clutch transmits torque would cause a step of the pressure. If a service refuses after another one has changed, the other is
restored.
"""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import zenoh

from clutch_hil.bench.rig import find_rig
from clutch_hil.live.tuning.catalogue import Catalogue, with_unit
from clutch_hil.live.tuning.tune import change_parameters, list_parameters
from protocols.can.frames import load_frames
from protocols.errors import InputError, format_count, join_names
from protocols.files.parameters import (
    PLANT,
    Parameter,
    ParameterSet,
    list_changed,
    load_overlay,
    read_rig,
)
from protocols.telemetry.feed import ask, find_bench
from protocols.telemetry.keys import Keys, find_bus
from protocols.telemetry.lab import find_asker_name
from protocols.telemetry.message import check_description, check_last
from protocols.telemetry.session import open_consumer_session

_SAFE = ("idle", "fault")  # phases in which the clutch is open
_LEVEL_LEARNT = 0.02  # of the friction level: a larger deviation is reported, because it was learnt with the old maps


def load_calibration(
    path: Path, bus: str | None, router: str | None, with_plant: bool
) -> tuple[dict[str, Any], str, str, bool]:
    """Load the calibration file `path` into the bench on `bus`; return document, text, verdict and True.

    with_plant: also into the plant, which becomes the model of the identified rig. Raises InputError; then nothing is changed.
    """
    by = find_asker_name(router)
    with open_consumer_session(router) as session:
        bench = find_bench(session, bus, router)
        rig = _check_rig(session, bench, path)
        catalogue = list_parameters(session, bench)
        controllers = list(find_rig(rig).plant.controllers)
        nodes = [*controllers, *([PLANT] if with_plant else [])]
        wanted = {node: _read_values(catalogue, path, node, rig) for node in nodes}
        levels = [_check_open(session, bench, name) for name in controllers]
        level = max(levels, key=lambda one: abs(one - 1.0))
        changed = _change_all(session, bench, catalogue, wanted, by)
    moved = [change for change in changed if change["old"] != change["new"]]
    lines = [
        with_unit(f"{change['node']}.{change['name']}  {change['old']:g} -> {change['new']:g}", change["unit"])
        + f", from row {change['row']} of the {change['node']} on"
        for change in moved
    ]
    same = len(changed) - len(moved)
    notes = [f"as before: {format_count(same, 'value')}"] if same else []
    if abs(level - 1.0) > _LEVEL_LEARNT:
        notes.append(
            f"warning: the friction level {level:.2f} was adapted with the old maps; from now on it is adapted again"
        )
    if not with_plant:
        notes.append("the plant keeps its parameters; --with-plant changes them as well")
    wrote = "\n".join(f"{'wrote:   ' if i == 0 else '         '}{line}" for i, line in enumerate(lines or ["nothing"]))
    text = "\n".join([f"read:    {path}", wrote, *notes])
    document = {"bench": bench, "calibration": str(path), "changed": changed, "friction_level": level}
    verdict = f"{format_count(len(moved), 'parameter')} changed on {find_bus(bench)} by the calibration {path}"
    return document, text, verdict, True


def _check_rig(session: zenoh.Session, bench: str, path: Path) -> str:
    """Return the rig of bench and calibration. Raises InputError where they differ."""
    rig, about = read_rig(path), ask(session, Keys(bench, PLANT).describe, check_description, attempts=3)
    if about is None:
        raise InputError(
            f"the plant on {find_bus(bench)} does not publish its description; a calibration can be loaded only if"
            " the rig is known"
        )
    if (running := about.get("rig")) != rig:
        raise InputError(f"calibration {path} is for the rig {rig!r}; the rig on {find_bus(bench)} is {running!r}")
    return rig


def _read_values(catalogue: Catalogue, path: Path, node: str, rig: str) -> dict[str, float]:
    """Return the values of a calibration for `node`, by name. Raises InputError where the node cannot accept one of them."""
    own = {full.partition(".")[2]: entry for full, entry in catalogue.entries.items() if full.startswith(f"{node}.")}
    if not own:
        raise InputError(
            f"the {node} on {find_bus(catalogue.bench)} does not answer; it may still be starting, or be stopped"
        )
    running = ParameterSet(
        {
            name: Parameter(
                name, e["value"], e["unit"], e["uncertainty"], (e["bounds"][0], e["bounds"][1]), e["source"]
            )
            for name, e in own.items()
        }
    )
    after = load_overlay(path, running, node, rig)
    values = {name: after[name].value for name in list_changed(path, node)}
    for name, value in values.items():
        low, high = running[name].bounds  # a file may not widen the bounds
        if own[name]["fixed"] or not low <= value <= high:
            raise InputError(own[name]["fixed"] or f"{path}: parameter {name} = {value:g} is outside {low:g}..{high:g}")
    return values


def _check_open(session: zenoh.Session, bench: str, controller: str) -> float:
    """Return the friction level of a controller whose clutch is open. Raises InputError where it is engaged."""
    last = ask(session, Keys(bench, controller).last, check_last, attempts=3)
    values = (last or {}).get("values", {})
    phase = values.get(f"{controller}_phase", {}).get("value")
    if phase is None:
        raise InputError(
            f"the {controller} on {find_bus(bench)} has not published its phase yet; wait for its first cycles"
        )
    words = load_frames()["CONTROLLER_STATUS"].list_choices("phase")
    if (word := words.get(int(phase), f"{phase:g}")) not in _SAFE:
        raise InputError(
            f"the clutch on {find_bus(bench)} is engaged (phase {word}), and new maps would make its pressure jump; allowed in"
            f" the phases {join_names(_SAFE)}: end the demand first"
        )
    level = values.get(f"{controller}_friction_level", {}).get("value")
    return 1.0 if level is None else float(level)


def _change_all(
    session: zenoh.Session, bench: str, catalogue: Catalogue, wanted: Mapping[str, Mapping[str, float]], by: str
) -> list[dict[str, Any]]:
    """Change every node or none: changed nodes are restored where a later one refuses. Raises InputError."""
    changed: list[dict[str, Any]] = []
    done: list[str] = []
    for node, values in wanted.items():
        try:
            changed += change_parameters(session, bench, {node: values}, by)
        except InputError as error:
            for other in done:
                before = {name: float(catalogue.entries[f"{other}.{name}"]["value"]) for name in wanted[other]}
                with suppress(InputError):
                    change_parameters(session, bench, {other: before}, by)
            back = f"; the {join_names(done)} has its old values again" if done else ""
            raise InputError(f"{error}{back}") from None
        done.append(node)
    return changed
