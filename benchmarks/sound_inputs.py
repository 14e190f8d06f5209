"""Sound inputs of the bench: valid files, telemetry messages and frames, for damaged copies.

All of them are stored as files, so that a copy that breaks a rule is kept.
"""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.mutations import Reach, assert_sentence
from benchmarks.sound_recordings import Sound
from clutch_hil.bench.faults.damage import mutate, mutate_text
from clutch_hil.bench.recovery import recover
from clutch_hil.bench.rig import DEFAULT_RIG, find_rig
from clutch_hil.bench.run_file import read_run
from clutch_hil.bench.scenario import find_shipped_scenarios, load_scenario
from clutch_hil.recordings.import_map import load_map
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from protocols.can.frames import Frame
from protocols.errors import InputError
from protocols.files.journal import Journal
from protocols.files.parameters import load_defaults
from protocols.files.runs import REQUIRED, RunWriter, read_columns
from protocols.node import Column, load_node
from protocols.telemetry.batch import BatchEncoder, decode
from protocols.telemetry.message import check_description, check_event, check_request, parse_message
from protocols.telemetry.tuning import describe_parameters
from rt_controller.guard.allowed_limits import check_limits
from rt_controller.loop.parameter_sets import LIMITS, load_controller_parameters

_SAMPLES = 300  # of a run
_CYCLES = 20  # control cycles simulated with accepted parameters
_FRAME_BYTES = 11  # of a frame in a file: identifier, low byte first; length; 8 bytes of payload
make_controller = load_node("controller")


def make_inputs(folder: Path) -> Iterator[Sound]:
    """Write a small valid file of each kind of input into `folder`."""
    yield from _list_parameter_files(folder)
    yield from _list_plans(folder)
    yield from _list_runs(folder)
    yield from _list_messages(folder)
    yield _make_frames(folder)


def _write(folder: Path, name: str, suffix: str, content: str | bytes, read: Callable[[Path], object]) -> Sound:
    """Return a Sound whose file `read` either reads or refuses with an InputError."""

    def play(copy: Path) -> Reach:
        try:
            read(copy)
        except InputError as error:
            assert_sentence(error)
            return Reach.REFUSED
        return Reach.READ

    file = folder / f"sound-{name.replace(' ', '_')}{suffix}"
    file.write_bytes(content.encode() if isinstance(content, str) else content)
    return Sound(name, file, play, mutate_text if suffix in (".toml", ".csv", ".json") else mutate)


def _list_parameter_files(folder: Path) -> Iterator[Sound]:
    entry = '{name} = {{ value = {value}, unit = "{unit}", uncertainty = {spread}, source = "measured, 2026-11-26" }}\n'
    rig = find_rig(DEFAULT_RIG)
    for name, parameters, read in (
        ("plant", rig.plant.nominal(None), lambda copy: _play(plant=PlantNode(parameters=rig.plant.nominal(copy)))),
        (
            "controller",
            load_controller_parameters(),
            lambda copy: _play(make_controller(parameters_file=copy)),
        ),
    ):
        tables: dict[str, str] = {}
        for one in list(parameters.values())[:40]:
            table, _, key = one.name.partition(".")
            line = entry.format(name=key, value=one.value, unit=one.unit, spread=one.uncertainty)
            tables[table] = tables.get(table, f"[{table}]\n") + line
        yield _write(folder, f"parameters of the {name}", ".toml", "\n".join(tables.values()), read)
    yield _write(
        folder, "limits of the guard", ".toml", LIMITS.read_bytes(), lambda copy: check_limits(load_defaults(copy))
    )


def _play(controller: Any = None, plant: Any = None) -> None:
    """Play some cycles; missing parameters are as shipped."""
    plant, controller = plant or PlantNode(), controller or make_controller()
    inbox: list[Any] = []
    for _ in range(_CYCLES):
        inbox = controller.step(plant.step(inbox))
        assert np.isfinite(np.array(plant.make_row(), float)).all()


def _list_plans(folder: Path) -> Iterator[Sound]:
    """Yield definitions of a run: scenario, profile, and import map of a recording."""
    shipped = find_shipped_scenarios()
    for name in ("frozen_pressure_sensor", "shift"):
        content = shipped[name].read_bytes()
        yield _write(folder, f"scenario {name}", ".toml", content, lambda copy: load_scenario(str(copy)))
    rows = "".join(f"{0.1 * k:.1f},{0.5 * k},10.47\n" for k in range(20))
    profile = f"time_s,torque_demand_nm,motor_speed_demand_rad_s\n{rows}"
    yield _write(folder, "profile", ".csv", profile, lambda copy: load_profile(str(copy)))
    columns = 'time_s = { from = "t", unit = "s" }\ntorque_nm = { from = "M", unit = "Nm", unit_from = "map" }\n'
    text = f"[file]\nlongest_gap_s = 1.0\nresample_hz = 50.0\nlow_pass_hz = 10.0\n[columns]\n{columns}"
    yield _write(folder, "map of an import", ".toml", text, lambda copy: load_map(str(copy)))


def _list_runs(folder: Path) -> Iterator[Sound]:
    """Yield a run, and the remains of a killed recorder."""
    columns = [Column(name, "1", "a sound value") for name in REQUIRED]
    rows = np.random.default_rng(1).normal(size=(_SAMPLES, len(columns)))
    rows[:, 0] = 0.001 * np.arange(_SAMPLES)
    metadata = {"rig": "wet_clutch", "sample_rate_hz": 1000, "settings": {"rate": 1000}, "plant_parameters": {}}
    run = folder / "run.parquet"
    with RunWriter(run, columns) as writer:
        writer.append(rows)
        writer.finish(metadata)
    yield _write(folder, "run", ".parquet", run.read_bytes(), read_run)

    journal = Journal(folder / "killed.parquet", columns, metadata)
    journal.append(rows)
    left = journal.path.read_bytes()
    journal.remove()

    def recover_copy(copy: Path) -> None:
        place = copy.with_name("damaged.parquet.journal")
        place.write_bytes(copy.read_bytes())
        try:
            if file := recover(place).file:
                read_columns(file)
        finally:
            for path in copy.parent.glob("damaged*.parquet*"):
                path.unlink()

    yield _write(folder, "journal", ".parquet.journal", left, recover_copy)


def _list_messages(folder: Path) -> Iterator[Sound]:
    """Yield telemetry payloads: batches to a viewer, and requests to a node."""
    plant, controller = PlantNode(), make_controller()
    columns = [*plant.columns, *(Column(f"plant_{name}", "1", "of the service") for name in ("clock_s", "work_us"))]
    payload = BatchEncoder("plant", 1, 1000.0, 0.0, columns).encode(0, np.ones((5, len(columns))), 0)
    yield _write(folder, "batch of rows", ".arrow", payload, lambda copy: decode(copy.read_bytes(), "plant"))
    now = {"node": "plant", "by": "ann", "time": 1.0, "row": 7}
    event = {**now, "name": "valve.gain", "unit": "bar/V", "new": 2.0, "old": 2.5}
    description = {"session": 1, "columns": [c._asdict() for c in columns], "rate_hz": 1000.0}
    for name, message, check in (
        ("event", event, check_event),
        ("request of another", {**now, "kind": "tune", "values": {"valve.gain": 2.0}}, check_request),
        ("description of a node", description, check_description),
    ):
        yield _write(
            folder, name, ".json", json.dumps(message), lambda copy, c=check: c(parse_message(copy.read_bytes()))
        )
    for name, node in (("plant", plant), ("controller", controller)):
        known = describe_parameters(node, node.parameters)
        values = {one["name"]: one["value"] for one in known if not one["fixed"]}
        few = dict(list(values.items())[:6])
        yield _write(
            folder, f"change of the {name}", ".json", json.dumps(few),
            lambda copy, n=node: n.tune(_need_values(parse_message(copy.read_bytes()))),
        )  # fmt: skip
    planned = {"values": {"valve.gain": 2.0}, "at": 0.002, "ramp": 0.001}
    yield _write(folder, "planned change", ".json", json.dumps(planned), _plan)


def _need_values(asked: object) -> dict[str, float]:
    """Return `asked` if the telemetry would pass it to a node: a dictionary of numbers. Raises InputError."""
    if not isinstance(asked, dict) or not all(isinstance(one, (int, float)) for one in asked.values()):
        raise InputError("a change must be a JSON object of names and numbers")
    return asked


def _plan(copy: Path) -> None:
    """Plan a change on a plant, and continue until the valid one is complete."""
    asked = parse_message(copy.read_bytes())
    if not isinstance(asked, dict) or not isinstance(asked.get("values"), dict):
        raise InputError("a change must be a JSON object of names and numbers")
    plant = PlantNode()
    plant.accept(_need_values(asked["values"]), {name: value for name, value in asked.items() if name != "values"})
    _play(plant=plant)


def _make_frames(folder: Path) -> Sound:
    """Return the frames of the first cycles of a bench; damaged copies are given to a plant and a controller."""
    plant, controller, frames = PlantNode(), make_controller(), []
    inbox: list[Frame] = []
    for _ in range(30):
        sensors = plant.step(inbox)
        inbox = controller.step(sensors)
        frames += [*sensors, *inbox]
    content = b"".join(
        frame.can_id.to_bytes(2, "little") + bytes([len(frame.data)]) + frame.data.ljust(8, b"\0") for frame in frames
    )

    def play(copy: Path) -> None:
        raw = copy.read_bytes()
        pieces = [raw[at : at + _FRAME_BYTES] for at in range(0, len(raw) - _FRAME_BYTES + 1, _FRAME_BYTES)]
        damaged = [Frame(int.from_bytes(one[:2], "little") & 0x7FF, one[3 : 3 + min(one[2], 8)]) for one in pieces]
        plant, controller = PlantNode(), make_controller()
        for at in range(0, len(damaged), 8):
            plant.step(damaged[at : at + 8])
            controller.step(damaged[at : at + 8])
            assert np.isfinite(np.array(plant.make_row(), float)).all()

    return _write(folder, "frames", ".bin", content, play)
