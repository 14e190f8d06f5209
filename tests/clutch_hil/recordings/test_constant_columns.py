"""What a file does not have becomes a column of one value, by the map, and is told."""

from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.import_map import load_map
from protocols.errors import InputError
from protocols.files.run import Run

ROWS = "t,torque\n" + "".join(f"{k / 100},{k % 7}\n" for k in range(60) if not 20 <= k < 40)
COLUMNS = """[columns]
time_s = {{ from = "t", unit = "s" }}
clutch_torque_nm = {{ from = "torque", unit = "Nm" }}
oil_temperature_degc = {{ constant = {constant} }}
"""


def import_rows(folder: Path, columns: str, file: str = "") -> list[Run]:
    (folder / "rows.csv").write_text(ROWS)
    (folder / "map.toml").write_text(f"[file]\nlongest_gap_s = 0.1\n{file}\n{columns}")
    return load_map(str(folder / "map.toml")).read_runs(folder / "rows.csv")


@pytest.mark.parametrize("file", ["", "resample_hz = 50.0", "skip_rows = 3", "from_s = 0.02\nto_s = 0.5"])
def test_it_has_as_many_rows_as_the_others_in_each_run(tmp_path: Path, file: str) -> None:
    runs = import_rows(tmp_path, COLUMNS.format(constant=60.5), file)
    assert len(runs) == 2
    for run in runs:
        assert run["oil_temperature_degc"].tolist() == [60.5] * len(run["time_s"])
        assert list(run.columns) == ["time_s", "clutch_torque_nm", "oil_temperature_degc"]
        assert run.units["oil_temperature_degc"] == "degC"
        sentence = "oil_temperature_degc is 60.5 throughout by the map: the file does not have it"
        assert sentence in run.metadata["import"]["done"]


def test_it_goes_with_a_time_by_the_number_of_the_row(tmp_path: Path) -> None:
    columns = COLUMNS.format(constant=-3).replace('from = "t", unit = "s"', "rate_hz = 100.0")
    (run,) = import_rows(tmp_path, columns)
    assert np.all(run["oil_temperature_degc"] == -3.0)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("constant = 1", "constant = nan", "oil_temperature_degc.constant is nan; allowed is a number"),
        (
            "constant = 1",
            "constant = 1e200",
            "oil_temperature_degc.constant is 1e+200; allowed is a number up to 1e+100",
        ),
        ("constant = 1", "constant = inf", "oil_temperature_degc.constant is inf"),
        ("constant = 1", 'constant = "warm"', "oil_temperature_degc.constant is 'warm'"),
        (
            "constant = 1",
            'constant = 1, unit = "K"',
            "oil_temperature_degc has constant; it is allowed only as the single entry",
        ),
        (
            'from = "t", unit = "s"',
            "constant = 1",
            "time_s has constant; it is allowed only as the single entry of a column other than",
        ),
        ('from = "torque", unit = "Nm"', "constant = 1", "has no column except time_s"),
    ],
)
def test_a_constant_that_cannot_be_is_refused(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    with pytest.raises(InputError) as refused:
        import_rows(tmp_path, COLUMNS.format(constant=1).replace(old, new))
    assert sentence in str(refused.value)
