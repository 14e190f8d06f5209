"""Two clutches on one bus: their frames, the DBC of both, and what fits on a bus."""

import json
from itertools import pairwise
from pathlib import Path

import cantools.database
import pytest

from protocols.can.bus_load import compute_bus_load
from protocols.can.frames import DBC, list_bus_frames, load_frames
from protocols.can.two_clutches import SHARED, load_two_clutch_database, write_dbc_text
from protocols.errors import InputError
from protocols.node import Column
from protocols.telemetry.batch import list_run_columns
from tests.processes import play_here

A, B = load_frames(clutch="a"), load_frames(clutch="b")
RATE = 500  # Hz, at which the power-shift rig is played


def test_frames_of_the_two_clutches_differ_but_for_what_there_is_once() -> None:
    assert {name for name in A if A[name].can_id == B[name].can_id} == set(SHARED)
    assert {B[name].can_id - A[name].can_id for name in A if name not in SHARED} == {0x008}
    assert len(list_bus_frames(clutches=2)) == len(A) + len(B) - len(SHARED)
    assert A["VALVE_COMMAND"].can_id == load_frames()["VALVE_COMMAND"].can_id


def test_priorities_stay_by_kind() -> None:
    order = [codec.name.removesuffix("_B") for codec in list_bus_frames(clutches=2)]
    kinds = (
        "VALVE_COMMAND",
        "MOTOR_COMMAND",
        "ENCODER",
        "TORQUE_SETPOINT",
        "CONTROLLER_STATUS",
        "CONTROLLER_HEARTBEAT",
    )
    places = [[i for i, name in enumerate(order) if name == kind] for kind in kinds]
    assert all(max(before) < min(after) for before, after in pairwise(places))


def test_payloads_of_both_clutches_are_alike() -> None:
    of_a, of_b = (frames["ENCODER"].pack(3, shaft_angle=1.5, sample_tick=7) for frames in (A, B))
    assert of_a[2:] == of_b[2:]
    assert of_a[:2] != of_b[:2], "the data ID is another"
    assert not A["ENCODER"].is_valid(of_b)


def test_other_tools_read_the_bus_of_two_clutches(tmp_path: Path) -> None:
    (tmp_path / "two.dbc").write_text(write_dbc_text(DBC, 2), encoding="utf-8")
    read = cantools.database.load_file(tmp_path / "two.dbc")
    made = load_two_clutch_database(DBC)
    assert [m.frame_id for m in read.messages] == [codec.can_id for codec in list_bus_frames(clutches=2)]
    for message, expected in zip(read.messages, made.messages, strict=True):
        for field in ("name", "length", "senders", "cycle_time", "comment"):
            assert getattr(message, field) == getattr(expected, field), (message.name, field)
        for signal, wanted in zip(message.signals, expected.signals, strict=True):
            for field in ("name", "start", "length", "is_signed", "scale", "offset", "unit", "choices", "receivers"):
                assert getattr(signal, field) == getattr(wanted, field), (message.name, signal.name, field)
    assert read.get_message_by_name("VALVE_COMMAND_B").senders == ["CONTROLLER_B"]
    assert "CONTROLLER_B" in read.get_message_by_name("PLANT_HEARTBEAT").signals[0].receivers
    assert read.get_message_by_name("MOTOR_COMMAND").senders == ["CONTROLLER"]
    codec = B["TORQUE_SETPOINT"]
    data = codec.pack(5, 1, 12.5, 20.0, 0.0)
    assert read.decode_message(codec.can_id, data)["TORQUE_DEMAND"] == pytest.approx(12.5)


def test_a_dbc_without_room_for_clutch_b_is_refused(tmp_path: Path) -> None:
    narrow = tmp_path / "narrow.dbc"
    narrow.write_text(DBC.read_text(encoding="utf-8").replace(" 144 ", " 136 "))
    with pytest.raises(InputError, match="VALVE_COMMAND_B would have 0x088, which is MOTOR_COMMAND"):
        load_two_clutch_database(narrow)


def test_the_command_tells_the_load_and_writes_the_dbc(tmp_path: Path) -> None:
    dbc = tmp_path / "two.dbc"
    done = play_here("frames", "--clutches", "2", "--rate", "1000", "--write", dbc, "--json")
    sentence = json.loads(done.stdout)
    assert sentence["load"]["1000000"] == compute_bus_load(list_bus_frames(clutches=2), 1000, 1_000_000) > 1.0
    assert sentence["fits"] == []
    assert sentence["wrote"] == str(dbc)
    assert len(cantools.database.load_file(dbc).messages) == len(sentence["frames"])
    assert compute_bus_load(list_bus_frames(clutches=2), RATE, 1_000_000) < 0.65


def test_a_dbc_that_has_the_frames_of_both_clutches_is_read_as_it_was_written(tmp_path: Path) -> None:
    one, two, again = play_here("frames", "--clutches", "2", "--json"), tmp_path / "two.dbc", tmp_path / "again.dbc"
    play_here("frames", "--clutches", "2", "--write", two)
    done = play_here("frames", "--clutches", "2", "--dbc", two, "--write", again, "--json")
    assert done.returncode == 0, done.stderr
    assert {**json.loads(done.stdout), "wrote": None} == json.loads(one.stdout)
    assert again.read_bytes() == two.read_bytes()


def test_frames_of_clutch_b_that_are_not_as_those_of_a_are_refused(tmp_path: Path) -> None:
    odd = tmp_path / "odd.dbc"
    text = write_dbc_text(DBC, 2)
    place = load_two_clutch_database(DBC).get_message_by_name("VALVE_COMMAND_B").frame_id
    odd.write_text(text.replace(f" {place} ", f" {place + 4} "), encoding="utf-8")
    with pytest.raises(
        InputError, match="frame VALVE_COMMAND_B is not as VALVE_COMMAND; for clutch b it needs the same signals"
    ):
        list_bus_frames(odd, 2)


def test_terms_of_clutch_b_keep_their_own_names_in_telemetry() -> None:
    phase = [Column("phase", "1", "")]
    assert list_run_columns("controller", phase)[0].name == "controller_phase"
    assert list_run_columns("controller_b", phase)[0].name == "controller_b_phase"


def test_clutch_c_does_not_exist() -> None:
    with pytest.raises(InputError, match="clutch 'c' is unknown; allowed are a, b"):
        load_frames(clutch="c")
