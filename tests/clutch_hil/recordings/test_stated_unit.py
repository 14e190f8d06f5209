"""A unit that stands somewhere in a file counts: a map that says another one must not change the numbers in silence."""

import json
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from nptdms import ChannelObject, GroupObject, TdmsWriter
from scipy.io import savemat

from clutch_hil.recordings.channel import simplify_unit
from clutch_hil.recordings.format import open_recording
from clutch_hil.recordings.stated_unit import join_units, list_unit_keys
from protocols.files.units import to_si
from tests.clutch_hil.recordings.maps import find_refusal, import_by

ROWS = 60
TIME = 0.01 * np.arange(ROWS)
TORQUE = np.sin(TIME)
NAMES, UNITS = ("time", "torque"), ("ms", "kNm")
STORED = np.column_stack([1e3 * TIME, 1e-3 * TORQUE])


def write_list(file: h5py.File) -> tuple[str, str]:
    file["data"] = STORED
    file["data"].attrs["columns"], file["data"].attrs["Units"] = NAMES, UNITS
    return NAMES


def write_one_text(file: h5py.File) -> tuple[str, str]:
    file["data"] = STORED
    file["data"].attrs["units"] = ", ".join(UNITS)
    return "data[:,0]", "data[:,1]"


def write_fields(file: h5py.File) -> tuple[str, str]:
    file["log"] = np.array([tuple(row) for row in STORED], dtype=[(name, "f8") for name in NAMES])
    file["log"].attrs["time_unit"], file["log"].attrs["FIELD_1_UNITS"] = UNITS
    return NAMES


def write_names_in_one_text(file: h5py.File) -> tuple[str, str]:
    file["data"] = STORED
    file["data"].attrs["channels"], file["data"].attrs["units"] = ", ".join(NAMES), ";".join(UNITS)
    return NAMES


def write_groups(file: h5py.File) -> tuple[str, str]:
    for name, unit, values in zip(NAMES, UNITS, STORED.T, strict=True):
        file[f"{name}/data"], file[f"{name}/unit"] = values, unit
    return "time/data", "torque/data"


def write_attributes_of_groups(file: h5py.File) -> tuple[str, str]:
    for name, unit, values in zip(NAMES, UNITS, STORED.T, strict=True):
        file[f"{name}/data"] = values
        file[name].attrs["EngineeringUnits"] = unit
    return "time/data", "torque/data"


def write_beside(file: h5py.File) -> tuple[str, str]:
    for name, unit, values in zip(NAMES, UNITS, STORED.T, strict=True):
        file[name], file[f"{name}_unit"] = values, unit
    return NAMES


def write_lists_beside(file: h5py.File) -> tuple[str, str]:
    file["run/data"], file["run/Names"], file["run/units"] = STORED, NAMES, UNITS
    return NAMES


def write_group_of_units(file: h5py.File) -> tuple[str, str]:
    for name, unit, values in zip(NAMES, UNITS, STORED.T, strict=True):
        file[f"data/{name}"], file[f"units/{name}"] = values, unit
    return NAMES


def write_hdf5(fill: Callable[[h5py.File], tuple[str, str]]) -> Callable[[Path], tuple[str, str]]:
    def write(path: Path) -> tuple[str, str]:
        with h5py.File(path, "w") as file:
            return fill(file)

    return write


def write_structures(path: Path) -> tuple[str, str]:
    channels = np.zeros((1, 2), dtype=[("Name", "O"), ("Unit", "O"), ("Values", "O")])
    for place, (name, unit, values) in enumerate(zip(NAMES, UNITS, STORED.T, strict=True)):
        channels[0, place] = (name, unit, values[:, None])
    with path.open("wb") as file:
        savemat(file, {"ch": channels})
    return NAMES


def write_units_beside(path: Path) -> tuple[str, str]:
    data = dict(zip(NAMES, STORED.T, strict=True))
    with path.open("wb") as file:
        savemat(file, {"data": data, "units": dict(zip(NAMES, UNITS, strict=True))})
    return "data.time", "data.torque"


def write_units_inside(path: Path) -> tuple[str, str]:
    data = dict(zip(NAMES, STORED.T, strict=True))
    with path.open("wb") as file:
        savemat(file, {"data": {**data, "units": dict(zip(NAMES, UNITS, strict=True))}})
    return "data.time", "data.torque"


def write_simulink(path: Path) -> tuple[str, str]:
    signal = {"values": STORED[:, 1:], "dimensions": 1.0, "label": NAMES[1], "unit": UNITS[1]}
    with path.open("wb") as file:
        savemat(file, {"scope": {"time": TIME[:, None], "signals": signal, "blockName": "model/Scope"}})
    return "scope.time", NAMES[1]


def write_simulink_vector(path: Path) -> tuple[str, str]:
    units = np.array(["rpm", UNITS[1]], dtype=object)
    signal = {"values": np.column_stack([TIME, STORED[:, 1]]), "dimensions": 2.0, "label": "", "units": units}
    with path.open("wb") as file:
        savemat(file, {"scope": {"time": TIME[:, None], "signals": signal, "blockName": "model/Scope"}})
    return "scope.time", "scope.signals.values(:,2)"


def write_catman(path: Path) -> tuple[str, str]:
    content: dict[str, object] = {}
    for number, (name, unit, values) in enumerate(zip(NAMES, UNITS, STORED.T, strict=True), 1):
        content[f"Channel_{number}_Header"] = {"SignalName": name, "Unit": unit, "MaxLevel": 1.0}
        content[f"Channel_{number}_Data"] = values[:, None]
    with path.open("wb") as file:
        savemat(file, content)
    return NAMES


def write_units_of_table(path: Path) -> tuple[str, str]:
    units = json.dumps(dict(zip(NAMES, UNITS, strict=True)))
    pq.write_table(pa.table(list(STORED.T), names=NAMES).replace_schema_metadata({"units": units}), path)
    return NAMES


def write_parquet(path: Path) -> tuple[str, str]:
    fields = [pa.field(name, pa.float64(), metadata={"UNIT": unit}) for name, unit in zip(NAMES, UNITS, strict=True)]
    pq.write_table(pa.table(list(STORED.T), schema=pa.schema(fields)), path)
    return NAMES


def write_tdms(path: Path) -> tuple[str, str]:
    parts = zip(NAMES, UNITS, STORED.T, strict=True)
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("bench", name, values, {"Units": unit}) for name, unit, values in parts])
    return NAMES


WRITERS = {
    "HDF5, an attribute with a unit a column": write_hdf5(write_list),
    "HDF5, units in one text": write_hdf5(write_one_text),
    "HDF5, names in one text": write_hdf5(write_names_in_one_text),
    "HDF5, fields of a table": write_hdf5(write_fields),
    "HDF5, a text in the group": write_hdf5(write_groups),
    "HDF5, an attribute of the group": write_hdf5(write_attributes_of_groups),
    "HDF5, a text beside each": write_hdf5(write_beside),
    "HDF5, lists beside": write_hdf5(write_lists_beside),
    "HDF5, a group of units": write_hdf5(write_group_of_units),
    "MATLAB, a structure of units beside": write_units_beside,
    "MATLAB, a structure of units inside": write_units_inside,
    "MATLAB, a signal of Simulink": write_simulink,
    "MATLAB, a vector of Simulink": write_simulink_vector,
    "MATLAB, headers of catman": write_catman,
    "Parquet, of the table": write_units_of_table,
    "MATLAB, an array of structures": write_structures,
    "Parquet": write_parquet,
    "TDMS": write_tdms,
}


@pytest.mark.parametrize("kind", WRITERS)
def test_the_units_of_a_file_count_wherever_they_stand(tmp_path: Path, kind: str) -> None:
    time, torque = WRITERS[kind](tmp_path / "recording")
    columns = f"""
        [columns]
        time_s = {{ from = "{time}", unit = "s" }}
        torque_nm = {{ from = "{torque}", unit = "Nm" }}
    """
    run = import_by(tmp_path, tmp_path / "recording", columns)
    np.testing.assert_allclose(run["time_s"], TIME, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(run["torque_nm"], TORQUE, rtol=1e-12)
    assert "the file says kNm, the map Nm; the file's unit is used" in " ".join(run.metadata["import"]["done"])


def test_the_unit_of_a_group_is_that_of_its_one_channel(tmp_path: Path) -> None:
    path = tmp_path / "recording.tdms"
    waveform = {"wf_increment": 0.01}
    with TdmsWriter(path) as writer:
        alone = ChannelObject("alone", "torque", STORED[:, 1], waveform)
        two = [ChannelObject("two", name, TORQUE, waveform) for name in ("a", "b")]
        writer.write_segment([GroupObject("alone", {"Unit": "kNm"}), GroupObject("two", {"Unit": "kNm"}), alone, *two])
    units = {channel.name: channel.unit for channel in open_recording(path).channels}
    assert (units["torque"], units["a"], units["b"]) == ("kNm", "", "")


def test_a_unit_beside_several_datasets_is_that_of_none(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> tuple[str, str]:
        file["a"], file["b"], file["unit"] = TORQUE, TORQUE, "kNm"
        return "a", "b"

    write_hdf5(fill)(tmp_path / "recording")
    assert [channel.unit for channel in open_recording(tmp_path / "recording").channels][:2] == ["", ""]


@pytest.mark.parametrize("key", ["unit", "Units", "unit_string", "Unit Name", "PHYS_UNIT", "Einheit", "EU"])
def test_keys_of_units_are_known_in_any_spelling(key: str) -> None:
    assert list_unit_keys(["name", key, "united"]) == [key]


@pytest.mark.parametrize(
    ("text", "unit"),
    [("mS", "ms"), ("S", "s"), ("Sec.", "s"), ("kPag", "kPa"), ("rev/s", "rps"), ("kg/cm2", "kgf/cm^2"), ("KW", "kW"),
     ("in.lbs", "in*lbf"), ("kg.cm", "kgf*cm")],
)  # fmt: skip
def test_spellings_of_tools_are_known(text: str, unit: str) -> None:
    assert simplify_unit(text) == unit
    assert to_si(1.0, unit) > 0.0


@pytest.mark.parametrize(
    ("texts", "unit"),
    [
        (["Nm", "kNm"], "Nm or kNm"),
        (["V", "Volts"], "V"),
        (["", "bar"], "bar"),
        (["Nm", "of the left"], "Nm"),
        ([], ""),
    ],
)
def test_two_units_that_contradict_are_none(texts: list[str], unit: str) -> None:
    assert join_units(texts) == unit


def test_a_channel_with_two_units_needs_that_of_the_map(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "recording", "w") as file:
        file["time"], file["torque"] = TIME, TORQUE
        file["torque"].attrs.update({"unit": "Nm", "units": "kNm"})
    columns = '[columns]\ntime_s = { from = "time", unit = "s" }\ntorque_nm = { from = "torque" }\n'
    assert "has the unknown unit 'Nm or kNm'; set `unit`" in find_refusal(tmp_path, tmp_path / "recording", columns)
