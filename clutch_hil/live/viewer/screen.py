"""Screen: log everything displayed of one bench to a rerun recording."""

from typing import Protocol

import numpy as np
import rerun as rr

from clutch_hil.bench.pictures import palette
from clutch_hil.live.tuning.catalogue import format_step
from clutch_hil.live.viewer.canvas import Canvas, make_scalar_columns
from clutch_hil.live.viewer.clutch_batches import split_by_clutch
from clutch_hil.live.viewer.curves import Curves, make_curves
from clutch_hil.live.viewer.dashboard import LIGHT, Place, list_places
from clutch_hil.live.viewer.decimator import Decimator
from clutch_hil.live.viewer.scene import Scene
from clutch_hil.live.viewer.states import States
from clutch_hil.live.viewer.times import RIG_TIME, TIME, Times, make_times
from clutch_hil.live.viewer.torque import TorqueDemand, TorqueError
from protocols.can.two_clutches import CLUTCHES
from protocols.errors import InputError
from protocols.node import Column
from protocols.telemetry.batch import Batch

EVENTS = "events"
DEADLINE = "timing/deadline"
TIMELINES = (TIME, RIG_TIME)


class Part(Protocol):
    """Interface of a part of the drawing of a clutch; its rows have the column names of a single clutch."""

    def open(self) -> None:
        """Log everything that does not depend on time."""

    def log(self, batch: Batch, times: Times) -> None:
        """Log the rows of a batch at their times."""


class Screen:
    """Log batches of a bench below `prefix` ("/a"), so that one recording can contain several runs. Raises InputError.

    timeline: with "time" rows are logged at UNIX time as well, otherwise only at the rig's time since the run's start
    ("rig_time"). light: only the most important plots, with all their rows; a browser without a graphics card accepts some ten
    messages of rerun per second, one for each entity.
    """

    def __init__(
        self, recording: rr.RecordingStream, timeline: str = TIME, prefix: str = "", light: bool = False
    ) -> None:
        if timeline not in TIMELINES:
            raise InputError(f"timeline {timeline!r} is unknown; allowed are {', '.join(TIMELINES)}")
        self._live = timeline == TIME
        self._canvas = Canvas(recording, prefix)
        self._light = light
        self._curves = make_curves()  # one pair for all clutches
        self._parts = {CLUTCHES[0]: self._make_parts(CLUTCHES[0])}  # by clutch; those of b start with its first rows
        self._places: dict[str, tuple[tuple[Column, ...], list[Place]]] = {}  # by node, as announced
        self._last: dict[str, tuple[float, Times]] = {}  # rate and times of the newest batch by node
        self._sessions: dict[str, int] = {}  # by node
        self._deadline_of = ""  # node whose rows carry the deadline
        self._deadlines = Decimator(10.0)  # Hz: a straight line

    def open(self) -> None:
        """Log everything that does not depend on time: shapes, axes, names, colours. Repeat it after a reconnect."""
        self._places.clear()
        for parts in self._parts.values():
            for part in parts:
                part.open()
        limit = rr.SeriesLines(names=["deadline [us]"], colors=[palette.make_rgba(palette.LIMIT)], widths=[1.0])
        self._canvas.log_static(DEADLINE, limit)
        self._canvas.log_static(EVENTS, rr.TextLog.from_fields(color=palette.make_rgba(palette.TEXT)))

    def log(self, batch: Batch) -> None:
        """Log the rows of a batch: every column once, and the drawings made from them."""
        if not len(batch.rows):
            return
        when = make_times(batch, self._live)
        for place in self._announce(batch):
            self._canvas.send(place.path, when, make_scalar_columns(batch.rows[:, place.numbers]))
        self._deadline_of = self._deadline_of or batch.node  # one line for both
        if batch.node == self._deadline_of and any("_work_us" in column.name for column in batch.columns):
            ends = when[self._deadlines.pick(when)]
            self._canvas.send(DEADLINE, ends, make_scalar_columns(np.full((len(ends), 1), 1e6 / batch.rate)))
        for clutch, own in split_by_clutch(batch):
            if clutch not in self._parts:
                self._parts[clutch] = self._make_parts(clutch)
                for part in self._parts[clutch]:
                    part.open()
            for part in self._parts[clutch]:
                part.log(own, when)
        if self._sessions.get(batch.node) != batch.session:
            self._sessions[batch.node] = batch.session
            signals = f"{batch.rate:g} Hz, {len(batch.columns)} signals"
            self._note(when[:1], f"{batch.node}: {signals}, from row {batch.first_row} on")
        self._last[batch.node] = batch.rate, when

    def log_event(self, event: dict) -> None:
        """Log a parameter change {"node", "name", "old", "new", "unit", "row", "time" [s, UNIX]} as text."""
        unit = f" {event['unit']}" if event.get("unit") not in (None, "", "1") else ""
        by = f", by {event['by']}" if "by" in event else ""
        text = f"{event['node']}: {event['name']} {format_step(event['old'], event['new'])}{unit}{by}"
        row, rig = int(event["row"]), 0
        if event["node"] in self._last:
            rate, last = self._last[event["node"]]
            rig = int(last.rig[-1]) + round((row - int(last.row[-1])) * 1e9 / rate)
        unix = np.array([round(event["time"] * 1e9)]) if self._live else None
        self._note(Times(np.array([row]), np.array([rig]), unix), text)

    def _make_parts(self, clutch: str) -> tuple[Part, ...]:
        """Return the drawn parts of a clutch, a or b."""
        canvas = self._canvas
        more = () if self._light else (TorqueError(canvas, clutch), Scene(canvas, clutch))
        return (States(canvas, clutch), Curves(canvas, self._curves, clutch), TorqueDemand(canvas, clutch), *more)

    def _announce(self, batch: Batch) -> list[Place]:
        """Return the places of a batch's columns; log their names, units and colours if they are new."""
        known = self._places.get(batch.node)
        if known is not None and known[0] == batch.columns:
            return known[1]
        drawn = list_places(batch.node, batch.columns)
        if self._light:
            drawn = [place for place in drawn if place.path.partition("/")[0] in LIGHT]
        for place in drawn:
            names, units = [c.name for c in place.columns], [c.unit for c in place.columns]
            self._canvas.log_static(
                place.path,
                rr.SeriesLines(
                    names=place.labels,
                    colors=np.array([palette.make_rgba(colour) for colour in place.colours], dtype=np.uint32),
                    widths=[line.width for line in place.lines],
                ),
                rr.AnyValues(
                    columns=names,
                    units=units,
                    index=place.numbers,
                    node=batch.node,
                    rate_hz=float(batch.rate),
                    path=place.path,
                ),
            )
        self._places[batch.node] = batch.columns, drawn
        return drawn

    def _note(self, when: Times, text: str) -> None:
        self._canvas.send(EVENTS, when, rr.TextLog.columns(text=[text], level=["INFO"]))
