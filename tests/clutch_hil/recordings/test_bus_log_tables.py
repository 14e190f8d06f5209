"""Bus logs that are tables: CSV of SavvyCAN, CSV and SQLite of python-can."""

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import can
import pytest

from protocols.errors import InputError
from protocols.files.bus_logs.bus_frames import ERROR, EXTENDED, FD, REMOTE
from protocols.files.bus_logs.bus_log import read_bus_log
from tests.clutch_hil.recordings.bus_logs import WANTED, make_bench_messages, make_message, read_frames, write

OF_EACH_KIND = [
    make_message(0.5, 0x100, b"\x01\x02"),
    make_message(0.6, 0x18FEF100, bytes(8), is_extended_id=True),
    make_message(0.7, 0x101, b"", is_remote_frame=True, dlc=4),
    make_message(0.8, 0, b"", is_error_frame=True),
    make_message(0.9, 0x102, b""),
]


def format_savvycan(messages: list[can.Message], with_direction: bool = True, end: str = ",") -> str:
    """As SavvyCAN writes it: times in whole us, an empty cell behind the data; `Dir` is missing in older versions."""
    direction = "Dir," if with_direction else ""
    lines = [f"Time Stamp,ID,Extended,{direction}Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8"]
    for m in messages:
        cells = [f"{round(1e6 * m.timestamp)}", f"{m.arbitration_id:08X}", str(m.is_extended_id).lower()]
        cells += ["Rx"] if with_direction else []
        lines.append(",".join([*cells, "0", f"{len(m.data)}", *(f"{byte:02X}" for byte in m.data)]) + end)
    return "\n".join([*lines, ""])


@pytest.mark.parametrize("with_direction", [True, False])
@pytest.mark.parametrize("end", [",", "", ",,,"])
def test_a_log_of_savvycan_is_read(tmp_path: Path, with_direction: bool, end: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(format_savvycan(make_bench_messages(), with_direction, end))
    assert read_frames(path) == WANTED
    log = read_bus_log(path)
    assert (log.kind, log.damaged, log.cut, log.channels) == ("SavvyCAN CSV", 0, "", ("0",))
    assert log.stamps[1] - log.stamps[0] == pytest.approx(1e-4, abs=1e-6)


def test_cells_behind_the_data_are_none_of_it(tmp_path: Path) -> None:
    """SavvyCAN writes eight cells, whatever the length."""
    path = tmp_path / "log.csv"
    names, row = format_savvycan([make_message(0.5, 0x2B0, b"\x1a\x02\x00")]).splitlines()
    path.write_text(f"{names}\n{row}00,00,00,00,00,\n")
    assert read_frames(path) == [(0x2B0, b"\x1a\x02\x00")]


@pytest.mark.parametrize("suffix", [".csv", ".db"])
def test_kinds_of_frames_are_those_of_python_can(tmp_path: Path, suffix: str) -> None:
    log = read_bus_log(write(tmp_path / f"log{suffix}", OF_EACH_KIND))
    assert log.flags[[0, 1, 2, 4]].tolist() == [0, EXTENDED, REMOTE, 0]
    assert log.flags[3] & ERROR
    assert log.ids[[0, 1, 2, 4]].tolist() == [0x100, 0x18FEF100, 0x101, 0x102]
    assert [log.read_data(k) for k in (0, 1, 4)] == [b"\x01\x02", bytes(8), b""]
    assert log.stamps.tolist() == [0.5, 0.6, 0.7, 0.8, 0.9]


@pytest.mark.parametrize("suffix", [".csv", ".db"])
def test_more_than_eight_bytes_are_can_fd(tmp_path: Path, suffix: str) -> None:
    message = make_message(0.5, 0x100, bytes(range(12)), is_fd=True)
    log = read_bus_log(write(tmp_path / f"log{suffix}", [message]))
    assert (log.flags.tolist(), log.read_data(0)) == ([FD], bytes(range(12)))


@pytest.mark.parametrize(
    "row",
    [
        "1,2,3", "x,00000100,false,Rx,0,1,01,", "1,00000100,false,Rx,0,3,01,", "1,00000100,false,Rx,0,1,1FF,",
        "1,00000100,false,Rx,0,1,0,1,2,3,4,5,6,7,8", "1,-0000100,false,Rx,0,1,01,", "1,00000100,false,Rx,can,1,01,",
        "1,00000800,false,Rx,0,1,01,", "1,00000100,false,Rx,0,-1,01,",
    ],
)  # fmt: skip
def test_rows_that_are_no_frames_are_counted(tmp_path: Path, row: str) -> None:
    path = tmp_path / "log.csv"
    names, *rows = format_savvycan(make_bench_messages()).splitlines()
    path.write_text("\n".join([names, *rows[:20], row, *rows[20:], ""]))
    assert read_frames(path) == WANTED
    assert read_bus_log(path).damaged == 1


@pytest.mark.parametrize(
    "row",
    [
        "0.1,0x100,0,0,0,2,AQI", "0.1,0x100,0,0,0,3,AQI=", "0.1,0x100,2,0,0,2,AQI=", "nan,0x100,0,0,0,2,AQI=",
        "0.1,x,0,0,0,2,AQI=",
        "0.1,0x100,0,0,0,2,A?I=", "0.1,0x100,0,0,0,AQI=", f"0.1,0x100,0,0,0,66,{'AAAA' * 22}",
    ],
)  # fmt: skip
def test_rows_of_python_can_that_are_no_frames_are_counted(tmp_path: Path, row: str) -> None:
    path = write(tmp_path / "log.csv", make_bench_messages())
    names, *rows = path.read_text().splitlines()
    path.write_text("\n".join([names, *rows[:20], row, *rows[20:], ""]))
    assert read_frames(path) == WANTED
    assert read_bus_log(path).damaged == 1


@pytest.mark.parametrize("make", [format_savvycan, None], ids=["SavvyCAN", "python-can"])
def test_a_log_that_ends_within_a_row_says_so(tmp_path: Path, make: Callable[[list[can.Message]], str] | None) -> None:
    path = tmp_path / "log.csv"
    if make:
        path.write_text(make(make_bench_messages()))
    else:
        write(path, make_bench_messages())
    path.write_bytes(path.read_bytes()[:-12])
    log = read_bus_log(path)
    assert log.cut == "the log ends within line 81"
    assert len(log) == len(WANTED) - 1


def change(path: Path, *statements: str) -> None:
    with closing(sqlite3.connect(path)) as database:
        for statement in statements:
            database.execute(statement)
        database.commit()


def test_a_view_of_the_name_is_not_run(tmp_path: Path) -> None:
    path = write(tmp_path / "log.db", make_bench_messages())
    endless = "WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM r) SELECT n FROM r"
    change(path, "ALTER TABLE messages RENAME TO kept", f"CREATE VIEW messages AS {endless}")
    with pytest.raises(InputError, match="without a table 'messages', as python-can writes it"):
        read_bus_log(path)


def test_a_damaged_database_is_read_as_far_as_it_is_whole(tmp_path: Path) -> None:
    path = write(tmp_path / "log.db", make_bench_messages(2000))
    content = bytearray(path.read_bytes())
    content[len(content) // 2 :] = bytes(len(content) - len(content) // 2)
    path.write_bytes(content)
    log = read_bus_log(path)
    assert 0 < len(log) < 4000
    assert "the log cannot be read after" in log.cut
    assert path.read_bytes() == content  # not changed by reading it
    assert [one.name for one in tmp_path.iterdir()] == ["log.db"]


def test_values_that_are_no_frames_are_no_frames(tmp_path: Path) -> None:
    path = write(tmp_path / "log.db", make_bench_messages())
    change(
        path,
        "UPDATE messages SET dlc = 3 WHERE rowid = 7",
        "UPDATE messages SET data = zeroblob(100000) WHERE rowid = 9",
    )
    assert read_bus_log(path).damaged == 2
