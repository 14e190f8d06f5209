"""What a screen logs: every column once and equal, states and errors by name, at a small cost."""

import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
import rerun.chunk

from clutch_hil.live.viewer.dashboard import list_places
from clutch_hil.live.viewer.rrd_reader import read_rrd
from clutch_hil.live.viewer.screen import Screen
from clutch_hil.live.viewer.times import make_times
from protocols.errors import InputError
from protocols.node import Column
from protocols.telemetry.batch import Batch
from tests.clutch_hil.live.viewer.screen_recording import (
    EPOCH,
    RATE,
    Logged,
    cut_pieces,
    cut_rows,
    list_cells,
    list_times,
    negate,
)

SETTLING = 0.06  # s that an error leaves out after a touch
COST = 0.015  # s of this thread for 20 rows of one node: three times what is asked for, for a busy machine


def test_every_column_stands_in_exactly_one_place(nodes: dict[str, Batch]) -> None:
    for node, batch in nodes.items():
        names = Counter(column.name for place in list_places(node, batch.columns) for column in place.columns)
        assert names == Counter(column.name for column in batch.columns)


def test_a_column_nobody_has_heard_of_has_a_place() -> None:
    (place,) = list_places("plant", [Column("hum_db", "dB", "")])
    assert place.columns[0].name == "hum_db"
    assert place.path.startswith("more/")


def test_not_a_number_breaks_nothing(nodes: dict[str, Batch], logged: Logged) -> None:
    holes = {}
    for node, batch in nodes.items():
        rows = batch.rows.copy()
        rows[::7, :-2] = np.nan  # all but the clock
        rows[300:500, :-2] = np.nan
        holes[node] = cut_rows(batch, 0, len(rows), rows=rows)
    logged.make_screen(cut_pieces(holes))
    chunks = logged.list_chunks()
    for node, batch in holes.items():
        assert np.array_equal(read_rrd(logged.path)[node].rows, batch.rows, equal_nan=True)
    for strip in list_cells(chunks["/torque_over_slip/data/true"], "LineStrips2D:strips"):
        assert np.isfinite(strip).all()


def test_rows_of_the_second_controller_stand_at_the_times_of_the_first(nodes: dict[str, Batch]) -> None:
    first = nodes["controller"]
    names = [column.name.replace("controller_", "controller_b_", 1) for column in first.columns]
    columns = tuple(column._replace(name=name) for column, name in zip(first.columns, names, strict=True))
    times = [make_times(batch, True) for batch in (first, replace(first, node="controller_b", columns=columns))]
    for part in ("row", "rig", "unix"):
        np.testing.assert_array_equal(*(getattr(one, part) for one in times))


def test_live_rows_stand_at_unix_time_and_at_the_rigs_time(nodes: dict[str, Batch], logged: Logged) -> None:
    logged.make_screen(cut_pieces(nodes))
    torque = logged.list_chunks()["/torque/plant"]
    assert list_times(torque, "time")[0] == EPOCH + 100.0
    assert np.array_equal(list_times(torque), np.arange(len(nodes["plant"].rows)) / RATE)


def test_a_replay_stands_at_the_rigs_time_only(nodes: dict[str, Batch], logged: Logged) -> None:
    logged.make_screen(cut_pieces(nodes), timeline="rig_time")
    torque = logged.list_chunks()["/torque/controller"]
    assert "time" not in torque[0].schema.names
    assert list_times(torque)[-1] == nodes["controller"]["controller_sample_tick"][-1] / RATE


def test_an_unknown_timeline_is_refused() -> None:
    with pytest.raises(InputError, match="rig_time"):
        Screen(rr.RecordingStream("clutch-hil"), "log_time")


def test_rows_without_a_clock_are_shown(nodes: dict[str, Batch], logged: Logged) -> None:
    plant = nodes["plant"]
    bare = cut_rows(plant, 0, 100, columns=plant.columns[:-2], rows=plant.rows[:100, :-2])
    logged.make_screen([bare])
    assert list_times(logged.list_chunks()["/torque/plant"], "time")[0] == EPOCH


def test_two_runs_stand_side_by_side(nodes: dict[str, Batch], logged: Logged) -> None:
    for prefix in ("/a", "/b"):
        logged.make_screen(cut_pieces(nodes), "rig_time", prefix)
    entities = logged.list_chunks()
    assert all(entity.startswith(("/a/", "/b/", "/__properties")) for entity in entities)
    tables = read_rrd(logged.path)
    assert set(tables) == {"a/plant", "a/controller", "b/plant", "b/controller"}
    assert np.array_equal(tables["b/plant"].rows, nodes["plant"].rows)


def test_states_are_logged_by_name_when_they_change(nodes: dict[str, Batch], logged: Logged) -> None:
    logged.make_screen(cut_pieces(nodes))
    chunks = logged.list_chunks()
    assert list_cells(chunks["/states/phase"], "StateChange:state") == [["idle"], ["fill"], ["slip control"]]
    assert list_cells(chunks["/states/fault"], "StateChange:state") == [["none"]]
    assert [text for text, *_ in list_cells(chunks["/states/clutch"], "StateChange:state")][:2] == ["open", "sliding"]
    phase = nodes["controller"]["controller_phase"]
    ticks = nodes["controller"]["controller_sample_tick"]
    changes = [0, *(np.flatnonzero(np.diff(phase)) + 1)]
    assert np.array_equal(list_times(chunks["/states/phase"]), ticks[changes] / RATE)


def test_errors_are_those_of_the_same_sample(nodes: dict[str, Batch], logged: Logged) -> None:
    plant, controller = nodes["plant"], nodes["controller"]
    late = [cut_rows(plant, k, k + 40) for k in range(0, 800, 40)]
    early = [cut_rows(controller, k, k + 70) for k in range(0, 840, 70)]
    logged.make_screen([*late[:7], *early, *late[7:]])
    chunks = logged.list_chunks()["/torque_error/true"]
    order = np.argsort(np.concatenate([chunk["rig_time"].to_numpy() for chunk in chunks]))
    error = np.concatenate(list_cells(chunks, "Scalars:scalars"))[order]
    followed = np.isfinite(error)
    wanted = plant["truth_clutch_torque_nm"][:800] - controller["controller_torque_demand_nm"][:800]
    assert np.array_equal(error[followed], wanted[followed])
    assert followed.sum() > 300


def test_there_is_an_error_once_the_plates_have_slid_for_a_while(nodes: dict[str, Batch], logged: Logged) -> None:
    logged.make_screen(cut_pieces(nodes))
    error = np.concatenate(list_cells(logged.list_chunks()["/torque_error/estimate"], "Scalars:scalars"))
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
    for name, turned_round in (("there", nodes), ("back", {node: negate(nodes[node], signed) for node in nodes})):
        logged = Logged(tmp_path / f"{name}.rrd")
        logged.make_screen(cut_pieces(turned_round, size))
        chunks = logged.list_chunks()
        paths = ("/torque/demand", "/torque_error/true", "/torque_error/estimate")
        drawn.append([np.concatenate(list_cells(chunks[path], "Scalars:scalars")) for path in paths])
    there, back = drawn
    assert np.array_equal(there[0], nodes["controller"]["controller_torque_demand_nm"])
    assert np.array_equal(back[0], -there[0])
    for error, error_back in zip(there[1:], back[1:], strict=True):
        assert np.array_equal(error, error_back, equal_nan=True)


def test_an_estimate_of_the_wrong_sign_has_an_error(nodes: dict[str, Batch], logged: Logged) -> None:
    wrong = {node: negate(nodes[node], ("controller_torque_estimate_nm",)) for node in nodes}
    logged.make_screen(cut_pieces(wrong))
    error = np.concatenate(list_cells(logged.list_chunks()["/torque_error/estimate"], "Scalars:scalars"))
    assert np.nanmax(error) < -9.0  # Nm: 5 Nm of demand and as much torque the other way


def test_a_change_of_a_parameter_is_told(nodes: dict[str, Batch], logged: Logged) -> None:
    screen = logged.make_screen(cut_pieces(nodes))
    event = {"node": "controller", "name": "torque.integral_gain", "old": 0.1, "new": 0.2, "unit": "bar/Nm", "row": 5}
    screen.log_event(event | {"time": EPOCH + 100.5})
    chunks = logged.list_chunks()["/events"]
    assert ["controller: torque.integral_gain 0.1 -> 0.2 bar/Nm"] in list_cells(chunks, "TextLog:text")
    assert EPOCH + 100.5 in list_times(chunks, "time")


def test_opened_again_it_names_everything_again(nodes: dict[str, Batch], logged: Logged) -> None:
    screen = logged.make_screen(cut_pieces(nodes, 1000))
    screen.open()
    screen.log(cut_rows(nodes["plant"], 0, 10, session=2))
    logged.list_chunks()
    static: Counter[str] = Counter()
    for chunk in rerun.chunk.RrdReader(logged.path).stream():
        static[chunk.entity_path] += chunk.to_record_batch().num_rows if chunk.is_static else 0
    assert static["/torque/plant"] == 2
    assert static["/scene/a/oil"] == 2


def test_rows_are_cheap(nodes: dict[str, Batch], logged: Logged) -> None:
    screen = logged.make_screen(cut_pieces(nodes, 500))
    for node, batch in nodes.items():
        costs = []
        for begin in range(0, 1000, 20):
            piece = cut_rows(batch, begin, begin + 20)
            before = time.thread_time()
            screen.log(piece)
            costs.append(time.thread_time() - before)
        assert np.median(costs) < COST, node
