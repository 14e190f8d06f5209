"""Files of kinds that are not read: each is named, with what to do."""

import re
from pathlib import Path

import pytest

from clutch_hil.recordings.format import open_recording
from protocols.errors import InputError
from tests.clutch_hil.recordings.text_files import (
    assert_right,
    make_table,
    read,
)

FOREIGN = {
    "log.tar": (b"log.csv" + bytes(250) + b"ustar\x0000" + bytes(99), "an archive of tar: unpack it"),
    "log.7z": (b"7z\xbc\xaf\x27\x1c" + bytes(50), "an archive: unpack it"),
    "log.Z": (b"\x1f\x9d\x90" + bytes(99), "an archive: unpack it"),
    "log.lz4": (b"\x04\x22\x4d\x18" + bytes(99), "an archive: unpack it"),
    "parts.zip": (b"PK\x07\x08PK\x03\x04" + bytes(99), "an archive: unpack it"),
    "log.cab": (b"MSCF" + bytes(99), "an archive: unpack it"),
    "log.xlsb": (
        b"PK\x03\x04\x14\x00\x06\x00" + bytes(22) + b"[Content_Types].xml",
        "a file of Office that is no .xlsx, such as .xlsb: save its data as .xlsx without a password, or as CSV",
    ),
    "log.ods": (
        b"PK\x03\x04\x14\x00\x00\x08" + bytes(22) + b"mimetypeapplication/vnd.oasis.opendocument.spreadsheet",
        "a file of OpenDocument, such as .ods: save its data as .xlsx without a password, or as CSV",
    ),
    "log.xls": (
        bytes.fromhex("d0cf11e0a1b11ae1") + bytes(99),
        "a file of an older Office (.xls), or one with a password: save its data as .xlsx without a password, or as CSV",
    ),
    "log.npy": (
        b"\x93NUMPY\x01\x00v\x00{'descr': '<f8'}",
        "an array of NumPy: write it into a CSV, Parquet or .mat file",
    ),
    "log.tdm": (
        b'<?xml version="1.0"?>\n<usi:tdm version="1.0">',
        "the header of a TDM file: save its channels as TDMS",
    ),
    "log.html": (b"<!DOCTYPE html><table><tr><td>1</td></tr></table>", "XML or HTML: save its data as CSV"),
    "log.famos": (
        b"|CF,2,1,1;|CK,1,3,1,1;\r\n|NO,1,8,0,0,,0,;",
        "a file of imc FAMOS: save its channels as CSV, MDF or TDMS",
    ),
    "log.dat": (
        b"DIAEXTENDED  {@:ENGLISH\n#BEGINGLOBALHEADER\n1,WINDOWS 32Bit\n",
        "the header of a DAT file of DIAdem: save its channels as TDMS",
    ),
    "busmaster.log": (b"***BUSMASTER Ver 3.2.2***\n***PROTOCOL CAN***\n", "a log of BUSMASTER: save its frames as ASC"),
    "canking.txt": (
        b"Chn Identifier Flg   DLC  D0...1...2  Time     Dir\n 0    00000100         2  01  02       1.000000 R\n",
        "a log of Kvaser CanKing: save its frames as ASC or BLF",
    ),
    "log.crtd": (b"1520400000.000000 1R11 100 01 02\n", "a log of OVMS (CRTD): save its frames as candump"),
    "kvaser.csv": (
        b"Kvaser Memorator Log\n====\nTime,Channel,ID,Flags,DLC,Data0,Data1\n0.5,1,100,0,2,01,02\n",
        "a log of Kvaser in CSV: save its frames as ASC or BLF",
    ),
    "cl2000.txt": (
        b"# Logger type: CL2000\n# HW rev: 7.0\nTimestamp;Type;ID;Data\n05T100000010;0;100;0102\n",
        "a log of CSS Electronics in text: convert it to ASC or MF4 with the maker's tool",
    ),
    "frames.csv": (
        b"log of today\nBus,No,Time,ID,DLC,Data0,Data1\n1,1,0.01,256,2,1,2\n",
        "a table of the frames of a bus: save its frames as ASC, BLF or candump",
    ),
    "vehicle-spy.csv": (
        b"Line,Abs Time(Sec),Rel Time (Sec),Status,Network,Node,Arb ID,Remote,Xtd,B1,B2\n1,0.01,0.01,0,HS CAN,,100,F,F,1,2\n",
        "a table of the frames of a bus: save its frames as ASC, BLF or candump",
    ),
    "css.csv": (
        b"TimestampEpoch;BusChannel;ID;IDE;DLC;DataLength;Dir;EDL;BRS;ESI;RTR;DataBytes\n1.5;1;100;0;2;2;0;0;0;0;0;0102\n",
        "a table of the frames of a bus: save its frames as ASC, BLF or candump",
    ),
    "pcan.csv": (
        b"Message Number,Time Offset (ms),Type,ID,Data Length,Data Bytes\n1,1059.9,Rx,0300,2,00 01\n",
        "a table of the frames of a bus: save its frames as ASC, BLF or candump",
    ),
    "reversed.log": (
        b" (1.250000)  can0  100   [8]  88`77`66`55`44`33`22`11\n",
        "a log of candump with its bytes reversed (-S), as bits (-i) or with points between them: record it with candump -L",
    ),
    "bits.log": (
        b" (1.250000)  can0  100   [2]  00000001 11110000\n",
        "a log of candump with its bytes reversed (-S), as bits (-i) or with points between them: record it with candump -L",
    ),
    "lecroy.trc": (
        b"#9000000446WAVEDESC\0\0\0\0\0\0\0\0LECROY_2_3" + bytes(99),
        "a binary waveform of LeCroy or Teledyne: save it as ASCII or CSV",
    ),
    "scope.bin": (b"AG10" + bytes(99), "a binary waveform of Keysight: save it as CSV"),
    "scope.isf": (b":WFMP:NR_P 10000;:WFMP:BYT_N 2;", "a waveform of Tektronix (.isf): save it as CSV"),
    "influx.txt": (
        b"rig,host=a torque=1.5,speed=2i 1796000000000000000\n",
        "line protocol of InfluxDB: export its fields as CSV, a column each",
    ),
    "log.pcap": (b"\xd4\xc3\xb2\xa1\x02\x00\x04\x00", "a capture of packets: save its frames by candump -l"),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_a_file_of_another_kind_is_named_and_what_to_do(tmp_path: Path, name: str) -> None:
    content, what = FOREIGN[name]
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=f"^{re.escape(f'recording {path} cannot be read, as it is {what}')}$"):
        open_recording(path)


@pytest.mark.parametrize(
    "header",
    ["[General]\n", "[s] [Nm]\n", "<bench 7>\n", "{run 7}\n", "PKW 7\n", "BZ 1\n", "ID 7, Data 3\n", '{"dt": 0.01}\n'],
)
def test_a_line_above_the_names_is_not_taken_for_another_kind_of_file(tmp_path: Path, header: str) -> None:
    assert_right(read(tmp_path, header + make_table()))
