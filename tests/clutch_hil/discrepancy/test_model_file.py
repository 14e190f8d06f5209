"""Model files: what the search found is what the simulator runs, and what cannot be is refused before anything is written."""

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from clutch_hil.command import make_application
from clutch_hil.discrepancy.model_file import combine_hashes, read_model, write_model
from clutch_hil.discrepancy.models.position_axis import PositionAxis
from clutch_hil.discrepancy.result import NAMED, Estimate, Result
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.files.runs import read_run

SHIPPED = wet_clutch.load_nominal()
FORCE = Estimate("piston_seal_friction.force", 61.8, "N", (60.0, 63.6), 0.0)
SLOPE = Estimate("clutch.coulomb_slope", 10.91, "Nm/bar", (10.85, 10.97), 10.8, 0.3)
HASHES = {"a.parquet": "aa" * 32, 'odd "name"\n.parquet': "bb" * 32}


def make_result(parameters: list[Estimate], baseline: list[Estimate], rig: str = "wet_clutch") -> Result:
    nothing: dict[str, Any] = {
        "alternatives": [], "where": [], "gap": {}, "gap_by_regime": {}, "rivals": [], "surrogate": None, "experiment": None,
        "floors": {}, "units": {}, "equations": {}, "seconds": 1.0,
    }  # fmt: skip
    return Result(
        rig=rig, verdict=NAMED, effects=["piston_seal_friction"], confidence=0.97, parameters=parameters, baseline=baseline,
        hashes=HASHES, **nothing,
    )  # fmt: skip


def test_the_rig_reads_what_was_found(tmp_path: Path) -> None:
    write_model(make_result([FORCE], [SLOPE]), SHIPPED, path := tmp_path / "out" / "model.toml")
    model = wet_clutch.load_nominal(path)
    assert model == read_model(path, SHIPPED)
    for estimate, half in ((FORCE, 1.8), (SLOPE, 0.06)):
        parameter = model[estimate.name]
        assert parameter.value == estimate.value
        assert parameter.uncertainty == pytest.approx(half / 1.96, rel=1e-3)
        assert f"fitted by clutch-hil discrepancy, 95 % interval {estimate.ci95[0]:g}.." in parameter.source
        assert combine_hashes(HASHES)[:16] in parameter.source
    changed = {name for name in model if model[name] != SHIPPED[name]}
    assert changed == {FORCE.name, SLOPE.name}


def test_an_interval_that_ends_at_a_bound_makes_no_parameter_more_certain(tmp_path: Path) -> None:
    at_bound = replace(FORCE, value=0.0, ci95=(0.0, 2.0))
    write_model(make_result([at_bound], []), SHIPPED, path := tmp_path / "model.toml")
    assert wet_clutch.load_nominal(path)[FORCE.name].uncertainty == pytest.approx(2.0 / 1.96, rel=1e-3)


def test_numbers_of_numpy_are_written_as_numbers(tmp_path: Path) -> None:
    declared = ParameterSet({n: replace(p, uncertainty=np.float64(p.uncertainty)) for n, p in SHIPPED.items()})
    carried = replace(make_result([], []), surrogate={"values": {"residual_torque.offset": np.float64(0.5)}})
    write_model(carried, declared, path := tmp_path / "model.toml")
    assert wet_clutch.load_nominal(path)["residual_torque.offset"].value == 0.5


def test_the_head_says_what_it_was_made_of(tmp_path: Path) -> None:
    write_model(make_result([FORCE], [SLOPE]), SHIPPED, path := tmp_path / "model.toml")
    head = [line for line in path.read_text().splitlines() if line.startswith("#")]
    assert "named: piston_seal_friction (confidence 0.97)" in "\n".join(head)
    for sha in (*HASHES.values(), combine_hashes(HASHES)):
        assert any(sha in line for line in head)
    assert set(tomllib.loads(path.read_text())) == {"clutch", "piston_seal_friction"}


def test_the_data_hash_does_not_depend_on_paths_or_their_order() -> None:
    assert (
        combine_hashes({"x": "1", "y": "2"})
        == combine_hashes({"b": "2", "a": "1"})
        != combine_hashes({"x": "1", "y": "3"})
    )


def test_what_the_search_began_with_stays_in_the_model(tmp_path: Path) -> None:
    write_model(make_result([FORCE], []), SHIPPED, first := tmp_path / "first.toml")
    level = Estimate("friction_level.level", 0.9, "1", (0.89, 0.91), 1.0)
    write_model(make_result([level], [SLOPE]), SHIPPED, second := tmp_path / "second.toml", read_model(first, SHIPPED))
    model = wet_clutch.load_nominal(second)
    assert model[FORCE.name] == wet_clutch.load_nominal(first)[FORCE.name]
    assert (model[level.name].value, model[SLOPE.name].value) == (0.9, 10.91)


@pytest.mark.parametrize(
    ("estimate", "sentence"),
    [
        (replace(FORCE, name="piston_seal_friction.forse"), r"'piston_seal_friction.forse' is unknown.*force"),
        (replace(FORCE, value=2000.0), r"piston_seal_friction.force = 2000 N is outside 0..1000"),
        (replace(FORCE, value=float("nan")), r"piston_seal_friction.force = nan"),
        (replace(FORCE, unit="kN"), r"piston_seal_friction.force was fitted in 'kN'; its unit is 'N'"),
    ],
)
def test_what_the_rig_could_not_read_is_refused(tmp_path: Path, estimate: Estimate, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        write_model(make_result([estimate], [SLOPE]), SHIPPED, tmp_path / "model.toml")
    assert not list(tmp_path.iterdir())


def test_another_rigs_model_has_the_same_form(tmp_path: Path) -> None:
    declared = PositionAxis.list_nominal_parameters()
    ripple = Estimate("position_ripple.amplitude", 3.5, "Nm", (3.2, 3.8), 0.0)
    ripple = replace(ripple, unit=declared[ripple.name].unit)
    write_model(make_result([ripple], [], "position_axis"), declared, path := tmp_path / "model.toml")
    axis = PositionAxis(read_model(path, declared))
    assert "position_ripple" not in {candidate.name for candidate in axis.candidates}  # it is part of the model now


def test_the_simulator_runs_the_extended_model_and_the_run_says_so(tmp_path: Path) -> None:
    write_model(make_result([FORCE], [SLOPE]), SHIPPED, path := tmp_path / "model.toml")
    arguments = ["simulate", "--model", str(path), "--seconds", "0.5", "--rate", "250", "--out", str(tmp_path)]
    CliRunner().invoke(make_application(), arguments)
    metadata = read_run(next(tmp_path.glob("*.parquet"))).metadata
    assert metadata["effects"] == ["piston_seal_friction"]
    assert metadata["settings"]["plant_parameters"] == str(path)
    assert metadata["plant_parameters"][SLOPE.name] == SLOPE.value


def test_what_is_like_nothing_known_is_carried_by_a_surrogate_that_the_rig_runs(tmp_path: Path) -> None:
    name = next(n for n in SHIPPED if n.startswith("residual_torque."))
    unknown = replace(make_result([], [SLOPE]), verdict="none_of_these", effects=[], surrogate={"values": {name: 0.25}})
    write_model(unknown, SHIPPED, path := tmp_path / "model.toml")
    parameter = wet_clutch.load_nominal(path)[name]
    assert parameter.value == 0.25
    assert parameter.source.startswith("surrogate of the missing physics, data SHA-256")
