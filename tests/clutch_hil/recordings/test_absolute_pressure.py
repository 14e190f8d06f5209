"""Absolute pressures are told by their unit or name, and become those above the air by an offset; drafts of maps."""

from pathlib import Path

import pytest

from clutch_hil.recordings.contents import draft_map
from clutch_hil.recordings.format import open_recording
from protocols.files.units import to_si
from tests.clutch_hil.recordings.maps import find_refusal, import_by

ABSOLUTE = [
    ("p [bar(a)]", 2.5, -1.01325), ("p (bar abs)", 2.5, -1.01325), ("p {psia}", 36.26, -14.696),
    ("p [kPa absolute]", 250.0, -101.325),
    ("p_abs [bar]", 2.5, -1.01325), ("Druck absolut [mbar]", 2500.0, -1013.25), ("p [bara]", 2.5, -1.01325),
]  # fmt: skip


@pytest.mark.parametrize(("heading", "value", "air"), ABSOLUTE)
def test_a_pressure_above_vacuum_is_not_one_above_the_air(
    tmp_path: Path, heading: str, value: float, air: float
) -> None:
    path = tmp_path / "oil.csv"
    path.write_text(f"time [s],{heading}\n" + "".join(f"{0.01 * n:.2f},{value}\n" for n in range(50)))
    columns = '[columns]\ntime_s = { from = "time" }\npressure_bar = { number = 2 }\n'
    sentence = find_refusal(tmp_path, path, columns)
    assert "says that it is absolute" in sentence
    assert f"set offset = {air:.5g} for it" in sentence
    run = import_by(tmp_path, path, columns.replace("2 }", f"2, offset = {air} }}"))
    assert run["pressure_bar"] == pytest.approx(2.5 - 1.01325, abs=1e-3)
    assert import_by(tmp_path, path, columns.replace("2 }", "2, offset = 0.0 }"))["pressure_bar"][0] == pytest.approx(
        2.5, abs=1e-3
    )


@pytest.mark.parametrize(("heading", "value", "air"), ABSOLUTE)
def test_a_draft_takes_the_air_off(tmp_path: Path, heading: str, value: float, air: float) -> None:
    path = tmp_path / "oil.csv"
    path.write_text(f"time [s],{heading}\n" + "".join(f"{0.01 * n:.2f},{value}\n" for n in range(50)))
    draft = draft_map(path, open_recording(path, {}))
    run = import_by(tmp_path, path, draft)
    assert run[next(name for name in run.columns if name != "time_s")] == pytest.approx(2.5 - 1.01325, abs=1e-3)


def test_a_draft_keeps_letters_that_have_an_accent(tmp_path: Path) -> None:
    path = tmp_path / "oil.csv"
    path.write_text("time [s],Öltemperatur [°C],Größe é [V],扭矩 [Nm]\n" + "0,1,2,3\n" * 20, encoding="utf-8")
    draft = draft_map(path, open_recording(path, {}))
    for name in ("oltemperatur_degc", "grosse_e_v", "column_nm"):
        assert f"\n{name} = " in draft


@pytest.mark.parametrize("heading", ["p [bar]", "p [barg]", "absorber [bar]", "p_clutch (psi)"])
def test_other_pressures_are_taken_as_they_are(tmp_path: Path, heading: str) -> None:
    path = tmp_path / "oil.csv"
    path.write_text(f"time [s],{heading}\n" + "".join(f"{0.01 * n:.2f},2.0\n" for n in range(50)))
    run = import_by(tmp_path, path, '[columns]\ntime_s = { from = "time" }\npressure_bar = { number = 2 }\n')
    assert run["pressure_bar"][0] == pytest.approx(2.0 * to_si(1.0, "psi" if "psi" in heading else "bar") / 1e5)
