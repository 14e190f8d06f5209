"""Arguments from Python: what is sound is taken, of NumPy too; anything else is one sentence, and never a wrong run."""

from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import clutch_hil as ch
from clutch_hil.bench.arguments import take_flag, take_list, take_number, take_whole
from protocols.files.run import Run
from protocols.files.runs import read_run, write_run

TIME = np.arange(5) * 0.01


@pytest.mark.parametrize("seed", [np.int64(3), np.uint8(3), 3])
def test_whole_numbers_of_numpy_are_taken(seed: Any) -> None:
    assert take_whole("seed", seed, 0) == 3
    assert type(take_whole("seed", seed, 0)) is int


@pytest.mark.parametrize("value", [True, np.True_, 1.0, "1", None, -1, np.array([1, 2])])
def test_what_is_no_whole_number_is_refused(value: Any) -> None:
    with pytest.raises(ch.InputError, match=r"^seed is .*; allowed are 0 and more, whole numbers$"):
        take_whole("seed", value, 0)


def test_whole_numbers_name_the_whole_range_that_is_allowed() -> None:
    for value, bounds, allowed in (
        (0, (1, 256), "allowed are 1 to 256, whole numbers"),
        (257, (1, 256), "allowed are 1 to 256, whole numbers"),
        (0, (1,), "allowed are 1 and more, whole numbers"),
        (0.5, (-inf,), "a whole number is needed"),
    ):
        with pytest.raises(ch.InputError, match=f"^workers is {value}; {allowed}$"):
            take_whole("workers", value, *bounds)
    assert take_whole("rate", -200, -inf) == -200  # the caller checks the range


@pytest.mark.parametrize("value", [np.float32(0.5), np.float64(0.5), 0.5])
def test_numbers_of_numpy_are_taken(value: Any) -> None:
    assert type(take_number("seconds", value)) is float
    assert take_number("seconds", value) == 0.5


@pytest.mark.parametrize("value", [True, "0.5", None, [0.5], 1j])
def test_what_is_no_number_is_refused(value: Any) -> None:
    with pytest.raises(ch.InputError, match=r"^seconds is .*; a number is needed$"):
        take_number("seconds", value)


@pytest.mark.parametrize("value", ["no", "false", 0, 1, None])
def test_a_word_is_no_flag(value: Any) -> None:
    with pytest.raises(ch.InputError, match=r"^adaptation is .*; allowed are True and False$"):
        take_flag("adaptation", value)


def test_one_thing_stands_for_a_list_of_one() -> None:
    run = Run({"time_s": TIME}, {})
    for one in ("fault", Path("a.parquet"), run):
        assert take_list("things", one) == [one]
    assert take_list("things", ("a", "b")) == ["a", "b"]
    with pytest.raises(ch.InputError, match=r"^things is 5; allowed is a list$"):
        take_list("things", 5)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"adaptation": "no"}, "adaptation is 'no'"),
        ({"seconds": "3"}, "seconds is '3'"),
        ({"temperature": "40"}, "temperature is '40'"),
        ({"rate": "1000"}, "rate is '1000'"),
        ({"plant": ["a"]}, r"plant is \['a'\]"),
        ({"plant": {1: 1.0}}, r"plant is \{1: 1.0\}"),
        ({"effects": {"internal_leakage": 1e-6}}, r"effects\['internal_leakage'\] is 1e-06"),
        (
            {"effects": {"internal_leakage": {"conductance": "a"}}},
            "parameter internal_leakage.conductance is 'a'; a number is",
        ),
        ({"effects": [3]}, "effects has 3"),
        ({"seed": True}, "seed is True"),
    ],
)
def test_a_wrong_argument_of_simulate_is_one_sentence(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(ch.InputError, match=words):
        ch.simulate("engagement", **wrong)


def test_sound_arguments_of_numpy_and_none_give_the_same_run() -> None:
    one = ch.simulate(profile="engagement", seconds=0.5, seed=3, plant={"friction_level.level": 1.0})
    other = ch.simulate(
        profile="engagement", seconds=np.float32(0.5), seed=np.int64(3), plant={"friction_level.level": np.int64(1)},
        effects=None, controller=None,
    )  # fmt: skip
    for name in one:
        np.testing.assert_array_equal(one[name], other[name])


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"seed": 7}, r"^seed = 7 is not an argument of a sweep; use seeds, such as seeds=\(1, 2\)$"),
        ({"seeds": "1"}, "seed is '1'"),
        ({"workers": 1.0}, "workers is 1.0"),
        ({"workers": True}, "workers is True"),
        ({"sceonds": 1.0}, "'sceonds' is not a setting of a run; did you mean seconds"),
    ],
)
def test_a_wrong_argument_of_a_sweep_is_one_sentence(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(ch.InputError, match=words):
        ch.sweep([{}], profile="engagement", **wrong)


def test_samples_may_have_their_names_in_any_order() -> None:
    samples = [
        {"friction_level.level": 0.9, "oil.heat_transfer": 2.0},
        {"oil.heat_transfer": 2.0, "friction_level.level": 0.9},
    ]
    table = ch.sweep(
        samples, profile="engagement", seconds=0.5, measures="fault", seeds=[np.int64(2)], workers=1
    ).to_pydict()
    assert table["friction_level.level"] == [0.9, 0.9]
    assert table["seed"] == [2, 2]


@pytest.mark.parametrize("ranges", [{"a": (0.0, "1")}, {"a": (-1e308, 1e308)}, {"a": 5}, [("a", 1)], {"a": (1.0,)}])
def test_wrong_ranges_are_refused(ranges: Any) -> None:
    for make in (ch.random, ch.latin_hypercube):
        with pytest.raises(ch.InputError):
            make(ranges, 3)
    with pytest.raises(ch.InputError, match=r"^a is 5; allowed is a list$"):
        ch.grid({"a": 5})  # type: ignore[dict-item]
    with pytest.raises(ch.InputError, match=r"^count is 2.0"):
        ch.random({"a": (0.0, 1.0)}, 2.0)  # type: ignore[arg-type]


def test_a_discrepancy_without_candidates_is_refused() -> None:
    with pytest.raises(ch.InputError, match="has no candidates; give names of effects, or None for all"):
        ch.find_discrepancy([ch.simulate("engagement", seconds=1.0)], effects=[])


def test_one_run_is_taken_where_runs_are_asked_for() -> None:
    with pytest.raises(ch.InputError, match=r"nosuch\.parquet does not exist"):
        ch.find_discrepancy("nosuch.parquet")  # type: ignore[arg-type]
    with pytest.raises(ch.InputError, match=r"nosuch\.parquet does not exist"):
        ch.identify_clutch("nosuch.parquet")  # type: ignore[arg-type]


def test_a_run_is_asked_for_its_names_and_told_in_one_line() -> None:
    run = Run({"time_s": TIME, "x_m": TIME}, {"rig": "wet_clutch"})
    assert "x_m" in run
    assert "y_m" not in run
    assert list(run) == ["time_s", "x_m"]
    assert repr(run) == "<Run of wet_clutch: 2 columns, 5 samples, 0 to 0.04 s>"
    assert repr(Run({"time_s": np.array(["a", "b"])}, {})) == "<Run of no rig: 1 columns>"
    assert run == run
    assert run != Run(run.columns, run.metadata)


@pytest.mark.parametrize("suffix", [".parquet", ".csv", ".mf4"])
def test_flags_and_other_numbers_come_back_from_a_file(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run{suffix}"
    flags = np.array([True, False, True, True, False])
    write_run(Run({"time_s": TIME, "flag_1": flags, "count_1": np.arange(5, dtype=np.int32)}, {}), path)
    again = read_run(path, ())
    assert again["flag_1"].tolist() == flags.astype(float).tolist()
    assert again["count_1"].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"x_m": TIME}, "lacks the column time_s"),
        ({"time_s": TIME[:1]}, "has 1 rows; at least 2 are needed"),
        ({"time_s": -TIME}, "time_s does not increase in row 1"),
        ({"time_s": TIME**2}, "the sample rate changes in row 2"),
        ({"time_s": TIME, "x_m": TIME[:3]}, "x_m has 3 rows, time_s has 5"),
        ({"time_s": TIME, "x_m": np.array(list("abcde"))}, "column 'x_m' has 1 dimensions of <U1"),
        ({"time_s": TIME, "x_m": 1j * TIME}, "column 'x_m' has 1 dimensions of complex128"),
        ({"time_s": TIME, "x_m": np.ones((5, 2))}, "column 'x_m' has 2 dimensions of float64"),
        ({"time_s": TIME, "x_m": np.ma.masked_greater(TIME, 0.02)}, "column 'x_m' has masked values"),
        ({"time_s": TIME, "": TIME}, "column '' has 1 dimensions of float64"),
    ],
)
def test_a_run_that_could_not_be_read_again_is_not_written(tmp_path: Path, columns: Any, words: str) -> None:
    for suffix in (".parquet", ".csv", ".mf4"):
        with pytest.raises(ch.InputError, match=words):
            write_run(Run(columns, {}), tmp_path / f"run{suffix}")
    with pytest.raises(ch.InputError, match="metadata of run"):
        write_run(Run({"time_s": TIME}, {"when": TIME}), tmp_path / "run.parquet")
    assert list(tmp_path.iterdir()) == []


def test_a_csv_without_a_rig_is_measured_as_a_wet_clutch(tmp_path: Path) -> None:
    run = ch.simulate("engagement", seconds=1.0)
    ch.write_run(run, tmp_path / "run.csv")
    assert ch.measure_run(ch.read_run(tmp_path / "run.csv"))["regime_error_nm"] == pytest.approx(
        ch.measure_run(run)["regime_error_nm"], rel=1e-6, nan_ok=True
    )
    with pytest.raises(
        ch.InputError, match=r"^the run has no column '.*', which measure .* of the rig wet_clutch needs$"
    ):
        ch.measure_run(Run({"time_s": TIME}, {}))
