"""What the eye sees of a screen: the scene, the curves and their axes, the views."""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun.blueprint as rrb
import rerun.chunk

from clutch_hil.live.viewer.blueprint import build_blueprint
from clutch_hil.live.viewer.solids import make_ring_profile, revolve
from protocols.telemetry.batch import Batch
from tests.clutch_hil.live.viewer.screen_recording import (
    SECONDS,
    Logged,
    cut_pieces,
    cut_rows,
    list_cells,
    list_times,
    negate,
)

SCENE_RATES = 20.0, 30.0  # Hz: smooth for the eye, cheap for the viewer


def test_a_curve_that_goes_backwards_has_symmetric_axes(nodes: dict[str, Batch], logged: Logged) -> None:
    logged.make_screen(
        cut_pieces({"plant": negate(nodes["plant"], ("truth_clutch_torque_nm", "truth_slip_speed_rad_s"))})
    )
    logged.list_chunks()
    ends = {}
    for chunk in rerun.chunk.RrdReader(logged.path).stream():
        if chunk.entity_path.endswith("/labels"):
            texts = chunk.to_record_batch()["Points2D:labels"].to_pylist()[-1]
            numbers = [float(text) for text in texts if text.lstrip("-").replace(".", "").isdigit()]
            rises = [0, *(np.flatnonzero(np.diff(numbers) < 0.0) + 1)]  # where the ticks of y begin
            ends[chunk.entity_path] = [(part[0], part[-1]) for part in np.split(numbers, rises[1:])]
    assert ends["/torque_over_slip/labels"] == [(-30.0, 30.0), (-20.0, 20.0)]
    assert ends["/torque_over_pressure/labels"] == [(0.0, 4.0), (-20.0, 20.0)]


def test_the_slip_axis_of_a_recorded_run_is_symmetric_where_it_slips_backwards() -> None:
    def ranges(slips: Sequence[float | None]) -> list[Any]:
        layout = build_blueprint("rig_time", ("/a", "/b"), ("a", "b"), None, slips=slips)
        views = [view for view in _list_views(layout.root_container) if str(view.origin).endswith("/slip")]
        return [view.properties.get("ScalarAxis") for view in views]

    forwards, backwards = ranges((None, 12.0))
    assert forwards is None
    assert backwards.range.as_arrow_array().to_pylist() == [[-12.0, 12.0]]


@pytest.mark.parametrize("size", [7, 20, 1000])
def test_the_scene_moves_at_a_rate_for_the_eye(nodes: dict[str, Batch], tmp_path: Path, size: int) -> None:
    logged = Logged(tmp_path / "scene.rrd")
    logged.make_screen(cut_rows(nodes["plant"], k, k + size) for k in range(0, len(nodes["plant"].rows), size))
    frames = len(list_times(logged.list_chunks()["/scene/a/piston"]))
    assert SCENE_RATES[0] <= frames / SECONDS <= SCENE_RATES[1]


def test_the_plates_close_with_the_piston(nodes: dict[str, Batch], logged: Logged) -> None:
    logged.make_screen(cut_pieces(nodes))
    plates = np.array(list_cells(logged.list_chunks()["/scene/a/steel"], "InstancePoses3D:translations"))[..., 0]
    gaps = np.diff(plates, axis=1)
    assert (gaps[-1] < 0.8 * gaps[0]).all()
    assert gaps[-1] == pytest.approx(2 * 0.16)  # the thickness of the friction plate and of the steel plate


def test_a_turned_part_has_the_volume_of_a_ring() -> None:
    mesh = revolve(make_ring_profile(0.0, 2.0, 1.0, 3.0), 0xFFFFFFFF)
    corners = np.array(mesh.vertex_positions.as_arrow_array().flatten()).reshape(-1, 3)
    triangles = corners[np.array(mesh.triangle_indices.as_arrow_array().flatten()).reshape(-1, 3)]
    volume = abs(np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum()) / 6.0
    assert volume == pytest.approx(np.pi * (3.0**2 - 1.0**2) * 2.0, rel=0.01)  # of 48 flat sectors


def test_trails_join_up_whatever_the_batches(nodes: dict[str, Batch], logged: Logged) -> None:
    logged.make_screen(cut_rows(nodes["plant"], k, k + 33) for k in range(0, len(nodes["plant"].rows), 33))
    strips = list_cells(logged.list_chunks()["/torque_over_pressure/data/true"], "LineStrips2D:strips")
    for (before,), (after,) in pairwise(strips):
        assert before[-1] == after[0]


def test_the_corner_of_both_axes_has_one_zero(nodes: dict[str, Batch], logged: Logged) -> None:
    """In a narrow page two of them cover each other."""
    logged.make_screen([nodes["plant"]])
    logged.list_chunks()
    for chunk in rerun.chunk.RrdReader(logged.path).stream():
        if chunk.entity_path in ("/torque_over_pressure/labels", "/torque_over_slip/labels"):
            assert chunk.to_record_batch()["Points2D:labels"].to_pylist()[-1].count("0") == 1


def test_axes_grow_with_the_data(nodes: dict[str, Batch], logged: Logged) -> None:
    plant = nodes["plant"]
    rows = plant.rows.copy()
    rows[:, [c.name for c in plant.columns].index("truth_clutch_torque_nm")] *= 10.0
    logged.make_screen([cut_rows(plant, 0, len(rows), rows=rows)])
    logged.list_chunks()
    labels = []
    for chunk in rerun.chunk.RrdReader(logged.path).stream():
        if chunk.entity_path == "/torque_over_slip/labels":
            labels += chunk.to_record_batch()["Points2D:labels"].to_pylist()[-1]
    assert max(float(text) for text in labels if text.isdigit()) >= 10.0 * plant["truth_clutch_torque_nm"].max()


@pytest.mark.parametrize("prefixes", [("",), ("/a", "/b")], ids=["one bench", "two runs"])
def test_every_view_has_content(nodes: dict[str, Batch], tmp_path: Path, prefixes: tuple[str, ...]) -> None:
    layout = build_blueprint("rig_time", prefixes, [prefix.strip("/") for prefix in prefixes], None)
    logged = Logged(tmp_path / "run.rrd")
    for prefix in prefixes:
        logged.make_screen(cut_pieces(nodes), "rig_time", prefix)
    entities = list(logged.list_chunks())
    views = list(_list_views(layout.root_container))
    assert len(views) >= 18 * len(prefixes)
    for view in views:
        assert any(entity.startswith(f"{view.origin}/") or entity == view.origin for entity in entities), view.name


def _list_views(part: Any) -> Iterable[rrb.View]:
    if isinstance(part, rrb.View):
        yield part
    else:
        for inner in part.contents:
            yield from _list_views(inner)
