"""Blueprint: layout of the viewer's window, for one bench or for two runs side by side; designed for 1600 x 900."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import rerun.blueprint as rrb
from rerun.blueprint.archetypes import TimeAxis, VisibleTimeRanges

from clutch_hil.live.viewer import curves, scene
from clutch_hil.live.viewer.dashboard import PLOTS, REST
from clutch_hil.live.viewer.screen import EVENTS
from clutch_hil.live.viewer.times import RIG_TIME, TIME
from clutch_hil.live.viewer.torque import ERROR
from protocols.can.two_clutches import CLUTCHES

_TRAIL_SECONDS = 5.0  # s shown in the x-y plots; an engagement of the clutch takes less
_AXES = ((-16.0, 200.0), (-98.0, 16.0))  # range of an x-y plot: its axes, and margins for the tick labels
_TITLES = {plot.path: plot.title for plot in (*PLOTS, REST)} | {
    ERROR: "torque error, + is above the demand [Nm]",
    "states": "phase, clutch, fault",
    "flags": "controller's flags",
}


def build_blueprint(
    timeline: str = TIME,
    prefixes: Sequence[str] = ("",),
    names: Sequence[str] = ("",),
    window: float | None = 10.0,
    light: bool = False,
    slips: Sequence[float | None] = (),
) -> rrb.Blueprint:
    """Return the layout for one bench, or with two `prefixes` for two runs side by side under their `names`.

    window: displayed time before the cursor [s], None for all. light: for a light screen. slips: reach of each bench's slip
    axis to both sides [rad/s], where known.
    """
    benches = [
        _BenchViews(timeline, prefix.rstrip("/"), name, window, slip)
        for prefix, name, slip in zip(prefixes, names, slips or [None] * len(prefixes), strict=True)
    ]
    first = benches[0]
    tabs = (
        [first.make_light_views()]
        if light
        else first.make_tabs()
        if len(benches) == 1
        else _make_side_by_side_tabs(benches)
    )
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.TopPanel(state="expanded"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=timeline, play_state="following" if timeline == TIME else "paused"),
        auto_layout=False,
        auto_views=False,
    )


def _make_side_by_side_tabs(benches: Sequence["_BenchViews"]) -> list[Any]:
    """Return the tabs of several runs: the same plots left and right."""
    return [
        rrb.Horizontal(*(bench.make_main_views() for bench in benches), name="runs"),
        rrb.Horizontal(*(bench.make_motion_views() for bench in benches), name="curves and scene"),
        rrb.Horizontal(*(bench.make_controller_views() for bench in benches), name="controller"),
        rrb.Horizontal(*(bench.make_more_views() for bench in benches), name="all signals"),
    ]


@dataclass(frozen=True)
class _BenchViews:
    """The views of one bench."""

    timeline: str
    prefix: str
    name: str
    window: float | None
    slip: float | None

    def make_tabs(self) -> list[Any]:
        """Return the tabs of a single bench."""
        middle = rrb.Vertical(
            self._make_curve(0), self._make_curve(1), self._plot("voltage"), self._plot("adaptation"),
            row_shares=[2.0, 2.0, 1.25, 1.25],
        )  # fmt: skip
        right = rrb.Vertical(
            self._make_scene(), self._plot("temperature"), self._plot("timing"), row_shares=[3.0, 1.5, 2.0]
        )
        return [
            rrb.Horizontal(self.make_main_views(), middle, right, column_shares=[2.0, 1.0, 1.0], name="bench"),
            self.make_controller_views(),
            self.make_more_views(),
        ]

    def make_light_views(self) -> Any:
        """Return the views of a light screen."""
        left = rrb.Vertical(
            self._plot("torque"),
            self._plot("pressure"),
            self._make_slip_view(),
            self._make_lanes("states"),
            row_shares=[2.0, 1.9, 1.9, 1.8],
        )
        right = rrb.Vertical(
            self._make_curve(0),
            self._make_curve(1),
            self._plot("voltage"),
            self._plot("timing"),
            row_shares=[2.0, 2.0, 1.3, 2.0],
        )
        return rrb.Horizontal(left, right, column_shares=[1.7, 1.0], name="bench")

    def make_main_views(self) -> Any:
        """Return torque, pressure, slip and state over one time axis."""
        return rrb.Vertical(
            self._plot("torque"),
            self._plot(ERROR),
            self._plot("pressure"),
            self._make_slip_view(),
            self._make_lanes("states"),
            row_shares=[2.0, 1.3, 2.0, 2.0, 2.0],
        )

    def make_motion_views(self) -> Any:
        """Return scene and x-y plots."""
        return rrb.Vertical(self._make_scene(), self._make_curve(0), self._make_curve(1))

    def make_controller_views(self) -> Any:
        """Return every term of the control law, its adaptation and flags, and parameter changes."""
        return rrb.Vertical(
            rrb.Horizontal(self._plot("terms"), self._plot("feedforward")),
            rrb.Horizontal(self._plot("balance"), self._make_events()),
            self._make_lanes("flags"),
            name="controller",
        )

    def make_more_views(self) -> Any:
        """Return every signal that is in no other plot."""
        paths = [plot.path for plot in (*PLOTS, REST) if plot.path.startswith("more/")]
        return rrb.Grid(*(self._plot(path) for path in paths), grid_columns=3, name="all other signals")

    def _plot(self, path: str, **options: Any) -> rrb.TimeSeriesView:
        # the legend covers the oldest rows of a window, or the release at the end of a whole run
        corner = rrb.Corner2D.RightTop if self.window is None else rrb.Corner2D.LeftTop
        return rrb.TimeSeriesView(
            origin=f"{self.prefix}/{path}",
            name=self._make_title(_TITLES[path]),
            plot_legend=rrb.PlotLegend(visible=True, corner=corner),
            axis_x=self._make_axis(),
            time_ranges=self._make_range(self.window),
            **options,
        )

    def _make_slip_view(self) -> rrb.TimeSeriesView:
        axis = rrb.ScalarAxis(range=(-self.slip, self.slip)) if self.slip else None
        return self._plot("slip", axis_y=axis)

    def _make_lanes(self, path: str) -> rrb.StateTimelineView:
        return rrb.StateTimelineView(
            origin=f"{self.prefix}/{path}",
            name=self._make_title(_TITLES[path]),
            time_view=self._make_axis(),
            time_ranges=self._make_range(self.window),
        )

    def _make_curve(self, number: int) -> rrb.Spatial2DView:
        curve = curves.make_curves()[number]
        trails = [curves.make_trail_path(curve, trail, clutch) for trail in curve.trails for clutch in CLUTCHES]
        tail = self._make_range(None if self.window is None else _TRAIL_SECONDS)
        return rrb.Spatial2DView(
            origin=f"{self.prefix}/{curve.path}",
            name=self._make_title(curve.title),
            visual_bounds=rrb.VisualBounds2D(x_range=_AXES[0], y_range=_AXES[1]),
            overrides={f"{self.prefix}/{trail}": VisibleTimeRanges(tail) for trail in trails},
        )

    def _make_scene(self) -> rrb.Spatial3DView:
        return rrb.Spatial3DView(
            origin=f"{self.prefix}/{scene.PATH}",
            name=self._make_title("clutch (not to scale)"),
            line_grid=False,
            eye_controls=rrb.EyeControls3D(position=scene.EYE, look_target=scene.TARGET, eye_up=(0.0, 0.0, 1.0)),
        )

    def _make_events(self) -> rrb.TextLogView:
        columns = rrb.TextLogColumns(timeline_columns=[RIG_TIME], text_log_columns=["Body"])
        return rrb.TextLogView(origin=f"{self.prefix}/{EVENTS}", name=self._make_title("events"), columns=columns)

    def _make_title(self, what: str) -> str:
        return f"{self.name}: {what}" if self.name else what

    def _make_axis(self) -> TimeAxis:
        """Return the time axis: shared by all plots for a whole run, otherwise as wide as the window."""
        if self.window is None:
            return TimeAxis(link="LinkToGlobal")
        shown = self._make_range(self.window).range
        return TimeAxis(view_range=shown)

    def _make_range(self, window: float | None) -> rrb.VisibleTimeRange:
        """Return the time range of the last `window` [s] before the cursor, None for all."""
        start, end = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.infinite()
        if window is not None:
            start = rrb.TimeRangeBoundary.cursor_relative(seconds=-window)
            end = rrb.TimeRangeBoundary.cursor_relative()
        return rrb.VisibleTimeRange(self.timeline, start=start, end=end)
