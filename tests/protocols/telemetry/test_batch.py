"""Batches: what is on the wire says what it is."""

import random
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from protocols.errors import InputError
from protocols.node import Column
from protocols.telemetry.batch import BatchEncoder, decode, list_run_columns
from protocols.telemetry.keys import Keys, find_bus, make_bench_name, parse_key

COLUMNS = (
    Column("time_s", "s", "time"), Column("truth_clutch_torque_nm", "Nm", "M"), Column("plant_clock_s", "s", "clock"),
)  # fmt: skip
ROWS = np.array([[0.001, np.nan, 5.1], [0.002, -np.inf, 5.1], [0.003, 1.0 / 3.0, 5.2]])
GOOD = {"node": "plant", "session": 7, "rate": 1000.0, "epoch": 1.5e9, "columns": COLUMNS}


def encode(first: int = 41, lost: int = 3, rows: np.ndarray = ROWS, **changed: Any) -> bytes:
    return BatchEncoder(**GOOD | changed).encode(first, rows, lost)


def test_a_batch_comes_back_to_the_bit() -> None:
    batch = decode(encode(), "plant")
    assert (batch.node, batch.session, batch.first_row, batch.end) == ("plant", 7, 41, 44)
    assert (batch.rate, batch.epoch, batch.rows_lost) == (1000.0, 1.5e9, 3)
    assert batch.rows.tobytes() == ROWS.tobytes()
    np.testing.assert_array_equal(batch["truth_clutch_torque_nm"], ROWS[:, 1])


def test_any_arrow_reader_finds_names_units_and_origin() -> None:
    table = pa.ipc.open_stream(encode()).read_all()
    assert table.column_names == ["time_s", "truth_clutch_torque_nm", "plant_clock_s"]
    assert table.schema.field("truth_clutch_torque_nm").metadata == {b"unit": b"Nm"}
    assert table.schema.metadata[b"node"] == b"plant"
    assert table.schema.metadata[b"first_row"] == b"41"


def test_the_part_after_a_row() -> None:
    batch = decode(encode(), "plant")
    assert [batch.cut_before(row).first_row for row in (0, 41, 43, 44, 99)] == [41, 41, 43, 44, 44]
    assert [len(batch.cut_before(row).rows) for row in (0, 41, 43, 44, 99)] == [3, 3, 1, 0, 0]


@pytest.mark.parametrize("payload", [b"", b"junk", encode()[:40], encode()[:-200], b"\xff" * 500])
def test_what_is_no_batch_is_refused(payload: bytes) -> None:
    with pytest.raises(InputError, match="a telemetry message is invalid or of another version"):
        decode(payload, "plant")


@pytest.mark.parametrize(
    ("payload", "words"),
    [
        (encode(node="controller"), "telemetry of the controller was sent under the name of the plant"),
        (encode(columns=COLUMNS[:2], rows=ROWS[:, :2]), "lacks the column plant_clock_s"),
        (encode(columns=(*COLUMNS, COLUMNS[1]), rows=ROWS[:, [0, 1, 2, 1]]), "has a column twice"),
        (encode(rate=0.0), "has the rate 0"),
        (encode(rate=np.nan), "has the rate nan"),
        (encode(rate=np.inf), "has the rate inf"),
        (encode(epoch=-np.inf), "has the epoch -inf"),
        (encode(epoch=1e10), "has the epoch 10000000000.0; allowed are 0 to 9e"),
        (encode(first=-1), "has the first row -1"),
        (encode(first=10**30), "has the first row 1000"),
        (encode(session=10**4000), "has the session"),
        (encode(lost=-5), "has the rows lost -5"),
        (encode(rows=ROWS[::-1]), "goes back"),
        (encode(rows=ROWS * np.nan), "is not a number"),
        (b"\0" * (65 << 20), "allowed are 67108864"),
    ],
)
def test_a_batch_that_cannot_be_true_is_refused(payload: bytes, words: str) -> None:
    with pytest.raises(InputError, match=words):
        decode(payload, "plant")


def test_whatever_bytes_come_it_is_a_batch_or_one_sentence() -> None:
    chance = random.Random(1)
    good, refused = encode(), 0
    for _ in range(3000):
        damaged = bytearray(good)
        for _ in range(chance.choice([1, 1, 3, 10])):
            damaged[chance.randrange(len(damaged))] = chance.randrange(256)
        try:
            decode(bytes(damaged), "plant")
        except InputError:
            refused += 1
    assert 1000 < refused < 3000


def test_the_controllers_terms_are_called_as_in_a_run_file() -> None:
    assert list_run_columns("controller", COLUMNS)[0].name == "controller_time_s"
    assert list_run_columns("plant", COLUMNS) == COLUMNS


def test_keys_name_bench_and_node(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CLUTCH_HIL_BUS_DIR", raising=False)
    name = make_bench_name("local:clutch")
    assert find_bus(name) == "local:clutch"
    assert parse_key(Keys(name, "plant").record) == Keys(name, "plant")
    assert Keys(name, "plant").record == f"clutch-hil/{name}/plant/record"
    with pytest.raises(AttributeError):
        Keys(name, "plant").nothing  # noqa: B018


def test_local_buses_in_two_folders_are_two_benches(monkeypatch: pytest.MonkeyPatch) -> None:
    names = set()
    for folder in ("/a", "/b"):
        monkeypatch.setenv("CLUTCH_HIL_BUS_DIR", folder)
        names.add(make_bench_name("local:clutch"))
    assert len(names) == 2
    assert "local:clutch" not in {find_bus(name) for name in names}  # that is the one in the usual folder
