"""Foreign recordings become runs: names, units and what is done to them are said, what is wrong is told by column and row."""

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat
from typer.testing import CliRunner

from clutch_hil.command import make_application
from clutch_hil.commands.import_recording import register
from clutch_hil.recordings.import_map import MAPS, load_map
from protocols.errors import InputError
from protocols.files import runs
from protocols.files.run import Run
from protocols.files.runs import REQUIRED, read_run
from tests.processes import play_here

SAMPLES = 400


PERIOD = 1e-3  # s


LOW = 1e-3  # relative: what a low pass at 100 Hz leaves of 300 Hz and takes of 5 Hz


TIME = PERIOD * np.arange(SAMPLES)


FOREIGN: dict[str, Any] = {"t": TIME, "qm": np.sin(2 * np.pi * 5.0 * TIME), "vir": np.cos(TIME), "gtau": 35.0}


FOUND = "text in utf-8, ',' between cells, '.' as decimal mark"


COLUMNS = """
[columns]
time_s = { from = "t", unit = "s" }
position_m = { from = "qm", unit = "mm" }
motor_force_n = { from = "vir", unit = "N", scale_by = "gtau", scale = -2.0 }
"""


def read_mapped(tmp_path: Path, text: str = COLUMNS, **changed: Any) -> Any:
    """A text recording, `changed`, read by the map `text`. Single numbers stand above the names."""
    recording, toml = tmp_path / "recording.csv", tmp_path / "map.toml"
    given = {name: value for name, value in (FOREIGN | changed).items() if value is not None}
    columns = {name: values for name, values in given.items() if isinstance(values, np.ndarray)}
    lines = [f"{name}: {value}" for name, value in given.items() if name not in columns]
    rows = zip(*(map(repr, values.tolist()) for values in columns.values()), strict=True)
    recording.write_text("\n".join([*lines, ",".join(columns), *map(",".join, rows), ""]), encoding="utf-8")
    toml.write_text(text, encoding="utf-8")
    return load_map(str(toml)).read(recording)


def find_refusal(tmp_path: Path, text: str = COLUMNS, **changed: Any) -> str:
    with pytest.raises(InputError) as refused:
        read_mapped(tmp_path, text, **changed)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_a_gear_with_a_missing_sample_is_held(tmp_path: Path) -> None:
    gear = np.where(np.arange(SAMPLES) < 200, 1.0, 3.0)
    gear[[20, 199]] = np.nan
    text = '[columns]\ntime_s = { from = "t", unit = "s" }\ngear_1 = { from = "qm", unit = "1" }\n[file]\nresample_hz = 2e3\n'
    assert set(read_mapped(tmp_path, text, qm=gear)["gear_1"]) == {1.0, 3.0}


# --- angles -----------------------------------------------------------------------------------------------------------

TURNING = """
[file]
resample_hz = 500.0
[columns]
time_s = { from = "t", unit = "s" }
shaft_angle_rad = { from = "qm", unit = "deg", wraps_at = 360.0 }
"""


def test_an_angle_that_begins_anew_goes_on(tmp_path: Path) -> None:
    """It does so before it is resampled: between 359 and 1 deg there is no 180 deg. What is missing is bridged as ever."""
    turned = 5000.0 * TIME + 300.0  # deg: five and a half turns
    shown = np.mod(turned, 360.0)
    shown[[100, 101]] = np.nan
    run = read_mapped(tmp_path, TURNING.replace("[columns]", "longest_gap_s = 0.1\n[columns]"), qm=shown)
    assert run["shaft_angle_rad"] == pytest.approx(np.radians(5000.0 * run["time_s"] + 300.0), abs=1e-4)  # a low pass
    assert "qm: began anew 6 times after 360, which is undone" in run.metadata["import"]["done"]


def test_an_angle_back_and_forth_goes_on_both_ways(tmp_path: Path) -> None:
    turned = 700.0 * np.sin(10.0 * TIME)
    run = read_mapped(tmp_path, TURNING.replace("resample_hz = 500.0\n", ""), qm=np.mod(turned + 180.0, 360.0) - 180.0)
    assert run["shaft_angle_rad"] == pytest.approx(np.radians(turned), abs=1e-9)


@pytest.mark.parametrize("wraps_at", ["-360.0", "nan", "1e200"])
def test_a_turn_is_a_positive_number(tmp_path: Path, wraps_at: str) -> None:
    assert f"shaft_angle_rad.wraps_at is {float(wraps_at):g}" in find_refusal(
        tmp_path, TURNING.replace("360.0", wraps_at)
    )


# --- MATLAB -----------------------------------------------------------------------------------------------------------


def test_a_mat_file_with_our_names_is_a_run(tmp_path: Path) -> None:
    recording = tmp_path / "run.mat"
    wanted = {name: np.random.default_rng(1).normal(size=SAMPLES) for name in REQUIRED} | {"time_s": TIME}
    savemat(recording, wanted | {"gain": 3.5, "remark": "text", "table": np.ones((3, 4)), "row": TIME[None]})
    run = read_run(recording)
    for name, values in wanted.items():
        np.testing.assert_array_equal(run[name], values)
    assert set(run.columns) == {*REQUIRED, "row"}
    assert run.metadata == {"gain": 3.5}


def test_vectors_of_unequal_lengths_are_refused_by_name(tmp_path: Path) -> None:
    recording = tmp_path / "run.mat"
    savemat(recording, {name: TIME[: SAMPLES - (name == "shaft_angle_rad")] for name in REQUIRED})
    with pytest.raises(InputError, match="shaft_angle_rad has 399 rows, time_s has 400"):
        read_run(recording)


def test_a_mat_file_of_level_7_3_is_a_run(tmp_path: Path) -> None:
    recording = tmp_path / "run.mat"
    wanted = {name: np.random.default_rng(1).normal(size=SAMPLES) for name in REQUIRED} | {"time_s": TIME}
    with h5py.File(recording, "w", userblock_size=512) as file:
        for name, values in {**wanted, "gain": np.array([[3.5]]), "table": np.ones((3, 4))}.items():
            file.create_dataset(name, data=np.atleast_2d(values)).attrs["MATLAB_class"] = np.bytes_("double")
        file.create_dataset("remark", data=np.array([[104], [105]], np.uint16)).attrs["MATLAB_class"] = np.bytes_(
            "char"
        )
    with recording.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    run = read_run(recording)
    for name, values in wanted.items():
        np.testing.assert_array_equal(run[name], values)
    assert set(run.columns) == set(REQUIRED)
    assert run.metadata == {"gain": 3.5}


def test_a_cut_file_of_level_7_3_is_refused(tmp_path: Path) -> None:
    recording = tmp_path / "run.mat"
    recording.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512))
    with pytest.raises(InputError, match="cannot be read"):
        read_run(recording)


@pytest.mark.parametrize("content", [b"", b"no MATLAB file at all", bytes(600)])
def test_what_is_no_mat_file_is_refused(tmp_path: Path, content: bytes) -> None:
    recording = tmp_path / "run.mat"
    recording.write_bytes(content)
    with pytest.raises(InputError, match=f"run {recording} (cannot be read|has no vectors)"):
        read_run(recording)


# --- maps -------------------------------------------------------------------------------------------------------------


def test_names_units_and_scales_are_mapped(tmp_path: Path) -> None:
    run = read_mapped(tmp_path)
    np.testing.assert_array_equal(run["time_s"], TIME)
    np.testing.assert_allclose(run["position_m"], 1e-3 * FOREIGN["qm"], rtol=1e-12)
    np.testing.assert_allclose(run["motor_force_n"], -70.0 * FOREIGN["vir"], rtol=1e-12)
    assert run.units == {"time_s": "s", "position_m": "m", "motor_force_n": "N"}
    assert run.metadata["gtau"] == 35.0
    assert run.metadata["import"]["done"] == [FOUND, "names in line 2", "above the names: gtau: 35.0"]


def test_celsius_comes_of_kelvin(tmp_path: Path) -> None:
    text = '[columns]\ntime_s = { from = "t", unit = "s" }\noil_temperature_degc = { from = "qm", unit = "K" }\n'
    np.testing.assert_allclose(read_mapped(tmp_path, text)["oil_temperature_degc"], FOREIGN["qm"] - 273.15)


def test_a_text_file_without_a_header_is_read_by_column(tmp_path: Path) -> None:
    recording, toml = tmp_path / "recording.csv", tmp_path / "map.toml"
    np.savetxt(recording, np.column_stack([1e3 * TIME, TIME, FOREIGN["qm"]]), delimiter="\t")
    toml.write_text(
        '[file]\ndelimiter = "\\t"\nheader = false\nskip_rows = 3\n[columns]\n'
        'time_s = { number = 1, unit = "ms" }\nposition_m = { number = 3, unit = "um" }\n'
    )
    run = load_map(str(toml)).read(recording)
    np.testing.assert_allclose(run["time_s"], TIME[3:])
    np.testing.assert_allclose(run["position_m"], 1e-6 * FOREIGN["qm"][3:])
    assert run.metadata["import"]["done"] == [
        "text in utf-8, tabs between cells, '.' as decimal mark",
        "no names of columns: they are 'column 1' to 'column 3'",
        "left out the first 3 rows",
    ]


def test_a_word_in_a_text_file_is_told_by_column_and_row(tmp_path: Path) -> None:
    recording, toml = tmp_path / "recording.txt", tmp_path / "map.toml"
    recording.write_text("t\tx\n0\t1\n0.1\tbroken\n0.2\t3\n")
    toml.write_text('[columns]\ntime_s = { from = "t", unit = "s" }\nposition_m = { from = "x", unit = "m" }\n')
    with pytest.raises(InputError, match="column 'x' holds 'broken' in line 3, which is no number"):
        load_map(str(toml)).read(recording)


def test_uneven_samples_are_refused_unless_resampling_is_asked_for(tmp_path: Path) -> None:
    uneven = TIME + np.where(np.arange(SAMPLES) >= 100, 0.005, 0.0)
    assert "the sample rate changes in row 100" in find_refusal(tmp_path, t=uneven)
    run = read_mapped(tmp_path, "[file]\nresample_hz = 1000.0\n" + COLUMNS, t=uneven, qm=uneven)
    np.testing.assert_allclose(np.diff(run["time_s"]), 1e-3)
    np.testing.assert_allclose(run["position_m"], 1e-3 * run["time_s"], atol=1e-12)
    assert run.metadata["import"]["done"][-1] == (
        "resampled at 1000 Hz from 1000 Hz: 1 of 399 steps differed from 1 ms, the longest was 6 ms"
    )


def test_a_gap_is_refused_or_bridged_or_cut_as_the_map_says(tmp_path: Path) -> None:
    late = TIME + np.where(np.arange(SAMPLES) >= 100, 0.05, 0.0)
    assert "jumps by 0.051 s after row 99, from 0.099 to 0.15 s" in find_refusal(tmp_path, t=late)
    file = "[file]\nresample_hz = 1000.0\nlongest_gap_s = "
    bridged = read_mapped(tmp_path, f"{file} 0.1\n{COLUMNS}", t=late, qm=late)
    np.testing.assert_allclose(bridged["position_m"], 1e-3 * bridged["time_s"], atol=1e-12)
    assert "has gaps and becomes 2 runs (0 to 0.099 s, 0.15 to 0.449 s)" in find_refusal(
        tmp_path, f"{file} 0.02\n{COLUMNS}", t=late
    )
    runs = load_map(str(tmp_path / "map.toml")).read_runs(tmp_path / "recording.csv")
    assert [len(run["time_s"]) for run in runs] == [100, 300]


def test_time_that_runs_back_is_refused_also_where_it_is_resampled(tmp_path: Path) -> None:
    back = TIME.copy()
    back[70] = back[68]
    sentence = find_refusal(tmp_path, "[file]\nresample_hz = 500.0\n" + COLUMNS, t=back)
    assert "the time of position_m does not increase in row 70: 0.068 s after 0.069 s" in sentence


def test_a_low_pass_takes_the_fast_and_does_not_delay_the_slow(tmp_path: Path) -> None:
    slow, fast = FOREIGN["qm"], np.sin(2 * np.pi * 300.0 * TIME)
    run = read_mapped(tmp_path, "[file]\nlow_pass_hz = 100.0\nfrom_s = 0.1\nto_s = 0.3\n" + COLUMNS, qm=slow + fast)
    kept = (TIME >= 0.1) & (TIME <= 0.3)
    np.testing.assert_allclose(1e3 * run["position_m"], slow[kept], atol=5 * LOW)
    assert run.metadata["import"]["done"][-2:] == [
        "low-passed all columns at 100 Hz, forwards and backwards", "kept 0.1 to 0.3 s",
    ]  # fmt: skip


def test_what_would_be_folded_down_is_filtered_where_the_rate_falls(tmp_path: Path) -> None:
    slow, fast = FOREIGN["qm"], np.sin(2 * np.pi * 195.0 * TIME)  # 195 Hz would become 5 Hz
    run = read_mapped(tmp_path, "[file]\nresample_hz = 200.0\nfrom_s = 0.1\nto_s = 0.3\n" + COLUMNS, qm=slow + fast)
    kept = (run["time_s"] >= 0.1) & (run["time_s"] <= 0.3)
    np.testing.assert_allclose(
        1e3 * run["position_m"][kept], np.sin(2 * np.pi * 5.0 * run["time_s"][kept]), atol=5 * LOW
    )
    assert any("low-passed at 80 Hz before" in note for note in run.metadata["import"]["done"])


@pytest.mark.parametrize(
    ("text", "changed", "sentence"),
    [
        (COLUMNS, {"qm": None}, "has no column 'qm'; known are t, vir"),
        (COLUMNS, {"gtau": None}, "has no number 'gtau' to scale motor_force_n by"),
        (COLUMNS, {"qm": np.where(np.arange(SAMPLES) == 9, np.nan, 1.0)}, "position_m is not a number in row 9"),
        (COLUMNS.replace('"mm"', '"cubit"'), {}, "unit 'cubit' is unknown"),
        (COLUMNS.replace('"mm"', '"bar"'), {}, "position_m is given in 'bar', which cannot be converted into 'm'"),
        (COLUMNS.replace("position_m", "position"), {}, "column 'position' does not end with a unit"),
        (COLUMNS.replace("time_s", "clock_s"), {}, "has no column time_s"),
        (COLUMNS.replace('from = "qm"', 'form = "qm"'), {}, "position_m.form is unknown; did you mean from or formula?"),
        (COLUMNS.replace('from = "qm", ', ""), {}, "position_m needs either `from`, a name, or `number`"),
        (COLUMNS.replace('from = "qm"', "number = 9"), {}, "has no column number 9; it has 3 columns"),
        ("[file]\nresample_hz = -5.0\n" + COLUMNS, {}, "resample_hz is -5; allowed is 0 or more"),
        ("[file]\nlow_pass_hz = 600.0\n" + COLUMNS, {}, "low_pass_hz is 600 Hz; allowed is below 500 Hz"),
        ("[file]\nlow_pass_hz = 1e-9\n" + COLUMNS, {}, "low_pass_hz is 1e-09 Hz; allowed is 0.0005 Hz and more"),
        ("[file]\nfrom_s = 9.0\n" + COLUMNS, {}, "has no row from 9 to inf s; its rows are at 0 to 0.399 s"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_in_a_sentence(tmp_path: Path, text: str, changed: dict[str, Any], sentence: str) -> None:
    message = find_refusal(tmp_path, text, **changed)
    assert sentence in message
    assert message.startswith(
        (f"import map {tmp_path}", f"recording {tmp_path}", "import map map has no column", "import map: low_pass")
    )


@pytest.mark.parametrize("name", sorted(path.stem for path in MAPS.glob("*.toml")))
def test_our_maps_are_found_by_name(name: str) -> None:
    assert load_map(name).name == name


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--map", "{folder}", "--out", "a.parquet"), "import map {folder} is a folder; a TOML file is needed"),
        (("--map", "emps"), "--out is missing; it is the run file to write"),
        (
            ("--out", "a.parquet"),
            "--map is missing; `clutch-hil import --draft {recording}` writes a draft of one",
        ),
    ],
)
def test_what_is_missing_or_no_map_is_told(tmp_path: Path, words: tuple[str, ...], sentence: str) -> None:
    recording = tmp_path / "ab.csv"
    recording.write_text("time_s,x\n0,1\n1,2\n")
    done = play_here("import", recording, *(word.format(folder=tmp_path) for word in words))
    assert done.returncode == 2
    assert sentence.format(folder=tmp_path, recording=recording) in done.stderr


def test_an_unknown_map_is_told_what_comes_closest() -> None:
    with pytest.raises(InputError, match=r"import map 'empz' is unknown; did you mean emps\?, or give a TOML file"):
        load_map("empz")


# --- the command ------------------------------------------------------------------------------------------------------


def test_the_command_writes_a_run_that_can_be_read(tmp_path: Path) -> None:
    import typer

    app = typer.Typer()
    app.callback()(lambda: None)
    register(app)
    read_mapped(tmp_path)
    out = tmp_path / "run.parquet"
    recording, toml = tmp_path / "recording.csv", tmp_path / "map.toml"
    arguments = ["import", str(recording), "--map", str(toml), "--from", "0.1", "--out", str(out), "--json"]
    answer = CliRunner().invoke(app, arguments)
    assert answer.exit_code == 0, answer.output
    document = json.loads(answer.stdout)
    assert document["rows"] == [300]
    run = read_run(out, ("time_s", "position_m"))
    assert run["time_s"][0] == pytest.approx(0.1)
    assert run.metadata["import"]["done"] == document["done"]
    assert document["done"][-1] == "kept 0.1 to 0.399 s"
    assert run.units["motor_force_n"] == "N"


def test_a_number_too_large_to_compute_with_is_refused_by_row(tmp_path: Path) -> None:
    """Of a damaged file; a low pass, or straight lines, would end in infinity."""
    path, map_file = tmp_path / "a.csv", tmp_path / "a.toml"
    rows = [f"{0.01 * k:.2f},{'1.6e308' if k == 40 else 0.1 * k}" for k in range(100)]
    path.write_text("\n".join(["time,pos", *rows]))
    columns = '[columns]\ntime_s = { from = "time", unit = "s" }\nposition_m = { from = "pos", unit = "m" }\n'
    map_file.write_text(f"[file]\nresample_hz = 50.0\nlow_pass_hz = 10.0\n{columns}")
    with pytest.raises(InputError, match=r"'pos' for position_m is 1.6e\+308 in row 40; allowed is up to 2e\+19"):
        load_map(str(map_file)).read(path)


@pytest.mark.parametrize("file", ["", "[file]\nresample_hz = 100.0\n"])
def test_a_column_without_any_number_is_told_as_a_missing_sensor(tmp_path: Path, file: str) -> None:
    """A logger writes a column for a sensor that was not there."""
    path, map_file = tmp_path / "a.csv", tmp_path / "a.toml"
    path.write_text("\n".join(["time,pos,force", *(f"{0.01 * k:.2f},{0.1 * k:.1f},nan" for k in range(100))]))
    columns = (("time_s", "time"), ("position_m", "pos"), ("force_n", "force"))
    map_file.write_text(
        f"{file}[columns]\n"
        + "".join(f'{ours} = {{ from = "{name}", unit = "{ours[-1]}" }}\n' for ours, name in columns).replace(
            '"n"', '"N"'
        )
    )
    with pytest.raises(InputError, match=r"force_n has no number in any row; .* leave it out of the map"):
        load_map(str(map_file)).read_runs(path)


def test_samples_that_are_no_numbers_are_told_with_the_way_out(tmp_path: Path) -> None:
    path, map_file = tmp_path / "a.csv", tmp_path / "a.toml"
    rows = [f"{0.01 * k:.2f},{'nan' if 40 <= k < 60 else 0.1 * k}" for k in range(100)]
    path.write_text("\n".join(["time,pos", *rows]))
    columns = '[columns]\ntime_s = { from = "time", unit = "s" }\nposition_m = { from = "pos", unit = "m" }\n'
    map_file.write_text(columns)
    with pytest.raises(InputError, match="position_m is not a number in row 40, one of 20 such rows; set resample_hz"):
        load_map(str(map_file)).read(path)
    map_file.write_text(f"[file]\nresample_hz = 100.0\nlongest_gap_s = 0.1\n{columns}")
    first, second = load_map(str(map_file)).read_runs(path)
    assert (first["time_s"][-1], second["time_s"][0]) == (pytest.approx(0.39), pytest.approx(0.6))


def test_of_several_runs_all_are_written_or_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, map_file = tmp_path / "a.csv", tmp_path / "a.toml"
    rows = [f"{0.01 * k:.2f},{0.1 * k}" for k in range(100) if not 40 <= k < 60]
    path.write_text("\n".join(["time,pos", *rows]))
    columns = '[columns]\ntime_s = { from = "time", unit = "s" }\nposition_m = { from = "pos", unit = "m" }\n'
    map_file.write_text(f"[file]\nresample_hz = 100.0\nlongest_gap_s = 0.1\n{columns}")
    words = ("import", str(path), "--map", str(map_file), "--out", str(tmp_path / "run.parquet"))
    write_run, before = runs.write_run, sorted(tmp_path.iterdir())

    def write_the_first(run: Run, file: Path) -> None:
        if "-2" in file.name:
            raise InputError(f"file {file} cannot be written: No space left on device")
        write_run(run, file)

    monkeypatch.setattr(runs, "write_run", write_the_first)
    refused = CliRunner().invoke(make_application(), words).exception
    assert str(refused) == f"file {tmp_path}/run-2.parquet cannot be written: No space left on device"
    assert sorted(tmp_path.iterdir()) == before
    monkeypatch.undo()
    assert CliRunner().invoke(make_application(), words).exit_code == 0
    assert {file.name for file in tmp_path.glob("*.parquet")} == {"run-1.parquet", "run-2.parquet"}


def test_volts_of_a_sensor_are_bar_by_scale_and_offset(tmp_path: Path) -> None:
    columns = COLUMNS.replace('from = "qm", unit = "mm"', 'from = "qm", unit = "mm", scale = 2.0, offset = -1.0')
    assert read_mapped(tmp_path, columns)["position_m"] == pytest.approx(1e-3 * (2.0 * FOREIGN["qm"] - 1.0))
    sentence = find_refusal(tmp_path, COLUMNS.replace('"mm"', '"mm", offset = "much"'))
    assert "position_m.offset is 'much'" in sentence
