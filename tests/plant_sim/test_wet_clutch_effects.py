"""Effects of the wet clutch: none where they are off, and what friction level and seal friction do."""

import ast
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plant_sim.rigs import clutch_unit, standstill, wet_clutch
from tests.plant_sim.wet_clutch_reference import A_CYL, BAR
from tests.plant_sim.wet_clutch_states import (
    NOMINAL,
    STEP,
    find_pressing_voltage,
    make_rest_state,
    make_rig,
    make_triangle,
    press_plates,
    run,
)

LOOP_WIDTH = 0.1  # relative: the springs and the slow pressure ramp add to the seal's 2 W / A; measured 4 %


class _WithoutHooks(ast.NodeTransformer):
    """The rig's source as if hooks had never been written."""

    def visit_If(self, node: ast.If) -> ast.AST | None:
        self.generic_visit(node)
        return None if "has_law(" in ast.unparse(node.test) else node

    def visit_keyword(self, node: ast.keyword) -> ast.keyword | None:
        return None if node.arg == "cache" else node  # Numba keeps no cache for source without a file

    def visit_Assign(self, node: ast.Assign) -> ast.AST | None:
        self.generic_visit(node)
        return None if "bind_laws(" in ast.unparse(node.value) else node

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return ast.Constant(None) if node.id == "e" and isinstance(node.ctx, ast.Load) else node


def compile_without_hooks() -> Any:
    """`Rig.advance` of a rig without hooks."""
    scope: dict[str, Any] = {"__name__": "rig_without_hooks"}
    modules = (clutch_unit, standstill, wet_clutch)
    names = {module.__name__ for module in modules}
    for module in modules:
        path = Path(module.__file__)
        tree = _WithoutHooks().visit(ast.parse(path.read_text()))
        tree.body = [n for n in tree.body if not (isinstance(n, ast.ImportFrom) and n.module in names)]
        source = ast.unparse(ast.fix_missing_locations(tree))
        assert "has_law(" not in source
        assert "call(" not in source
        scope["__file__"] = str(path)
        exec(compile(source, f"<{path.stem} without hooks>", "exec"), scope)
    return scope["advance"]


def test_effects_off_is_bit_identical_to_a_rig_that_never_had_hooks() -> None:
    kernel = compile_without_hooks()

    class Bare:
        table = NOMINAL.table

        @staticmethod
        def advance(before: wet_clutch.Whole, *inputs: float) -> wet_clutch.Whole:
            *held, duration, substeps = inputs
            return wet_clutch.Whole(*kernel(*before, *held, NOMINAL.record, None, duration, substeps))

    pieces = [*STEP, (1.5, -10.0, 250), (1.2, 24.0, 150), (0.0, 24.0, 200)]
    ours, theirs = (run(make_rest_state(20.0, 50.0), pieces, rig) for rig in (NOMINAL, Bare))
    assert ours.tobytes() == theirs.tobytes()
    other = run(make_rest_state(20.0, 50.0), pieces, make_rig(friction_level__level=0.9))
    assert ours.tobytes() != other.tobytes()


def test_effects_attached_but_off_are_bit_identical_to_the_baseline() -> None:
    every = wet_clutch.Rig(wet_clutch.load_nominal(), also=("friction_level", "piston_seal_friction"))
    assert len(every.table.calls) == 2
    pieces = [*STEP, (1.5, -10.0, 250), (1.2, 24.0, 150), (0.0, 24.0, 200)]
    assert (
        run(make_rest_state(20.0, 50.0), pieces, every).tobytes() == run(make_rest_state(20.0, 50.0), pieces).tobytes()
    )


def test_friction_level_scales_the_torque_and_drifts_in_time() -> None:
    heavy = {"motor__inertia": 10.0}  # the same slip for all
    nominal, weak, drifting = (
        run(make_rest_state(20.0), STEP, make_rig(**heavy, **changed))
        for changed in ({}, {"friction_level__level": 0.8}, {"friction_level__drift": 0.1})
    )
    factor = 1.0 + 0.1 * nominal["time"]
    closed = nominal["clutch_torque"] > 5.0
    for states, expected in ((weak, 0.8), (drifting, factor[closed])):
        ratio = states["clutch_torque"][closed] / nominal["clutch_torque"][closed]
        assert ratio == pytest.approx(expected, abs=1e-3)  # slip differs by 1e-3 through the inertia


def test_a_drift_switched_on_late_begins_where_the_level_is() -> None:
    late = press_plates(3.4, 20.0)
    late["time"] = 600.0
    drifting, nominal = (
        run(late, [(find_pressing_voltage(3.4), 20.0, 10)], rig)
        for rig in (make_rig(friction_level__drift=-0.1), NOMINAL)
    )
    assert drifting["clutch_torque"] == pytest.approx(nominal["clutch_torque"], rel=2e-3)  # 0.1 % in 10 ms
    assert drifting["clutch_torque"][-1] < nominal["clutch_torque"][-1]


def measure_hysteresis(force: float) -> np.ndarray:
    """Torque opening less torque closing [Nm] at equal cylinder pressures, away from the turning points."""
    states = run(
        press_plates(2.45, 20.0), make_triangle(2.45, 4.2, 2.0, 20.0), make_rig(piston_seal_friction__force=force)
    )
    pressure, torque = states["pressure"] / BAR, states["clutch_torque"]
    top = np.argmax(pressure)
    grid = np.linspace(2.9, 3.5, 7)
    closing = np.interp(grid, pressure[:top], torque[:top])
    return np.interp(grid, pressure[:top:-1], torque[:top:-1]) - closing


def test_seal_friction_opens_the_loop_of_fig_6_11_with_opening_above_closing() -> None:
    none = np.abs(measure_hysteresis(0.0))
    widths = {force: measure_hysteresis(force) for force in (30.0, 60.0, 120.0)}
    slope = 10.8 * 0.8357 + 2.67 * 20.0 ** (1 / 3)  # Nm/bar at 20 rad/s
    for force, width in widths.items():
        assert (width > 10 * none.max()).all()
        assert width.mean() == pytest.approx(slope * 2 * force / (A_CYL * BAR), rel=LOOP_WIDTH)
    assert widths[30.0].mean() < widths[60.0].mean() < widths[120.0].mean()


def test_seal_friction_never_exceeds_its_break_away_force() -> None:
    states = run(make_rest_state(20.0), [*STEP, (0.0, 20.0, 250)], make_rig(piston_seal_friction__force=60.0))
    assert states["seal_force"].max() == 60.0
    assert states["seal_force"].min() == -60.0
