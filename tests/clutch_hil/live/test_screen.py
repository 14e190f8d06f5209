"""What a screen logs: every column once and equal, states by name, a scene for the eye, at a small cost."""

import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb
import rerun.chunk

from clutch_hil.bench.in_process import play
from clutch_hil.live.blueprint import build_blueprint
from clutch_hil.live.dashboard import places
from clutch_hil.live.rrd_reader import read_rrd
from clutch_hil.live.screen import Screen
from clutch_hil.live.solids import revolve, ring_profile
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from protocols.errors import InputError
from protocols.node import Column
from protocols.telemetry.batch import Batch, run_file_columns
from rt_controller.loop.node import ControllerNode

RATE = 1000  # Hz
SECONDS = 1.0  # idle, fill and slip control of the engagement profile
EPOCH = 1.7e9  # s
SETTLING = 0.06  # s that an error leaves out after a touch
COST = 0.015  # s of this thread for 20 rows of one node: three times what is asked for, for a busy machine
SCENE_RATES = 20.0, 30.0  # Hz: smooth for the eye, cheap for the viewer


@pytest.fixture(scope="module")
def nodes() -> dict[str, Batch]:
    """The rows of both nodes of a simulated engagement, as a service publishes them."""
    profile = load_profile("engagement", SECONDS)
    controller = ControllerNode(RATE)
    played = play(PlantNode(RATE, profile=profile), controller)
    plant = _with_clock("plant", tuple(played.plant_columns), played.plant)
    return {
        "plant": plant,
        "controller": _with_clock(
            "controller", run_file_columns("controller", played.controller_columns[0]), played.controllers[0]
        ),
    }


def _with_clock(node: str, columns: tuple[Column, ...], rows: np.ndarray) -> Batch:
    more = tuple(Column(f"{node}_{name}", unit, "") for name, unit in (("clock_s", "s"), ("work_us", "us")))
    count = len(rows)
    clock = 100.0 + np.arange(count) / RATE
    return Batch(node, 1, 0, RATE, EPOCH, 0, columns + more, np.column_stack([rows, clock, np.full(count, 60.0)]))


def _pieces(nodes: dict[str, Batch], size: int = 100) -> Iterable[Batch]:
    """Batches of `size` rows, the nodes in turn."""
    for begin in range(0, len(nodes["plant"].rows), size):
        for batch in nodes.values():
            yield _rows(batch, begin, begin + size)


def _rows(batch: Batch, begin: int, end: int, **changes: Any) -> Batch:
    values = {
        "node": batch.node, "session": batch.session, "first_row": begin, "rate": batch.rate, "epoch": batch.epoch,
        "rows_lost": 0, "columns": batch.columns, "rows": batch.rows[begin:end],
    }  # fmt: skip
    return Batch(**(values | changes))


class Logged:
    """A recording in a file that screens log into, and what stands in it."""

    def __init__(self, path: Path, layout: rrb.Blueprint | None = None) -> None:
        self.path = path
        self.recording = rr.RecordingStream("clutch-hil")
        self.recording.set_log_time_enabled(False)
        self.recording.set_log_tick_enabled(False)
        self.recording.save(path, default_blueprint=layout)

    def screen(self, batches: Iterable[Batch], timeline: str = "time", prefix: str = "") -> Screen:
        screen = Screen(self.recording, timeline, prefix)
        screen.open()
        for batch in batches:
            screen.log(batch)
        return screen

    def chunks(self) -> dict[str, list[Any]]:
        """Record batches that have a time, by entity."""
        self.recording.flush()
        self.recording.disconnect()
        found = defaultdict(list)
        for chunk in rerun.chunk.RrdReader(self.path).stream():
            if not chunk.is_static:
                found[chunk.entity_path].append(chunk.to_record_batch())
        return found


@pytest.fixture
def logged(tmp_path: Path) -> Logged:
    return Logged(tmp_path / "run.rrd")


def _cells(chunks: Sequence[Any], column: str) -> list[Any]:
    return [cell for chunk in chunks for cell in chunk[column].to_pylist()]


def _times(chunks: Sequence[Any], timeline: str = "rig_time") -> np.ndarray:
    """Of a timeline [s], in order."""
    return np.sort(np.concatenate([chunk[timeline].to_numpy().astype(np.int64) for chunk in chunks])) / 1e9


def test_every_column_stands_in_exactly_one_place(nodes: dict[str, Batch]) -> None:
    for node, batch in nodes.items():
        names = Counter(column.name for place in places(node, batch.columns) for column in place.columns)
        assert names == Counter(column.name for column in batch.columns)


def test_a_column_nobody_has_heard_of_has_a_place() -> None:
    (place,) = places("plant", [Column("hum_db", "dB", "")])
    assert place.columns[0].name == "hum_db"
    assert place.path.startswith("more/")


def test_values_read_back_are_equal(nodes: dict[str, Batch], logged: Logged) -> None:
    logged.screen(_pieces(nodes))
    logged.chunks()
    tables = read_rrd(logged.path)
    assert set(tables) == {"plant", "controller"}
    for node, batch in nodes.items():
        table = tables[node]
        assert [(c.name, c.unit) for c in table.columns] == [(c.name, c.unit) for c in batch.columns]
        assert np.array_equal(table.row, np.arange(len(batch.rows)))
        assert np.array_equal(table.rows, batch.rows, equal_nan=True)
        assert table.rate == RATE


def test_rows_come_back_in_order_however_they_came(nodes: dict[str, Batch], logged: Logged) -> None:
    pieces = list(_pieces(nodes, 130))
    logged.screen(pieces[::-1])
    logged.chunks()
    assert np.array_equal(read_rrd(logged.path)["plant"].rows, nodes["plant"].rows)


def test_a_gap_is_two_batches(nodes: dict[str, Batch], logged: Logged) -> None:
    plant = nodes["plant"]
    logged.screen([_rows(plant, 0, 100), _rows(plant, 300, 400)])
    logged.chunks()
    first, second = read_rrd(logged.path)["plant"].batches()
    assert (first.first_row, first.end, second.first_row, second.end) == (0, 100, 300, 400)
    assert np.array_equal(second.rows, plant.rows[300:400])


def test_a_second_life_of_a_service_follows_the_first(nodes: dict[str, Batch], logged: Logged) -> None:
    plant = nodes["plant"]
    later = plant.rows[:100].copy()
    later[:, -2] += 10.0  # s on the clock
    logged.screen([_rows(plant, 0, 200), _rows(plant, 0, 100, session=2, rows=later)])
    logged.chunks()
    first, second = read_rrd(logged.path)["plant"].batches()
    assert (len(first.rows), len(second.rows)) == (200, 100)
    assert second.session > first.session


def test_a_cut_off_file_is_named(nodes: dict[str, Batch], logged: Logged) -> None:
    logged.screen(_pieces(nodes, 500))
    logged.chunks()
    logged.path.write_bytes(logged.path.read_bytes()[:-5000])
    with pytest.raises(InputError, match=r"run\.rrd"):
        read_rrd(logged.path)


@pytest.mark.parametrize("content", [b"", b"PAR1 this is no view"], ids=["empty", "foreign"])
def test_a_foreign_file_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "foreign.rrd"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"foreign\.rrd"):
        read_rrd(path)


def test_a_recording_of_something_else_holds_no_bench(tmp_path: Path) -> None:
    recording = rr.RecordingStream("other")
    recording.save(tmp_path / "other.rrd")
    recording.log("door", rr.TextLog("open"))
    recording.flush()
    recording.disconnect()
    with pytest.raises(InputError, match="holds no rows of a bench"):
        read_rrd(tmp_path / "other.rrd")


def test_not_a_number_breaks_nothing(nodes: dict[str, Batch], logged: Logged) -> None:
    holes = {}
    for node, batch in nodes.items():
        rows = batch.rows.copy()
        rows[::7, :-2] = np.nan  # all but the clock
        rows[300:500, :-2] = np.nan
        holes[node] = _rows(batch, 0, len(rows), rows=rows)
    logged.screen(_pieces(holes))
    chunks = logged.chunks()
    for node, batch in holes.items():
        assert np.array_equal(read_rrd(logged.path)[node].rows, batch.rows, equal_nan=True)
    for strip in _cells(chunks["/torque_over_slip/data/true"], "LineStrips2D:strips"):
        assert np.isfinite(strip).all()


def test_live_rows_stand_at_unix_time_and_at_the_rigs_time(nodes: dict[str, Batch], logged: Logged) -> None:
    logged.screen(_pieces(nodes))
    torque = logged.chunks()["/torque/plant"]
    assert _times(torque, "time")[0] == EPOCH + 100.0
    assert np.array_equal(_times(torque), np.arange(len(nodes["plant"].rows)) / RATE)


def test_a_replay_stands_at_the_rigs_time_only(nodes: dict[str, Batch], logged: Logged) -> None:
    logged.screen(_pieces(nodes), timeline="rig_time")
    torque = logged.chunks()["/torque/controller"]
    assert "time" not in torque[0].schema.names
    assert _times(torque)[-1] == nodes["controller"]["controller_sample_tick"][-1] / RATE


def test_an_unknown_timeline_is_refused() -> None:
    with pytest.raises(InputError, match="rig_time"):
        Screen(rr.RecordingStream("clutch-hil"), "log_time")


def test_rows_without_a_clock_are_shown(nodes: dict[str, Batch], logged: Logged) -> None:
    plant = nodes["plant"]
    bare = _rows(plant, 0, 100, columns=plant.columns[:-2], rows=plant.rows[:100, :-2])
    logged.screen([bare])
    assert _times(logged.chunks()["/torque/plant"], "time")[0] == EPOCH


def test_two_runs_stand_side_by_side(nodes: dict[str, Batch], logged: Logged) -> None:
    for prefix in ("/a", "/b"):
        logged.screen(_pieces(nodes), "rig_time", prefix)
    entities = logged.chunks()
    assert all(entity.startswith(("/a/", "/b/", "/__properties")) for entity in entities)
    tables = read_rrd(logged.path)
    assert set(tables) == {"a/plant", "a/controller", "b/plant", "b/controller"}
    assert np.array_equal(tables["b/plant"].rows, nodes["plant"].rows)


def test_states_are_logged_by_name_when_they_change(nodes: dict[str, Batch], logged: Logged) -> None:
    logged.screen(_pieces(nodes))
    chunks = logged.chunks()
    assert _cells(chunks["/states/phase"], "StateChange:state") == [["idle"], ["fill"], ["slip control"]]
    assert _cells(chunks["/states/fault"], "StateChange:state") == [["none"]]
    assert [text for text, *_ in _cells(chunks["/states/clutch"], "StateChange:state")][:2] == ["open", "sliding"]
    phase = nodes["controller"]["controller_phase"]
    ticks = nodes["controller"]["controller_sample_tick"]
    changes = [0, *(np.flatnonzero(np.diff(phase)) + 1)]
    assert np.array_equal(_times(chunks["/states/phase"]), ticks[changes] / RATE)


def test_errors_are_those_of_the_same_sample(nodes: dict[str, Batch], logged: Logged) -> None:
    plant, controller = nodes["plant"], nodes["controller"]
    late = [_rows(plant, k, k + 40) for k in range(0, 800, 40)]
    early = [_rows(controller, k, k + 70) for k in range(0, 840, 70)]
    logged.screen([*late[:7], *early, *late[7:]])
    chunks = logged.chunks()["/torque_error/true"]
    order = np.argsort(np.concatenate([chunk["rig_time"].to_numpy() for chunk in chunks]))
    error = np.concatenate(_cells(chunks, "Scalars:scalars"))[order]
    followed = np.isfinite(error)
    wanted = plant["truth_clutch_torque_nm"][:800] - controller["controller_torque_demand_nm"][:800]
    assert np.array_equal(error[followed], wanted[followed])
    assert followed.sum() > 300


def test_there_is_an_error_once_the_plates_have_slid_for_a_while(nodes: dict[str, Batch], logged: Logged) -> None:
    logged.screen(_pieces(nodes))
    error = np.concatenate(_cells(logged.chunks()["/torque_error/estimate"], "Scalars:scalars"))
    sliding = np.flatnonzero(nodes["controller"]["controller_clutch_state"] == 1.0)
    followed = np.flatnonzero(np.isfinite(error))
    assert followed[0] == pytest.approx(sliding[0] + SETTLING * RATE, abs=1)
    assert np.abs(error[followed]).max() < 1.0  # Nm; 3.7 at the touch


@pytest.mark.parametrize("size", [100, 33])
def test_a_torque_backwards_is_drawn_with_its_demand_and_has_the_same_error(
    nodes: dict[str, Batch], tmp_path: Path, size: int
) -> None:
    signed = ("truth_clutch_torque_nm", "controller_torque_estimate_nm", "controller_slip_rad_s")
    drawn = []
    for name, turned_round in (("there", nodes), ("back", {node: _negated(nodes[node], signed) for node in nodes})):
        logged = Logged(tmp_path / f"{name}.rrd")
        logged.screen(_pieces(turned_round, size))
        chunks = logged.chunks()
        paths = ("/torque/demand", "/torque_error/true", "/torque_error/estimate")
        drawn.append([np.concatenate(_cells(chunks[path], "Scalars:scalars")) for path in paths])
    there, back = drawn
    assert np.array_equal(there[0], nodes["controller"]["controller_torque_demand_nm"])
    assert np.array_equal(back[0], -there[0])
    for error, error_back in zip(there[1:], back[1:], strict=True):
        assert np.array_equal(error, error_back, equal_nan=True)


def test_an_estimate_of_the_wrong_sign_has_an_error(nodes: dict[str, Batch], logged: Logged) -> None:
    wrong = {node: _negated(nodes[node], ("controller_torque_estimate_nm",)) for node in nodes}
    logged.screen(_pieces(wrong))
    error = np.concatenate(_cells(logged.chunks()["/torque_error/estimate"], "Scalars:scalars"))
    assert np.nanmax(error) < -9.0  # Nm: 5 Nm of demand and as much torque the other way


def _negated(batch: Batch, columns: Sequence[str]) -> Batch:
    rows = batch.rows.copy()
    rows[:, [column.name in columns for column in batch.columns]] *= -1.0
    return replace(batch, rows=rows)


def test_a_curve_that_goes_backwards_has_symmetric_axes(nodes: dict[str, Batch], logged: Logged) -> None:
    logged.screen(_pieces({"plant": _negated(nodes["plant"], ("truth_clutch_torque_nm", "truth_slip_speed_rad_s"))}))
    logged.chunks()
    ends = {}
    for chunk in rerun.chunk.RrdReader(logged.path).stream():
        if chunk.entity_path.endswith("/labels"):
            texts = chunk.to_record_batch()["Points2D:labels"].to_pylist()[-1]
            numbers = [float(text) for text in texts if text.lstrip("-").replace(".", "").isdigit()]
            rises = [0, *(np.flatnonzero(np.diff(numbers) < 0.0) + 1)]  # where the ticks of y begin
            ends[chunk.entity_path] = [(part[0], part[-1]) for part in np.split(numbers, rises[1:])]
    assert ends["/torque_over_slip/labels"] == [(-30.0, 30.0), (-20.0, 20.0)]
    assert ends["/torque_over_pressure/labels"] == [(0.0, 4.0), (-20.0, 20.0)]


def test_the_slip_axis_of_a_recorded_run_is_symmetric_where_it_slips_backwards() -> None:
    def ranges(slips: Sequence[float | None]) -> list[Any]:
        layout = build_blueprint("rig_time", ("/a", "/b"), ("a", "b"), None, slips=slips)
        views = [view for view in _views(layout.root_container) if str(view.origin).endswith("/slip")]
        return [view.properties.get("ScalarAxis") for view in views]

    forwards, backwards = ranges((None, 12.0))
    assert forwards is None
    assert backwards.range.as_arrow_array().to_pylist() == [[-12.0, 12.0]]


@pytest.mark.parametrize("size", [7, 20, 1000])
def test_the_scene_moves_at_a_rate_for_the_eye(nodes: dict[str, Batch], tmp_path: Path, size: int) -> None:
    logged = Logged(tmp_path / "scene.rrd")
    logged.screen(_rows(nodes["plant"], k, k + size) for k in range(0, len(nodes["plant"].rows), size))
    frames = len(_times(logged.chunks()["/scene/a/piston"]))
    assert SCENE_RATES[0] <= frames / SECONDS <= SCENE_RATES[1]


def test_the_plates_close_with_the_piston(nodes: dict[str, Batch], logged: Logged) -> None:
    logged.screen(_pieces(nodes))
    plates = np.array(_cells(logged.chunks()["/scene/a/steel"], "InstancePoses3D:translations"))[..., 0]
    gaps = np.diff(plates, axis=1)
    assert (gaps[-1] < 0.8 * gaps[0]).all()
    assert gaps[-1] == pytest.approx(2 * 0.16)  # the thickness of the friction plate and of the steel plate


def test_a_turned_part_has_the_volume_of_a_ring() -> None:
    mesh = revolve(ring_profile(0.0, 2.0, 1.0, 3.0), 0xFFFFFFFF)
    corners = np.array(mesh.vertex_positions.as_arrow_array().flatten()).reshape(-1, 3)
    triangles = corners[np.array(mesh.triangle_indices.as_arrow_array().flatten()).reshape(-1, 3)]
    volume = abs(np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum()) / 6.0
    assert volume == pytest.approx(np.pi * (3.0**2 - 1.0**2) * 2.0, rel=0.01)  # of 48 flat sectors


def test_trails_join_up_whatever_the_batches(nodes: dict[str, Batch], logged: Logged) -> None:
    logged.screen(_rows(nodes["plant"], k, k + 33) for k in range(0, len(nodes["plant"].rows), 33))
    strips = _cells(logged.chunks()["/torque_over_pressure/data/true"], "LineStrips2D:strips")
    for (before,), (after,) in pairwise(strips):
        assert before[-1] == after[0]


def test_axes_grow_with_the_data(nodes: dict[str, Batch], logged: Logged) -> None:
    plant = nodes["plant"]
    rows = plant.rows.copy()
    rows[:, [c.name for c in plant.columns].index("truth_clutch_torque_nm")] *= 10.0
    logged.screen([_rows(plant, 0, len(rows), rows=rows)])
    logged.chunks()
    labels = []
    for chunk in rerun.chunk.RrdReader(logged.path).stream():
        if chunk.entity_path == "/torque_over_slip/labels":
            labels += chunk.to_record_batch()["Points2D:labels"].to_pylist()[-1]
    assert max(float(text) for text in labels if text.isdigit()) >= 10.0 * plant["truth_clutch_torque_nm"].max()


def test_a_change_of_a_parameter_is_told(nodes: dict[str, Batch], logged: Logged) -> None:
    screen = logged.screen(_pieces(nodes))
    event = {"node": "controller", "name": "torque.integral_gain", "old": 0.1, "new": 0.2, "unit": "bar/Nm", "row": 5}
    screen.log_event(event | {"time": EPOCH + 100.5})
    chunks = logged.chunks()["/events"]
    assert ["controller: torque.integral_gain 0.1 -> 0.2 bar/Nm"] in _cells(chunks, "TextLog:text")
    assert EPOCH + 100.5 in _times(chunks, "time")


def test_opened_again_it_names_everything_again(nodes: dict[str, Batch], logged: Logged) -> None:
    screen = logged.screen(_pieces(nodes, 1000))
    screen.open()
    screen.log(_rows(nodes["plant"], 0, 10, session=2))
    logged.chunks()
    static: Counter[str] = Counter()
    for chunk in rerun.chunk.RrdReader(logged.path).stream():
        static[chunk.entity_path] += chunk.to_record_batch().num_rows if chunk.is_static else 0
    assert static["/torque/plant"] == 2
    assert static["/scene/a/oil"] == 2


@pytest.mark.parametrize("prefixes", [("",), ("/a", "/b")], ids=["one bench", "two runs"])
def test_every_view_has_content(nodes: dict[str, Batch], tmp_path: Path, prefixes: tuple[str, ...]) -> None:
    layout = build_blueprint("rig_time", prefixes, [prefix.strip("/") for prefix in prefixes], None)
    logged = Logged(tmp_path / "run.rrd")
    for prefix in prefixes:
        logged.screen(_pieces(nodes), "rig_time", prefix)
    entities = list(logged.chunks())
    views = list(_views(layout.root_container))
    assert len(views) >= 18 * len(prefixes)
    for view in views:
        assert any(entity.startswith(f"{view.origin}/") or entity == view.origin for entity in entities), view.name


def _views(part: Any) -> Iterable[rrb.View]:
    if isinstance(part, rrb.View):
        yield part
    else:
        for inner in part.contents:
            yield from _views(inner)


def test_rows_are_cheap(nodes: dict[str, Batch], logged: Logged) -> None:
    screen = logged.screen(_pieces(nodes, 500))
    for node, batch in nodes.items():
        costs = []
        for begin in range(0, 1000, 20):
            piece = _rows(batch, begin, begin + 20)
            before = time.thread_time()
            screen.log(piece)
            costs.append(time.thread_time() - before)
        assert np.median(costs) < COST, node
