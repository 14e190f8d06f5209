"""Batches: what is on the wire says what it is."""

import numpy as np
import pyarrow as pa
import pytest

from protocols.errors import InputError
from protocols.node import Column
from protocols.telemetry.batch import BatchEncoder, decode, run_file_columns
from protocols.telemetry.keys import Keys, bench_name, bus_of, parse_key

COLUMNS = (Column("time_s", "s", "time"), Column("truth_clutch_torque_nm", "Nm", "M"))
ROWS = np.array([[0.001, np.nan], [0.002, -np.inf], [0.003, 1.0 / 3.0]])


def encode() -> bytes:
    return BatchEncoder("plant", 7, 1000.0, 1.5e9, COLUMNS).encode(41, ROWS, 3)


def test_a_batch_comes_back_to_the_bit() -> None:
    batch = decode(encode())
    assert (batch.node, batch.session, batch.first_row, batch.end) == ("plant", 7, 41, 44)
    assert (batch.rate, batch.epoch, batch.rows_lost) == (1000.0, 1.5e9, 3)
    assert batch.rows.tobytes() == ROWS.tobytes()
    np.testing.assert_array_equal(batch["truth_clutch_torque_nm"], ROWS[:, 1])


def test_any_arrow_reader_finds_names_units_and_origin() -> None:
    table = pa.ipc.open_stream(encode()).read_all()
    assert table.column_names == ["time_s", "truth_clutch_torque_nm"]
    assert table.schema.field("truth_clutch_torque_nm").metadata == {b"unit": b"Nm"}
    assert table.schema.metadata[b"node"] == b"plant"
    assert table.schema.metadata[b"first_row"] == b"41"


def test_the_part_after_a_row() -> None:
    batch = decode(encode())
    assert [batch.after(row).first_row for row in (0, 41, 43, 44, 99)] == [41, 41, 43, 44, 44]
    assert [len(batch.after(row).rows) for row in (0, 41, 43, 44, 99)] == [3, 3, 1, 0, 0]


@pytest.mark.parametrize("payload", [b"", b"junk", encode()[:40]])
def test_what_is_no_batch_is_refused(payload: bytes) -> None:
    with pytest.raises(InputError, match="telemetry of another version came"):
        decode(payload)


def test_the_controllers_terms_are_called_as_in_a_run_file() -> None:
    assert run_file_columns("controller", COLUMNS)[0].name == "controller_time_s"
    assert run_file_columns("plant", COLUMNS) == COLUMNS


def test_keys_name_bench_and_node(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CLUTCH_HIL_BUS_DIR", raising=False)
    name = bench_name("local:clutch")
    assert bus_of(name) == "local:clutch"
    assert parse_key(Keys(name, "plant").record) == Keys(name, "plant")
    assert Keys(name, "plant").record == f"clutch-hil/{name}/plant/record"
    with pytest.raises(AttributeError):
        Keys(name, "plant").nothing  # noqa: B018


def test_local_buses_in_two_folders_are_two_benches(monkeypatch: pytest.MonkeyPatch) -> None:
    names = set()
    for folder in ("/a", "/b"):
        monkeypatch.setenv("CLUTCH_HIL_BUS_DIR", folder)
        names.add(bench_name("local:clutch"))
    assert len(names) == 2
    assert "local:clutch" not in {bus_of(name) for name in names}  # that is the one in the usual folder
