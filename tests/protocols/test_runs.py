"""Run files: what is written comes back, nothing half-written stays."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from protocols.errors import InputError
from protocols.files import bounds
from protocols.files.arrow_file import ArrowFile
from protocols.files.disk import Disk, be_full, have_no_fault
from protocols.files.long_run import open_run
from protocols.files.output_file import check_new_file
from protocols.files.runs import REQUIRED, RunWriter, read_columns, read_run, write_run
from protocols.node import Column

RATE_HZ = 1000.0
SAMPLES = 200
JITTER = 0.005  # of a period: half of what read_run forgives, decimal seconds rounded to 1e-5 s

# docs/rig.md, "Signals of a recorded run": all but the optional torque_demand_nm
RIG = (
    "time_s",
    "valve_voltage_v",
    "motor_speed_demand_rad_s",
    "cylinder_pressure_bar",
    "slip_speed_rad_s",
    "shaft_angle_rad",
    "oil_temperature_degc",
    "clutch_torque_nm",
    "motor_torque_nm",
)
COLUMNS = (*(Column(name, "unit of " + name, "meaning of " + name) for name in RIG), Column("truth_x_m", "m", "more"))

Table = dict[str, np.ndarray]


def make_table() -> Table:
    values = np.random.default_rng(3).normal(size=(len(COLUMNS), SAMPLES))
    values[0] = np.arange(SAMPLES) / RATE_HZ
    return dict(zip((column.name for column in COLUMNS), values, strict=True))


def write(path: Path, metadata: dict[str, Any]) -> Table:
    wanted = make_table()
    with RunWriter(path, COLUMNS) as writer:
        writer.append(np.column_stack(list(wanted.values())))
        writer.finish(metadata)
    return wanted


def write_csv(path: Path, columns: dict[str, Any]) -> None:
    lines = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.parquet"


def test_the_required_columns_are_those_of_the_rig_description() -> None:
    assert REQUIRED == RIG


def test_values_come_back_to_the_bit_and_in_order(path: Path) -> None:
    wanted = write(path, {})
    run = read_run(path)
    assert list(run.columns) == list(wanted)
    for name, values in wanted.items():
        np.testing.assert_array_equal(run[name], values)


def test_an_opened_run_has_each_column_when_it_is_asked_for(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = write(path, {"rig": "x"})
    monkeypatch.setattr(bounds, "MOST_BYTES", 8 * SAMPLES * len(RIG))
    monkeypatch.setattr(
        ArrowFile, "_count_column_bytes", lambda *_: 8 * SAMPLES
    )  # with the overhead of a small file, more
    with pytest.raises(InputError, match=r"need .* GiB of memory"):
        read_run(path)
    run = open_run(path)
    assert (list(run.columns), len(run.columns), run.metadata) == (list(wanted), len(wanted), {"rig": "x"})
    for name in RIG:
        np.testing.assert_array_equal(run[name], wanted[name])
    assert "truth_x_m" in run
    with pytest.raises(InputError, match=f"run {path}: the requested columns need"):  # the tenth column
        run["truth_x_m"]


def test_an_opened_run_must_have_what_is_required(path: Path) -> None:
    write(path, {})
    with pytest.raises(InputError, match="lacks the column truth_y_m"):
        open_run(path, ("time_s", "truth_y_m"))


def test_rows_written_in_pieces_are_one_run(path: Path) -> None:
    wanted = make_table()
    rows = np.column_stack(list(wanted.values()))
    with RunWriter(path, COLUMNS) as writer:
        for piece in (rows[:1], rows[1:1], rows[1:150], rows[150:]):
            writer.append(piece)
        writer.finish({})
    np.testing.assert_array_equal(np.column_stack(list(read_run(path).columns.values())), rows)


def test_rows_in_small_pieces_are_written_in_few_row_groups(path: Path) -> None:
    """The writer keeps memory for each group until the file is finished, and a bench gives it 50 rows at a time."""
    rows = np.arange(490_000.0 * len(COLUMNS)).reshape(-1, len(COLUMNS))
    with RunWriter(path, COLUMNS) as writer:
        for k in range(0, len(rows), 37):
            writer.append(rows[k : k + 37])
        writer.finish({})
    assert pq.read_metadata(path).num_row_groups == 3
    np.testing.assert_array_equal(np.column_stack(list(read_columns(path).columns.values())), rows)


def test_a_run_of_which_a_row_group_is_missing_cannot_be_finished(path: Path) -> None:
    disk = Disk()
    with RunWriter(path, COLUMNS, disk) as writer:
        disk.before_write = be_full
        with pytest.raises(InputError, match=r"run\.parquet cannot be written: No space left on device$"):
            writer.append(np.zeros((240_001, len(COLUMNS))))
        disk.before_write = have_no_fault
        with pytest.raises(InputError, match=r"run\.parquet cannot be written: No space left on device$"):
            writer.finish({})
    assert not list(path.parent.iterdir())


def test_units_and_meanings_stand_in_the_file(path: Path) -> None:
    write(path, {})
    for column in COLUMNS:
        field = pq.read_schema(path).field(column.name)
        assert field.metadata == {b"unit": column.unit.encode(), b"meaning": column.meaning.encode()}


def test_units_and_meanings_come_back(path: Path) -> None:
    write(path, {})
    run = read_run(path)
    assert run.describe_columns() == list(COLUMNS)
    assert run.units["time_s"] == "unit of time_s"
    assert run.meanings["truth_x_m"] == "more"


@pytest.mark.parametrize(
    ("unit", "refused"), [("bar", True), ("mN m", True), ("N*m", False), ("", False), ("Nm (raw)", False)]
)
def test_a_unit_that_the_name_of_a_column_denies_is_refused(tmp_path: Path, unit: str, refused: bool) -> None:
    columns = [Column(name, unit if name == "clutch_torque_nm" else "", name) for name in REQUIRED]
    file = tmp_path / "run.parquet"
    with RunWriter(file, columns) as writer:
        writer.append(np.column_stack([np.arange(5) / 1000.0, *np.ones((len(REQUIRED) - 1, 5))]))
        writer.finish({})
    if not refused:
        assert len(read_run(file)["clutch_torque_nm"]) == 5
        return
    with pytest.raises(
        InputError,
        match=f"column clutch_torque_nm has the unit {unit}; by its name it is in Nm. Write the values in Nm",
    ):
        read_run(file)


def test_a_run_written_again_is_the_same_run(path: Path) -> None:
    write(path, {"notes": "twice"})
    run, again = read_run(path), path.with_name("again.parquet")
    write_run(run, again)
    written = read_run(again)
    assert (written.metadata, written.describe_columns()) == (run.metadata, run.describe_columns())
    for name, values in run.columns.items():
        np.testing.assert_array_equal(written[name], values)


def test_csv_keeps_values_only(path: Path) -> None:
    wanted = write(path, {"notes": "lost"})
    write_run(read_run(path), path.with_suffix(".csv"))
    run = read_run(path.with_suffix(".csv"))
    for name, values in wanted.items():
        np.testing.assert_array_equal(run[name], values)
    assert (run.metadata, run.units) == ({}, {})


def test_an_unknown_suffix_is_refused_with_those_allowed(path: Path) -> None:
    write(path, {})
    with pytest.raises(InputError, match=r"cannot be written as '\.xlsx'; allowed are \.csv, \.mf4, \.parquet"):
        write_run(read_run(path), path.with_suffix(".xlsx"))
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]


def test_a_name_without_suffix_is_told_so(path: Path) -> None:
    write(path, {})
    with pytest.raises(InputError, match=r"cannot be written under a name without suffix; allowed are \.csv"):
        write_run(read_run(path), Path("/dev/full"))


@pytest.mark.parametrize("suffix", [".CSV", ".Mf4", ".PARQUET"])
def test_capital_letters_of_a_suffix_are_as_good(path: Path, suffix: str) -> None:
    wanted = write(path, {})
    write_run(read_run(path), path.with_suffix(suffix))
    np.testing.assert_array_equal(read_run(path.with_suffix(suffix))["clutch_torque_nm"], wanted["clutch_torque_nm"])


def test_metadata_come_back(path: Path) -> None:
    metadata = {"rig": "wet_clutch", "sample_rate_hz": 1000.0, "notes": "ünïcode", "nested": {"a": [1, 2.5, None]}}
    write(path, metadata)
    assert read_run(path).metadata == metadata


@pytest.mark.parametrize("text", ["12", "12e5", "true", "null", '{"a": 1}', "NaN"])
def test_metadata_text_stays_text(path: Path, text: str) -> None:
    write(path, {"notes": text})
    assert read_run(path).metadata["notes"] == text


def test_an_unknown_column_is_refused_with_those_there_are(path: Path) -> None:
    write(path, {})
    with pytest.raises(InputError, match=r"no column 'torque'; it has time_s, .*truth_x_m"):
        read_run(path)["torque"]


def test_leaving_by_an_exception_leaves_no_file(path: Path) -> None:
    def fail() -> None:
        with RunWriter(path, COLUMNS) as writer:
            writer.append(np.ones((5, len(COLUMNS))))
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert list(path.parent.iterdir()) == []


def test_leaving_without_finish_leaves_no_file(path: Path) -> None:
    with RunWriter(path, COLUMNS) as writer:
        writer.append(np.ones((5, len(COLUMNS))))
    assert list(path.parent.iterdir()) == []


def test_the_file_has_its_name_only_when_it_is_complete(path: Path) -> None:
    with RunWriter(path, COLUMNS) as writer:
        writer.append(np.column_stack(list(make_table().values())))
        assert not path.exists()
        writer.finish({})
        assert [entry.name for entry in path.parent.iterdir()] == [path.name]
    assert len(read_run(path)["time_s"]) == SAMPLES


def test_a_failed_recording_leaves_the_older_run_alone(path: Path) -> None:
    wanted = write(path, {"notes": "older"})
    with RunWriter(path, COLUMNS) as writer:
        writer.append(np.ones((5, len(COLUMNS))))
    run = read_run(path)
    assert run.metadata["notes"] == "older"
    np.testing.assert_array_equal(run["truth_x_m"], wanted["truth_x_m"])
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]


def test_missing_folders_are_made(tmp_path: Path) -> None:
    path = tmp_path / "runs" / "today" / "run.parquet"
    write(path, {})
    assert len(read_run(path)["time_s"]) == SAMPLES


def test_a_place_that_cannot_be_written_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    path = tmp_path / "file" / "run.parquet"
    with pytest.raises(InputError, match=str(path)):
        RunWriter(path, COLUMNS)


def test_csv_reads_as_parquet_does(tmp_path: Path) -> None:
    wanted = make_table()
    write_csv(tmp_path / "run.csv", wanted)
    run = read_run(tmp_path / "run.csv")
    assert list(run.columns) == list(wanted)
    for name, values in wanted.items():
        np.testing.assert_array_equal(run[name], values)


def test_whole_numbers_in_csv_are_read_as_numbers(tmp_path: Path) -> None:
    columns: dict[str, Any] = {name: [0] * 3 for name in RIG} | {"time_s": [0, 1, 2]}
    write_csv(tmp_path / "run.csv", columns)
    assert read_run(tmp_path / "run.csv")["time_s"].dtype == float


def test_further_columns_may_have_gaps_and_text_ones_are_ignored(tmp_path: Path) -> None:
    demand: Any = ["", *make_table()["time_s"][1:]]
    write_csv(tmp_path / "run.csv", make_table() | {"torque_demand_nm": demand, "remark": np.array(["x"] * SAMPLES)})
    run = read_run(tmp_path / "run.csv")
    assert np.isnan(run["torque_demand_nm"][0])
    assert "remark" not in run.columns


def test_times_rounded_to_decimals_are_accepted(tmp_path: Path) -> None:
    jitter = np.random.default_rng(5).uniform(-0.5, 0.5, SAMPLES) * JITTER / RATE_HZ
    write_csv(tmp_path / "run.csv", make_table() | {"time_s": make_table()["time_s"] + jitter})
    assert len(read_run(tmp_path / "run.csv")["time_s"]) == SAMPLES


def test_a_run_may_start_at_any_time(tmp_path: Path) -> None:
    write_csv(tmp_path / "run.csv", make_table() | {"time_s": make_table()["time_s"] - 7.0})
    assert read_run(tmp_path / "run.csv")["time_s"][0] == -7.0


def test_metadata_in_another_encoding_spoil_no_run(path: Path) -> None:
    latin = "°C".encode("latin-1")
    fields = [pa.field(name, pa.float64(), metadata={b"unit": latin}) for name in make_table()]
    schema = pa.schema(fields, metadata={b"note": latin})
    pq.write_table(pa.table(list(make_table().values()), schema=schema), path)
    run = read_run(path)
    assert run.units["oil_temperature_degc"] == run.metadata["note"] == "\N{REPLACEMENT CHARACTER}C"


# --- what a file is, by its content -----------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".parquet", ".mf4"])
@pytest.mark.parametrize("name", ["RUN.PARQUET", "RUN.MF4", "run.mdf", "run", "run.csv", "run.dat"])
def test_content_decides_how_a_run_is_read(path: Path, suffix: str, name: str) -> None:
    wanted = write(path, {"notes": "kept"})
    written = path.with_suffix(suffix)
    if suffix != ".parquet":
        write_run(read_run(path), written)
    run = read_run(written.rename(path.with_name(name)))
    for column, values in wanted.items():
        np.testing.assert_array_equal(run[column], values)
    assert run.metadata["notes"] == "kept"


@pytest.mark.parametrize("name", ["RUN.CSV", "run.txt"])
def test_text_is_read_whatever_its_name(path: Path, name: str) -> None:
    write(path, {})
    write_run(read_run(path), path.with_suffix(".csv"))
    assert len(read_run(path.with_suffix(".csv").rename(path.with_name(name)))["time_s"]) == SAMPLES


def test_a_run_is_written_by_one_command_at_a_time(path: Path) -> None:
    rows = np.column_stack(list(make_table().values()))
    with RunWriter(path, COLUMNS) as writer:
        with pytest.raises(InputError, match=r"run\.parquet is being written by another command"):
            RunWriter(path, COLUMNS)
        writer.append(rows)
        writer.finish({})
    assert len(read_run(path)["time_s"]) == SAMPLES


def test_a_run_that_another_command_wrote_meanwhile_stays(path: Path) -> None:
    check_new_file(path)
    with RunWriter(path, COLUMNS) as writer:
        writer.append(np.column_stack(list(make_table().values())))
        path.write_text("of another")
        with pytest.raises(InputError, match="was written by another command meanwhile"):
            writer.finish({})
    assert [file.read_text() for file in path.parent.iterdir()] == ["of another"]
