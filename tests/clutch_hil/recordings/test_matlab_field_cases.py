"""MATLAB files of the field cases, where these are beside the checkout: read by name, or the names that there are are told."""

from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.format import open_recording
from clutch_hil.recordings.import_map import load_map
from protocols.errors import InputError
from tests import needs
from tests.clutch_hil.recordings.maps import import_by

pytestmark = pytest.mark.needs("field cases")
FOLDER = needs.FIELD_CASES / "mat"
TIME = 0.01 * np.arange(300)
SINE, COSINE = np.sin(3.0 * TIME), np.cos(3.0 * TIME)


@pytest.mark.parametrize(
    ("name", "paths"),
    [
        ("structtime", ("ScopeData.time", "ScopeData.signals.values(:,1)", "ScopeData.signals.values(:,2)")),
        ("tofile", ("ans(1,:)", "ans(2,:)", "ans(3,:)")),
        ("matrix", ("t", "y(:,1)", "y(:,2)")),
        ("plainstruct", ("data.t", "data.q", "data.f")),
        ("vectors", ("t", "q", "f")),
    ],
)
def test_columns_are_listed_and_read_by_name(tmp_path: Path, name: str, paths: tuple[str, str, str]) -> None:
    file = FOLDER / f"{name}.mat"
    assert tuple(channel.path for channel in open_recording(file).channels) == paths
    time, position, force = paths
    run = import_by(
        tmp_path,
        file,
        f'[columns]\ntime_s = {{ from = "{time}", unit = "s" }}\nposition_m = {{ from = "{position}", unit = "m" }}\n'
        f'motor_force_n = {{ from = "{force}", unit = "N" }}\n',
    )
    for column, wanted in (("time_s", TIME), ("position_m", SINE), ("motor_force_n", COSINE)):
        np.testing.assert_allclose(run[column], wanted, rtol=0.0, atol=1e-12)


def test_units_of_the_map_count_where_the_file_has_none() -> None:
    run = load_map(str(FOLDER / "mt.toml")).read(FOLDER / "plainstruct.mat")
    np.testing.assert_allclose(run["time_s"], 1e-3 * TIME, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(run["position_m"], 1e-3 * SINE, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("structtime", "has no column 't'; did you mean time?"),
        ("tofile", "has no column 't'; known are ans(1)"),
        ("matrix", "has no column 'q'; known are t, y(1)"),
    ],
)
def test_a_wrong_name_is_refused_with_those_that_there_are(name: str, words: str) -> None:
    with pytest.raises(InputError) as refused:
        load_map(str(FOLDER / "m.toml")).read(FOLDER / f"{name}.mat")
    assert words in str(refused.value)


def test_controldesk_is_read_by_name_and_its_own_units_count(tmp_path: Path) -> None:
    file = FOLDER / "controldesk.mat"
    listed = [(channel.name, channel.unit) for channel in open_recording(file).channels]
    assert listed == [
        ("Model Root/CurrentTime", "s"),
        ("Model Root/Plant/Torque{In1}", "Nm"),
        ("Model Root/Plant/Speed", "rpm"),
    ]
    with pytest.raises(InputError, match="is in 'Nm', which cannot be converted into 'N'"):
        load_map(str(FOLDER / "cd.toml")).read(file)
    run = import_by(
        tmp_path,
        file,
        '[columns]\ntime_s = { from = "Model Root/CurrentTime" }\n'
        'motor_torque_nm = { from = "Model Root/Plant/Torque{In1}" }\n'
        'speed_rad_s = { from = "Model Root/Plant/Speed" }\n',
    )
    recorded = {one.name: open_recording(file).read([one])[0].values for one in open_recording(file).channels}
    np.testing.assert_allclose(run["time_s"], TIME, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(run["motor_torque_nm"], recorded["Model Root/Plant/Torque{In1}"])
    np.testing.assert_allclose(run["speed_rad_s"], np.pi / 30.0 * recorded["Model Root/Plant/Speed"], rtol=1e-12)
