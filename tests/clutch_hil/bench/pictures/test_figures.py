"""Pictures of sweeps: what is drawn of a table, and what cannot be."""

from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from matplotlib.collections import PathCollection, QuadMesh

import clutch_hil as ch

ERROR = pa.field("regime_error_nm", pa.float64(), metadata={"unit": "Nm"})


def make_table(samples: list[dict[str, float]], seeds: int = 1) -> pa.Table:
    """A sweep whose measure is the sum of the sample and a tenth of the seed."""
    rows = [(sample, seed) for sample in samples for seed in range(1, seeds + 1)]
    columns: dict[str, Any] = {name: [sample[name] for sample, _ in rows] for name in samples[0]}
    columns |= {"seed": [seed for _, seed in rows], "regime_error_nm": [sum(s.values()) + 0.1 * k for s, k in rows]}
    columns |= {"fault": ["none"] * len(rows)}
    made = pa.table(columns)
    return made.cast(pa.schema([ERROR if field.name == ERROR.name else field for field in made.schema]))


def find_drawn(axes: Any, kind: type) -> Any:
    """The only one of this kind."""
    (one,) = [child for child in axes.get_children() if isinstance(child, kind)]
    return one


def test_over_one_parameter_runs_are_points_and_a_line_goes_through_their_means() -> None:
    figure = ch.draw_sweep(make_table(ch.grid({"a.b": [3.0, 1.0]}), seeds=3), "a.b", "regime_error_nm")
    (axes,) = figure.axes
    assert len(find_drawn(axes, PathCollection).get_offsets()) == 6
    (line,) = axes.lines
    np.testing.assert_allclose(line.get_xydata(), [[1.0, 1.2], [3.0, 3.2]])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("a.b", "regime_error_nm [Nm]")


def test_where_others_were_varied_too_there_is_no_line() -> None:
    figure = ch.draw_sweep(make_table(ch.grid({"a.b": [1.0, 2.0], "c.d": [0.0, 1.0]})), "a.b", "regime_error_nm")
    assert not figure.axes[0].lines


def test_over_two_parameters_of_a_grid_it_is_a_map() -> None:
    samples = ch.grid({"a.b": [1.0, 2.0, 4.0], "c.d": [10.0, 20.0]})
    figure = ch.draw_sweep(make_table(samples[::-1], seeds=2), ["a.b", "c.d"], "regime_error_nm")
    axes, bar = figure.axes
    np.testing.assert_allclose(
        np.ravel(find_drawn(axes, QuadMesh).get_array()), [11.15, 12.15, 14.15, 21.15, 22.15, 24.15]
    )
    assert (axes.get_xlabel(), axes.get_ylabel(), bar.get_ylabel()) == ("a.b", "c.d", "regime_error_nm [Nm]")


def test_over_two_parameters_of_a_hypercube_runs_are_dots() -> None:
    samples = ch.latin_hypercube({"a.b": (0.0, 1.0), "c.d": (0.0, 1.0)}, 7)
    axes = ch.draw_sweep(make_table(samples), ["a.b", "c.d"], "regime_error_nm").axes[0]
    assert len(find_drawn(axes, PathCollection).get_offsets()) == 7


def test_runs_that_cannot_be_measured_are_counted() -> None:
    made = make_table(ch.grid({"a.b": [1.0, 2.0]}))
    made = made.set_column(2, ERROR, pa.array([1.0, float("nan")]))
    figure = ch.draw_sweep(made, "a.b", "regime_error_nm")
    assert len(find_drawn(figure.axes[0], PathCollection).get_offsets()) == 1
    assert figure.get_suptitle() == "2 runs, of which 1 cannot be measured"


@pytest.mark.parametrize(
    ("x", "y", "sentence"),
    [
        ("a.c", "regime_error_nm", "the sweep has no parameter 'a.c'; did you mean a.b"),
        ("seed", "regime_error_nm", "the sweep has no parameter 'seed'"),
        (["a.b", "a.b"], "regime_error_nm", "allowed are one or two parameters"),
        ([], "regime_error_nm", "drawn over nothing"),
        ("a.b", "fault", "the sweep has no numeric measure 'fault'; known are regime_error_nm"),
    ],
)
def test_what_cannot_be_drawn_is_said_in_one_sentence(x: Any, y: str, sentence: str) -> None:
    with pytest.raises(ch.InputError, match=sentence):
        ch.draw_sweep(make_table(ch.grid({"a.b": [1.0], "c.d": [2.0]})), x, y)


def test_a_run_of_two_clutches_is_drawn_as_its_rig_is() -> None:
    figure = ch.draw_run(ch.simulate("shift", seconds=3.0), "a shift")
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert "output torque [Nm]" in labels
    assert figure.get_suptitle() == "a shift"


def test_a_run_that_lacks_what_is_drawn_of_its_rig_is_refused() -> None:
    run = ch.Run({"time_s": np.zeros(2)}, {"rig": "power_shift"})
    with pytest.raises(
        ch.InputError,
        match=r"the run has no column '.*', which the picture \(.*make_shift_sheet\) of the rig power_shift needs",
    ):
        ch.draw_run(run)
