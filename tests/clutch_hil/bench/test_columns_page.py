"""docs/columns.md is what the declarations give, and what screens and pictures name is declared."""

import pytest

from clutch_hil.bench.columns_page import PAGE, compose_page
from clutch_hil.live.monitor.snapshot import QUANTITIES
from clutch_hil.live.viewer import curves
from clutch_hil.live.viewer.dashboard import PLOTS
from plant_sim.node.plant_node import PlantNode
from plant_sim.node.power_shift_node import PowerShiftNode
from protocols.can.frames import load_frames
from protocols.realtime.beat import TIMING
from protocols.telemetry.batch import list_run_columns
from rt_controller.loop.node import ControllerNode

PLANT = (*PlantNode.columns, *(column._replace(name=f"plant_{column.name}") for column in TIMING))
CONTROLLER = list_run_columns("controller", (*ControllerNode.columns, *TIMING))
UNITS = {column.name: column.unit for column in (*PLANT, *CONTROLLER)}  # of a bench with one clutch


def test_the_page_is_what_the_declarations_give() -> None:
    assert PAGE.read_text(encoding="utf-8") == compose_page(), "write it by python -m clutch_hil.bench.columns_page"


def test_the_page_has_every_column_and_signal() -> None:
    lines = compose_page().splitlines()
    for column in (*PlantNode.columns, *PowerShiftNode.columns, *TIMING):
        assert f"| `{column.name}` | {column.unit} | {column.meaning} |" in lines
    for column in list_run_columns("controller", ControllerNode.columns):
        assert f"| `{column.name}` | {column.unit} | {column.meaning} |" in lines
    for codec in load_frames().values():
        begin = lines.index(f"### {codec.name}")
        for name in codec.signals:
            assert any(line.startswith(f"| `{name.upper()}` |") for line in lines[begin : begin + 15]), name


@pytest.mark.parametrize("node", [PlantNode, PowerShiftNode, ControllerNode])
def test_no_column_is_declared_twice(node: type) -> None:
    names = [column.name for column in node.columns]  # type: ignore[attr-defined]
    assert len(set(names)) == len(names)


def test_what_a_screen_names_is_declared() -> None:
    lines = {line.column for plot in PLOTS for line in plot.lines}
    trails = {name for curve in curves.make_curves() for trail in curve.trails for name in (trail.x, trail.y)}
    assert lines | trails | {quantity.column for quantity in QUANTITIES} <= UNITS.keys()
    assert [q.unit for q in QUANTITIES] == [UNITS[q.column] for q in QUANTITIES]
