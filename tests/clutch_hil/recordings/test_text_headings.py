"""Lines above the rows of text files of tools: labels before units, units far above the names, statistics below them."""

from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.contents import draft_map
from clutch_hil.recordings.format import open_recording
from tests.clutch_hil.recordings.maps import import_by
from tests.clutch_hil.recordings.text_files import ROWS, SPEED, TIME, TORQUE

RPM = np.pi / 30.0  # rad/s

LABVIEW = """LabVIEW Measurement\t
Separator\tTab
X_Columns\tOne
***End_of_Header***\t
Channels\t2\t\t
Samples\t60\t60\t
Y_Unit_Label\tNm\trpm\t
X_Dimension\tTime\tTime\t
X0\t0.0000E+0\t0.0000E+0\t
Delta_X\t0.010000\t0.010000\t
***End_of_Header***\t\t\t
X_Value\ttorque\tspeed\tComment
"""
OSCILLOSCOPE = """Model,MSO24
Horizontal Scale,0.1
Vertical Units,Nm,rpm,
Vertical Offset,0,
Labels,Clutch,Motor,
TIME,torque,speed
"""
STATISTICS = """time;torque;speed
s;Nm;rpm
Min;0;0.5;
Maximum;1;200
Mean;0.5;100
"""
CONTROLDESK = """path;;Model Root/Clutch;Model Root/Motor
name;time;torque;speed
unit;s;Nm;rpm
trace_values
"""
CHANNELS = """Operator;speed;fast

Channel;Name;Unit
1;time;s
2;torque;Nm
3;speed;[rpm]

time;torque;speed
"""
LABELLED = "# units: s, Nm, rpm\ntime,torque,speed\n"
JAPANESE = "時間;トルク;回転数\n秒;N・m;rpm\n"
# Lines above -> mark between cells, lead of each row, names of time, torque and speed
FORMS = {
    "LabVIEW": (LABVIEW, "\t", "", ("X_Value", "torque", "speed")),
    "an oscilloscope": (OSCILLOSCOPE, ",", "", ("TIME", "torque", "speed")),
    "statistics": (STATISTICS, ";", "", ("time", "torque", "speed")),
    "ControlDesk": (CONTROLDESK, ";", ";", ("time", "torque", "speed")),
    "a list of channels": (CHANNELS, ";", "", ("time", "torque", "speed")),
    "units behind a word": (LABELLED, ",", "", ("time", "torque", "speed")),
    "Japanese": (JAPANESE, ";", "", ("時間", "トルク", "回転数")),
}


def write(tmp_path: Path, kind: str) -> tuple[Path, tuple[str, str, str]]:
    above, mark, lead, names = FORMS[kind]
    cells = zip(TIME, TORQUE, SPEED, strict=True)
    rows = [lead + mark.join(f"{value:.4f}" for value in row) for row in cells]
    path = tmp_path / "recording.csv"
    path.write_text(above + "\n".join([*rows, ""]), encoding="utf-8")
    return path, names


@pytest.mark.parametrize("kind", FORMS)
def test_names_and_units_are_found_where_tools_write_them(tmp_path: Path, kind: str) -> None:
    path, (time, torque, speed) = write(tmp_path, kind)
    columns = f"""
        [columns]
        time_s = {{ from = "{time}", unit = "s" }}
        torque_nm = {{ from = "{torque}" }}
        speed_rad_s = {{ from = "{speed}" }}
    """
    run = import_by(tmp_path, path, columns)
    assert len(run["time_s"]) == ROWS
    np.testing.assert_allclose(run["time_s"], TIME, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(run["torque_nm"], TORQUE, rtol=1e-12)
    np.testing.assert_allclose(run["speed_rad_s"], RPM * SPEED, rtol=1e-12)


@pytest.mark.parametrize("kind", [kind for kind in FORMS if kind != "LabVIEW"])  # X_Value is no name of a time
def test_a_draft_leaves_out_empty_columns_and_imports(tmp_path: Path, kind: str) -> None:
    path, _ = write(tmp_path, kind)
    draft = draft_map(path, open_recording(path))
    assert ("# left out, with no value in the first and last rows: name\n" in draft) == (kind == "ControlDesk")
    run = import_by(tmp_path, path, draft)
    np.testing.assert_allclose(run["time_s"], TIME, rtol=0.0, atol=1e-12)
