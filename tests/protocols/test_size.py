"""A database of a bench of another size: what it carries, what it must leave as it is, and how a process finds it."""

import os
from math import inf, nan
from pathlib import Path

import pytest

from protocols.can.database import read_database
from protocols.can.frames import load_frames
from protocols.can.size import (
    DATABASE,
    PRESSURES,
    SENSOR_TORQUE,
    SHIPPED,
    SPEED,
    SPEEDS,
    TORQUES,
    Size,
    compute_key,
    find_database,
    read_guard_values,
    read_size,
    write_sized_text,
)
from protocols.errors import InputError

TEXT = write_sized_text(300.0, 100.0, 25.0)
KEY = compute_key(Size(6.0, 100.0 / SPEED, 2.5))


def write(folder: Path, *changes: tuple[str, str]) -> Path:
    """A database of 300 Nm, 100 rad/s and 25 bar with each text of `changes`, which it has once, replaced by the other."""
    text = TEXT
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = folder / "own.dbc"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_shipped_bench_has_the_size_one() -> None:
    assert read_size(SHIPPED) == Size(1.0, 1.0, 1.0)
    shipped = {"motor_range": 65.536, "pressure_range": 10.0, "data_key": 0.0}
    assert read_guard_values(SHIPPED) == pytest.approx(shipped)


def test_a_bench_of_the_shipped_size_has_the_shipped_frames(tmp_path: Path) -> None:
    path = tmp_path / "same.dbc"
    path.write_text(write_sized_text(SENSOR_TORQUE, SPEED), encoding="utf-8")
    assert path.read_text().splitlines() == SHIPPED.read_text().splitlines()


def test_a_larger_bench_carries_more_by_the_same_bits(tmp_path: Path) -> None:
    path = write(tmp_path)
    assert read_size(path) == (pytest.approx(6.0), pytest.approx(100.0 / SPEED), pytest.approx(2.5))
    values = {"motor_range": 6.0 * 65.536, "pressure_range": 25.0, "data_key": KEY}
    assert read_guard_values(path) == pytest.approx(values)
    own = load_frames(path)
    for name, shipped in load_frames(SHIPPED).items():
        for signal in shipped.signals:
            full = (name, signal.upper())
            ratio = 6.0 if full in TORQUES else 100.0 / SPEED if full in SPEEDS else 2.5 if full in PRESSURES else 1.0
            assert own[name].scale[signal] == pytest.approx(ratio * shipped.scale[signal], rel=1e-12), full
            assert own[name].bits[signal] == shipped.bits[signal]
    payload = own["TORQUE_SETPOINT"].pack(1, request=1, torque_demand=120.0, speed_demand=-90.0)
    assert own["TORQUE_SETPOINT"].unpack(payload)[1:3] == (
        pytest.approx(120.0, abs=0.03),
        pytest.approx(-90.0, abs=0.004),
    )
    comments = {s.name: s.comment for m in read_database(path).messages for s in m.signals if s.comment}
    assert comments["MOTOR_TORQUE"] == "12 bit, 0.0333333 V/Nm."
    assert comments["CYLINDER_PRESSURE"] == "12 bit, 0.4 V/bar."


@pytest.mark.parametrize("torque", [49.9, 0.0, -300.0, 3501.0, nan, inf])
def test_torques_that_no_bench_has_are_refused(torque: float) -> None:
    with pytest.raises(InputError, match="Nm is not possible; allowed torques are 50 to 3500 Nm"):
        write_sized_text(torque, 40.0)


def test_who_asks_for_less_than_the_shipped_frames_carry_is_told_that_they_do() -> None:
    with pytest.raises(InputError, match=r"to 3500 Nm; for a smaller rig use 50 Nm$"):
        write_sized_text(8.0)


@pytest.mark.parametrize("speed", [32.0, 1001.0, nan])
def test_speeds_that_no_bench_has_are_refused(speed: float) -> None:
    with pytest.raises(InputError, match=r"1000 rad/s; 3000 1/min are 314\.2 rad/s$"):
        write_sized_text(speed=3000.0)
    with pytest.raises(InputError, match=r"allowed speeds are 32\.768 to 1000 rad/s$"):
        write_sized_text(speed=9600.0)
    with pytest.raises(InputError, match=r"rad/s is not possible; allowed speeds are 32\.768 to 1000 rad/s"):
        write_sized_text(60.0, speed)


@pytest.mark.parametrize("pressure", [9.9, 0.0, -25.0, 61.0, nan, inf])
def test_pressures_that_no_bench_has_are_refused(pressure: float) -> None:
    with pytest.raises(InputError, match=r"bar is not possible; allowed pressures are 10 to 60 bar"):
        write_sized_text(pressure=pressure)


def test_each_size_has_data_ids_of_its_own(tmp_path: Path) -> None:
    shipped = {name: codec.data_id for name, codec in load_frames(SHIPPED).items()}
    keys = {0}
    for torque, speed, pressure in (
        (300.0, SPEED, 10.0),
        (50.0, 100.0, 10.0),
        (50.0, SPEED, 25.0),
        (300.0, 100.0, 25.0),
    ):
        path = tmp_path / f"{torque}_{speed}_{pressure}.dbc"
        path.write_text(write_sized_text(torque, speed, pressure), encoding="utf-8")
        key = compute_key(read_size(path))
        keys.add(key)
        own = {name: codec.data_id for name, codec in load_frames(path).items()}
        assert own == {name: number ^ key for name, number in shipped.items()}
        assert not {*own.values()} & {*shipped.values()}
        of_b = {name: codec.data_id for name, codec in load_frames(path, "b").items() if codec.name.endswith("_B")}
        assert of_b == {name: own[name] + 8 for name in of_b}
    assert len(keys) == 5


def test_a_key_is_that_of_the_ratios_as_a_database_rounds_them() -> None:
    for torque in (51.3, 77.7, 123.456, 1999.9):
        ratio = torque / SENSOR_TORQUE
        assert compute_key(Size(ratio)) == compute_key(Size(ratio * (1.0 + 1e-10))) != 0
    assert compute_key(Size(1.0 + 1e-10)) == 0


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ((("(0.006,0)", "(0.005,0)"),), "MOTOR_COMMAND.TORQUE_LIMIT has the factor 0.005; allowed is 0.006"),
        ((("(0.01220703125,0)", "(0.009765625,0)"),), "TORQUE_SETPOINT.PRESSURE_DEMAND has the factor 0.0125; allowed is 0.01"),
        ((("(0.09765625,0)", "(0.1,0)"),), "ANALOG_SENSORS.OIL_TEMPERATURE has the factor 0.1; allowed is 0.09765625"),
        (((f'BO_ 256 {0xC100 ^ KEY};', f'BO_ 256 {0xC100};'),), f"which are ANALOG_SENSORS {0xC100 ^ KEY}"),
        ((("TORQUE_ESTIMATE : 32|16@1-", "TORQUE_ESTIMATE : 32|15@1-"),), "STATUS.TORQUE_ESTIMATE has another position"),
        ((('BA_ "GenMsgCycleTime" BO_ 384 1;', 'BA_ "GenMsgCycleTime" BO_ 384 2;'),), "frame TORQUE_SETPOINT has another"),
        (
            (("SG_ STICKING :", "SG_ STUCK :"), ("SG_ 768 STICKING", "SG_ 768 STUCK")),
            "frame CONTROLLER_STATUS lacks the signal STICKING",
        ),
        ((("BO_ 769 PLANT_STATUS", "BO_ 769 OTHER_STATUS"),), "it lacks the frame PLANT_STATUS"),
    ],
)  # fmt: skip
def test_what_is_not_of_the_size_must_be_as_shipped(
    tmp_path: Path, changes: tuple[tuple[str, str], ...], sentence: str
) -> None:
    path = write(tmp_path, *changes)
    with pytest.raises(InputError) as refused:
        read_size(path)
    assert sentence in str(refused.value)
    assert str(path) in str(refused.value)


def test_a_smaller_bench_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "small.dbc"
    text = SHIPPED.read_text()
    for signal, factor in (("TORQUE_LIMIT", "0.001"), ("CLUTCH_TORQUE", "0.00152587890625"), ("MOTOR_TORQUE", "0.0244140625"),
                           ("TORQUE_DEMAND", "0.01"), ("TORQUE_ESTIMATE", "0.002")):  # fmt: skip
        before, line, after = text.partition(f"SG_ {signal} :")
        text = before + line + after.replace(f"({factor},0)", f"({0.5 * float(factor)!r},0)", 1)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"its torques are 0\.5 times the shipped ones; allowed are 1 to 70"):
        read_size(path)


def test_a_process_finds_it_by_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(DATABASE, raising=False)
    assert find_database() == SHIPPED
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(DATABASE, "own.dbc")
    assert find_database() == tmp_path / "own.dbc"
    assert os.environ[DATABASE] == str(tmp_path / "own.dbc")  # for processes that it starts elsewhere
