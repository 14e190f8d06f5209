"""MDF files of the field cases, where these are beside the checkout."""

import numpy as np
import pytest

from clutch_hil.recordings.import_map import load_map
from protocols.errors import InputError
from tests import needs

FIELD_CASES = needs.FIELD_CASES / "mf4"


@pytest.mark.needs("field cases")
@pytest.mark.parametrize(
    "name", ["OK.MF4", "ok.mdf", "inca.dat", "unfin.mf4", "dup_name.mf4", "units.mf4", "two_rasters.mf4"]
)
@pytest.mark.parametrize("map_name", ["m", "mt"])
def test_field_cases_are_read(name: str, map_name: str) -> None:
    run = load_map(str(FIELD_CASES / f"{map_name}.toml")).read(FIELD_CASES / name)
    np.testing.assert_allclose(run["time_s"], 0.01 * np.arange(300), atol=1e-12)
    np.testing.assert_allclose(run["position_m"], np.sin(3.0 * run["time_s"]), atol=1e-12)
    np.testing.assert_allclose(run["motor_force_n"], np.cos(3.0 * run["time_s"]), atol=1e-12)


@pytest.mark.needs("field cases")
def test_field_case_of_two_groups_is_joined_where_a_rate_is_given() -> None:
    with pytest.raises(InputError, match="set resample_hz"):
        load_map(str(FIELD_CASES / "m.toml")).read(FIELD_CASES / "two_groups_us.mf4")
    assert len(load_map(str(FIELD_CASES / "mrs.toml")).read(FIELD_CASES / "two_groups_us.mf4")["time_s"]) == 299
