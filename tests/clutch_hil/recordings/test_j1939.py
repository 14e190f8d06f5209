"""J1939: messages are known by their parameter group; errors and what is not available are no values."""

import struct
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.channel import choose_channel
from clutch_hil.recordings.contents import draft_map
from clutch_hil.recordings.format import open_recording
from protocols.errors import InputError
from tests.clutch_hil.recordings.bus_logs import START, make_message, write
from tests.clutch_hil.recordings.maps import import_by

# EEC1 from nobody (0xFE), as databases have it; TSC1 to the engine (0x00) from nobody; a proprietary one that is no J1939
TRUCK = """VERSION ""
BU_: TRUCK
BO_ 2364540158 EEC1: 8 TRUCK
 SG_ STATE : 0|4@1+ (1,0) [0|15] "" TRUCK
 SG_ SPEED : 24|16@1+ (0.125,0) [0|8031.875] "rpm" TRUCK
 SG_ TORQUE : 16|8@1+ (1,-125) [-125|125] "%" TRUCK
BO_ 2348810494 TSC1: 8 TRUCK
 SG_ DEMAND : 24|8@1+ (1,-125) [-125|125] "%" TRUCK
BO_ 2365519870 PLAIN: 8 TRUCK
 SG_ LEVEL : 0|8@1+ (1,0) [0|255] "V" TRUCK
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";
BA_DEF_DEF_ "VFrameFormat" "J1939PG";
BA_ "VFrameFormat" BO_ 2365519870 1;
"""
EEC1, TSC1, PLAIN = 0x0CF00400, 0x0C000003, 2365519870 & 0x1FFFFFFF


def write_truck_log(folder: Path, ids: list[int], raw: list[int], database: str = TRUCK) -> Path:
    """A log with a frame of each identifier for each raw number, in bytes 3 and 4 (and 0 to 2), and its database."""
    (folder / "truck.dbc").write_text(database)
    messages = [
        make_message(START + 0.01 * n + 0.001 * k, can_id, struct.pack("<HBHBH", number, number >> 8, number, 0, 0),
                     is_extended_id=True)
        for n, number in enumerate(raw)
        for k, can_id in enumerate(ids)
    ]  # fmt: skip
    return write(folder / "truck.log", messages)


def read(path: Path, name: str, notes: list[str] | None = None) -> list[float]:
    recording = open_recording(path, {"dbc": "truck.dbc"})
    (signal,) = recording.read([choose_channel(path, recording.channels, name)])
    if notes is not None:
        notes += recording.notes
    return [float(one) for one in signal.values]


def test_any_source_and_destination_are_the_message(tmp_path: Path) -> None:
    path = write_truck_log(tmp_path, [EEC1, TSC1], [8000, 0])
    notes: list[str] = []
    assert read(path, "EEC1.SPEED", notes) == [1000.0, 0.0]
    assert read(path, "TSC1.DEMAND") == [8000 % 256 - 125, -125.0]
    assert "frames 0xCF00400 are EEC1 by their parameter group (J1939)" in notes


def test_errors_and_not_available_are_no_value(tmp_path: Path) -> None:
    path = write_truck_log(tmp_path, [EEC1], [0xFAFF, 0xFDFF, 0xFE00, 0xFEFF, 0xFF00, 0xFFFF])
    notes: list[str] = []
    assert np.array_equal(read(path, "EEC1.SPEED", notes), [0xFAFF / 8, 0xFDFF / 8, *[np.nan] * 4], equal_nan=True)
    assert any("EEC1.SPEED: 4 samples with an error or not available" in note for note in notes)
    assert read(path, "EEC1.STATE") == [15.0, 15.0, 0.0, 15.0, 0.0, 15.0]


def test_two_senders_of_a_message_are_two_signals(tmp_path: Path) -> None:
    path = write_truck_log(tmp_path, [EEC1, EEC1 + 3], [8000, 16])
    with pytest.raises(InputError, match=r"2 columns 'EEC1.SPEED'.*EEC1@0xCF00400.SPEED.*EEC1@0xCF00403.SPEED"):
        read(path, "EEC1.SPEED")
    assert read(path, "EEC1@0xCF00403.SPEED") == [1000.0, 2.0]
    recording = open_recording(path, {"dbc": "truck.dbc"})
    assert len({channel.raster for channel in recording.channels}) == 2


def test_a_draft_of_two_senders_names_each_with_its_unit(tmp_path: Path) -> None:
    path = write_truck_log(tmp_path, [EEC1, EEC1 + 3], [8000] * 20)
    draft = draft_map(path, open_recording(path, {"dbc": "truck.dbc"}), [("dbc", "truck.dbc")])
    run = import_by(tmp_path, path, draft)
    for name in ("eec1_speed_rad_s", "eec1_speed_2_rad_s"):
        assert run[name][0] == pytest.approx(1000.0 * np.pi / 30.0)


@pytest.mark.parametrize("can_id", [PLAIN, PLAIN + 1])
def test_what_is_no_j1939_is_read_as_it_is(tmp_path: Path, can_id: int) -> None:
    path = write_truck_log(tmp_path, [can_id, EEC1], [0xFFFF, 1])
    if can_id == PLAIN:
        assert read(path, "PLAIN.LEVEL") == [255.0, 1.0]
    else:
        with pytest.raises(InputError, match=r"no column 'PLAIN\.LEVEL'"):
            read(path, "PLAIN.LEVEL")


def test_the_protocol_of_the_whole_database_counts(tmp_path: Path) -> None:
    database = TRUCK.split("BA_DEF_ BO_")[0] + 'BA_DEF_ "ProtocolType" STRING ;\nBA_ "ProtocolType" "J1939";\n'
    assert read(write_truck_log(tmp_path, [EEC1], [8000], database), "EEC1.SPEED") == [1000.0]


def test_messages_from_nobody_are_of_j1939_where_a_database_says_nothing(tmp_path: Path) -> None:
    plain = TRUCK.split("BA_DEF_ BO_")[0]
    assert np.array_equal(
        read(write_truck_log(tmp_path, [EEC1], [8000, 0xFFFF], plain), "EEC1.SPEED"), [1000.0, np.nan], equal_nan=True
    )
    of_a_node = plain.replace("2365519870 PLAIN", f"{2365519870 - 1} PLAIN")  # one message from a certain node
    with pytest.raises(InputError, match=r"0x0CF00400 that of EEC1; set j1939 = true in \[file\]"):
        read(write_truck_log(tmp_path, [EEC1], [8000], of_a_node), "EEC1.SPEED")
    not_so = plain + 'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN";\n'
    with pytest.raises(InputError, match="has no message of"):
        read(write_truck_log(tmp_path, [EEC1], [8000], not_so), "EEC1.SPEED")


@pytest.mark.parametrize("sentence", [True, False])
def test_a_map_says_whether_a_bus_is_of_j1939(tmp_path: Path, sentence: bool) -> None:
    database = TRUCK.split("BA_DEF_ BO_")[0].replace("2364540158 EEC1", "2364540159 EEC1")
    path = write_truck_log(tmp_path, [EEC1, PLAIN], [8000], database)
    recording = open_recording(path, {"dbc": "truck.dbc", "j1939": sentence})
    assert ("EEC1.SPEED" in [channel.name for channel in recording.channels]) == sentence


def test_an_identifier_of_other_bits_than_in_the_database_is_named(tmp_path: Path) -> None:
    message = 'BO_ 291 PLAIN: 8 TRUCK\n SG_ LEVEL : 0|8@1+ (1,0) [0|255] "V" TRUCK\n'
    database = TRUCK.split("BO_")[0] + message
    path = write_truck_log(tmp_path, [0x123], [1], database)
    with pytest.raises(InputError, match=r"are 0x00000123; 0x123 has 29 bits in the log and 11 in the database"):
        read(path, "PLAIN.LEVEL")


def test_an_error_frame_has_no_parameter_group(tmp_path: Path) -> None:
    database = TRUCK.split("BA_DEF_ BO_")[0].replace("2364540158 EEC1", "2364540159 EEC1")
    path = write_truck_log(tmp_path, [EEC1 | 0xFF], [8000], database)
    lines = path.read_text() + f"({START + 1:.6f}) can0 20000080#0000000000000000\n"
    path.write_text(lines)
    notes = open_recording(path, {"dbc": "truck.dbc"}).notes
    assert "left out 1 error frames" in notes
    assert not any("J1939" in note for note in notes)


def test_packets_of_several_frames_are_told_as_such(tmp_path: Path) -> None:
    longer = TRUCK.replace("BO_ 2364540158 EEC1: 8", "BO_ 2364540158 EEC1: 43")
    path = write_truck_log(tmp_path, [EEC1], [8000, 0], longer)
    with pytest.raises(InputError, match=r"with fewer than 43 bytes, as packets of several frames \(NMEA 2000"):
        open_recording(path, {"dbc": "truck.dbc"})
