"""Foreign files: kind of a file that is no recording of a known format, and how to get its data."""

import re

# What to do about frames of a bus of unknown meaning
NEEDS_DATABASE = (
    'name their database with --map: a map with dbc = "FILE.dbc" in [file], which --list and --draft take, too'
)
_TEXT = "save its data as CSV"
_SHEET = "save its data as .xlsx without a password, or as CSV"
# Pattern of the first bytes -> kind of file, and remedy
_KINDS: tuple[tuple[bytes, str, str], ...] = (
    (rb"7z\xbc\xaf|Rar!|MSCF|PK\x05\x06|PK\x07\x08|\x1f\x9d|\x04\x22\x4d\x18|\xff\x06\0\0sNaPpY", "an archive", "unpack it"),
    # By the first file of the archive: one of other files may have a workbook among them
    (rb"PK\x03\x04.{26}mimetype.{0,60}opendocument", "a file of OpenDocument, such as .ods", _SHEET),
    (rb"PK\x03\x04.{26}(\[Content_Types\]|_rels/|xl/|docProps/)", "a file of Office that is no .xlsx, such as .xlsb", _SHEET),
    (rb"PK\x03\x04.{26,200}\.npy", "an archive of NumPy", "write its arrays into a CSV, Parquet or .mat file"),
    (rb"CDF[\x01\x02\x05]", "netCDF 3", "convert it to netCDF 4 by nccopy -k 4"),
    (rb".{257}ustar", "an archive of tar", "unpack it"),
    (rb"\xd0\xcf\x11\xe0", "a file of an older Office (.xls), or one with a password", _SHEET),
    (rb"\x93NUMPY", "an array of NumPy", "write it into a CSV, Parquet or .mat file"),
    (rb"\x80[\x02-\x05](c|\x95|\}|\]|K)", "a pickle of Python", "write its data into a CSV, Parquet or .mat file"),
    (rb"RIFF|fLaC|OggS", "a sound or a film", _TEXT),
    (rb"SQLite format 3", "a database of SQLite", _TEXT),
    (rb"%PDF|\x89PNG|\xff\xd8\xff|GIF8", "a document or a picture", "take the file with its data"),
    (rb"\|CF,", "a file of imc FAMOS", "save its channels as CSV, MDF or TDMS"),
    (rb"(\xef\xbb\xbf)?\s*(<\?xml.{0,500})?<usi:tdm", "the header of a TDM file", "save its channels as TDMS"),
    (rb"(\xef\xbb\xbf)?\s*<(\?xml|!(?i:doctype)|(?i:html)|!--)", "XML or HTML", _TEXT),
    (rb"\xd4\xc3\xb2\xa1|\xa1\xb2\xc3\xd4|\x4d\x3c\xb2\xa1|\n\r\r\n", "a capture of packets",
     "save its frames by candump -l"),
    (rb"DIAEXTENDED", "the header of a DAT file of DIAdem", "save its channels as TDMS"),
    (rb"\*\*\*BUSMASTER", "a log of BUSMASTER", "save its frames as ASC"),
    (rb"(\xef\xbb\xbf)?Kvaser Memorator Log", "a log of Kvaser in CSV", "save its frames as ASC or BLF"),
    (rb"# Logger type: CL[0-9]", "a log of CSS Electronics in text", "convert it to ASC or MF4 with the maker's tool"),
    (rb"\s*Chn\s+Identifier\s+Flg", "a log of Kvaser CanKing", "save its frames as ASC or BLF"),
    (rb"[0-9]+\.[0-9]+ [0-9]?[RT](11|29) [0-9A-Fa-f]+ ", "a log of OVMS (CRTD)", "save its frames as candump"),
    (rb"#ROSBAG|\x89MCAP", "a bag of ROS", "write its topics into CSV or Parquet"),
    (rb"\s*\([0-9]+\.[0-9]+\)\s+\S+\s+[0-9A-Fa-f]{3,8}(#[0-9A-Fa-f]{2}[.`]|\s+\[[0-9]{1,2}\]\s+([0-9A-F]{2}`|[01]{8}\b))",
     "a log of candump with its bytes reversed (-S), as bits (-i) or with points between them", "record it with candump -L"),
    (rb".{0,20}WAVEDESC", "a binary waveform of LeCroy or Teledyne", "save it as ASCII or CSV"),
    (rb"AG(01|10|03)", "a binary waveform of Keysight", "save it as CSV"),
    (rb":?(WFMP|CURV)[A-Z]*:", "a waveform of Tektronix (.isf)", "save it as CSV"),
    (rb"WFM#|\x0f\x0f:WFM#|\xf0\xf0:WFM#", "a binary waveform of Tektronix", "save it as CSV"),
    (rb"[A-Za-z_][^\s,=]*(,[^\s,=]+=[^\s,=]+)* [^\s=,\"]+=(\"[^\"\n]*\"|[^\s,\"]+)(,[^\n]{0,2000})? [0-9]{10,19}\s*\n",
     "line protocol of InfluxDB", "export its fields as CSV, a column each"),
    (rb"RRF[0-9]", "a recording of rerun", "take the run file that was recorded beside it"),
    (rb"([^\n]{0,300}\n){0,20}(?=[^\n]{0,200}\b(ID|Identifier|(CAN|Arb)[ _]?ID)\b)"
     rb"(?=[^\n]{0,300}\b(DLC|LEN|Remote|IDE|Data[ _]?Length)\b)[^\n]{0,300}\b(Data|D|B)[ _]?([01]|Bytes)?\b",
     "a table of the frames of a bus", "save its frames as ASC, BLF or candump"),
)  # fmt: skip


def describe_foreign(head: bytes) -> str:
    """Return the kind of a file that begins with `head`, and the remedy; "" if it is unknown."""
    for pattern, what, remedy in _KINDS:
        if re.match(pattern, head, re.DOTALL):
            return f"{what}: {remedy}"
    return ""
