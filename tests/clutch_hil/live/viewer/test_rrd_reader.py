"""A recording of a screen read back: equal rows, in order, and files that are refused."""

from pathlib import Path

import numpy as np
import pytest
import rerun as rr
import rerun.chunk

from clutch_hil.live.viewer.rrd_reader import read_rrd
from protocols.errors import InputError
from protocols.telemetry.batch import Batch
from tests.clutch_hil.live.viewer.screen_recording import RATE, Logged, cut_pieces, cut_rows


def test_values_read_back_are_equal(nodes: dict[str, Batch], logged: Logged) -> None:
    logged.make_screen(cut_pieces(nodes))
    logged.list_chunks()
    tables = read_rrd(logged.path)
    assert set(tables) == {"plant", "controller"}
    for node, batch in nodes.items():
        table = tables[node]
        assert [(c.name, c.unit) for c in table.columns] == [(c.name, c.unit) for c in batch.columns]
        assert np.array_equal(table.row, np.arange(len(batch.rows)))
        assert np.array_equal(table.rows, batch.rows, equal_nan=True)
        assert table.rate == RATE


def test_rows_come_back_in_order_however_they_came(nodes: dict[str, Batch], logged: Logged) -> None:
    pieces = list(cut_pieces(nodes, 130))
    logged.make_screen(pieces[::-1])
    logged.list_chunks()
    assert np.array_equal(read_rrd(logged.path)["plant"].rows, nodes["plant"].rows)


def test_a_gap_is_two_batches(nodes: dict[str, Batch], logged: Logged) -> None:
    plant = nodes["plant"]
    logged.make_screen([cut_rows(plant, 0, 100), cut_rows(plant, 300, 400)])
    logged.list_chunks()
    first, second = read_rrd(logged.path)["plant"].make_batches()
    assert (first.first_row, first.end, second.first_row, second.end) == (0, 100, 300, 400)
    assert np.array_equal(second.rows, plant.rows[300:400])


def test_a_second_life_of_a_service_follows_the_first(nodes: dict[str, Batch], logged: Logged) -> None:
    plant = nodes["plant"]
    later = plant.rows[:100].copy()
    later[:, -2] += 10.0  # s on the clock
    logged.make_screen([cut_rows(plant, 0, 200), cut_rows(plant, 0, 100, session=2, rows=later)])
    logged.list_chunks()
    first, second = read_rrd(logged.path)["plant"].make_batches()
    assert (len(first.rows), len(second.rows)) == (200, 100)
    assert second.session > first.session


def test_a_cut_off_file_is_named(nodes: dict[str, Batch], logged: Logged) -> None:
    logged.make_screen(cut_pieces(nodes, 500))
    logged.list_chunks()
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
    with pytest.raises(InputError, match="contains no rows of a bench"):
        read_rrd(tmp_path / "other.rrd")
