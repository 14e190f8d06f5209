"""Scene: the clutch as an animated section drawing: oil, piston, return spring, plates, shaft. Not to scale.

The piston's stroke of one millimetre is enlarged, and the gaps between the plates close with it. The oil becomes brighter with
pressure, the friction plates glow with torque, and the shaft turns with the encoder.
"""

from functools import partial
from math import pi
from pathlib import Path

import numpy as np
import rerun as rr

import plant_sim
from clutch_hil.bench.pictures import palette
from clutch_hil.bench.pictures.palette import make_rgba, split_colour
from clutch_hil.live.viewer.canvas import Canvas
from clutch_hil.live.viewer.decimator import Decimator
from clutch_hil.live.viewer.solids import make_ring_profile, revolve
from clutch_hil.live.viewer.times import Times
from plant_sim.profiles.profile import TORQUE_LIMIT
from protocols.can.two_clutches import CLUTCHES
from protocols.files.parameters import load_defaults
from protocols.telemetry.batch import Batch

PATH = "scene"
EYE, TARGET = (5.5, -5.0, 2.1), (2.75, 0.0, -0.1)  # seen from the shaft's side, a little from above
RATE = 25.0  # Hz: smooth for the eye
_COLUMNS = ("truth_piston_position_m", "truth_cylinder_pressure_bar", "truth_clutch_torque_nm")
_ANGLES = ("shaft_angle_rad", "slip_angle_rad")  # of the shaft: with a fixed output, and against a turning output
_PRESSURE, _TORQUE = 4.0, TORQUE_LIMIT / 1.5  # bar, Nm, at full colour: the range of the curves' axes

# Drawing units along the axis, and for radii
_STROKE = 0.55  # drawn length of the piston's clearance
_CHAMBER = 0.25  # length of the oil behind the piston at rest
_PISTON = 0.35  # thickness
_STACK = 2.65  # end of the rod at rest, where the first gap begins
_PLATES, _THICKNESS = 3, 0.16  # friction plates, each between two steel plates
_BORE = 1.5  # radius of the cylinder

# For two clutches: their size, and the heights of a and b, which fill the same view
_SCALE, _HEIGHTS = 0.65, (1.3, -1.4)


class Scene:
    """Log the moving parts of a clutch, a or b, at RATE. If there is a clutch b, both are smaller, a above b."""

    def __init__(self, canvas: Canvas, clutch: str) -> None:
        self._canvas, self._clutch, self._path = canvas, clutch, f"{PATH}/{clutch}"
        self._pace = Decimator(RATE)
        file = Path(plant_sim.__file__).with_name("parameters") / "janssens2010.toml"
        self._clearance = load_defaults(file)["piston.clearance"].si

    def open(self) -> None:
        """Log the shapes."""
        send = self._canvas.log_static
        half = partial(revolve, begin=-pi / 2.0, end=pi / 2.0)  # half behind the section plane
        housing, steel, dark = map(make_rgba, (palette.HOUSING, palette.STEEL, palette.DRUM))
        white = make_rgba(palette.PAPER)
        end = _STACK + _STROKE + (2 * _PLATES + 1) * _THICKNESS
        send(f"{self._path}/housing/bottom", half(make_ring_profile(-0.25, 0.25, 0.0, _BORE + 0.2), housing))
        send(f"{self._path}/housing/cylinder", half(make_ring_profile(0.0, 2.0, _BORE, _BORE + 0.2), housing))
        send(f"{self._path}/housing/wall", half(make_ring_profile(1.8, 0.2, 0.85, _BORE), housing))
        send(f"{self._path}/housing/drum", half(make_ring_profile(2.0, end - 2.0 + 0.25, _BORE, _BORE + 0.2), dark))
        send(f"{self._path}/housing/end", half(make_ring_profile(end, 0.25, 0.55, _BORE), housing))
        send(f"{self._path}/oil", revolve(make_ring_profile(0.0, 1.0, 0.0, _BORE - 0.02), white))
        send(f"{self._path}/piston/head", revolve(make_ring_profile(_CHAMBER, _PISTON, 0.0, _BORE - 0.02), steel))
        send(
            f"{self._path}/piston/rod",
            revolve(make_ring_profile(_CHAMBER + _PISTON, _STACK - _CHAMBER - _PISTON - 0.2, 0.45, 0.62), steel),
        )
        send(f"{self._path}/piston/plate", revolve(make_ring_profile(_STACK - 0.2, 0.2, 0.45, 1.4), steel))
        turns = np.linspace(0.0, 2 * pi * 5, 161)
        coil = np.stack([turns / turns[-1], 1.05 * np.cos(turns), 1.05 * np.sin(turns)], axis=1)
        send(f"{self._path}/spring", rr.LineStrips3D([coil], colors=[make_rgba(palette.SPRING)], radii=0.045))
        send(f"{self._path}/steel", revolve(make_ring_profile(0.0, _THICKNESS, 0.75, _BORE - 0.03), steel))
        send(
            f"{self._path}/rotor/friction",
            revolve(make_ring_profile(0.0, _THICKNESS, 0.4, 1.3), white, stripe=make_rgba(palette.PLATE_STRIPE)),
        )
        send(
            f"{self._path}/rotor/shaft",
            revolve(make_ring_profile(0.9, end + 1.0 - 0.9, 0.0, 0.32), dark, stripe=make_rgba(palette.SHAFT_STRIPE)),
        )
        if self._clutch != CLUTCHES[0]:
            self._place_both()
        send(f"{self._path}/rotor/flange", revolve(make_ring_profile(end + 0.75, 0.25, 0.32, 1.0), dark, stripe=steel))

    def log(self, batch: Batch, times: Times) -> None:
        """Log the frames among the rows."""
        names = {column.name for column in batch.columns}
        angle_name = next((name for name in _ANGLES if name in names), None)
        if angle_name is None or not set(_COLUMNS) <= names:
            return
        rows = self._pace.pick(times)
        position, pressure, torque, angle = (batch[name][rows] for name in (*_COLUMNS, angle_name))
        known = np.isfinite(position + pressure + torque + angle)
        if not known.any():
            return
        self._draw(position[known], pressure[known], torque[known], angle[known], times[rows[known]])

    def _place_both(self) -> None:
        """Log the positions and names of two clutches."""
        for clutch, height in zip(CLUTCHES, _HEIGHTS, strict=True):
            middle = (1.0 - _SCALE) * TARGET[0]  # x, so that the middle stays in the centre of the view
            place = rr.Transform3D(translation=[middle, 0.0, height], scale=_SCALE)
            name = rr.Points3D([[0.0, 0.0, _BORE + 0.4]], labels=[clutch], colors=[make_rgba(palette.TEXT)], radii=0.0)
            self._canvas.log_static(f"{PATH}/{clutch}", place)
            self._canvas.log_static(f"{PATH}/{clutch}/name", name)

    def _draw(
        self, position: np.ndarray, pressure: np.ndarray, torque: np.ndarray, angle: np.ndarray, times: Times
    ) -> None:
        stroke = _STROKE * np.clip(position / self._clearance, 0.0, 1.1)
        zero, one = np.zeros(len(stroke)), np.ones(len(stroke))
        send = self._canvas.send
        oil = _blend(palette.COLD_OIL, palette.PRESSED_OIL, pressure / _PRESSURE)
        scale = np.stack([_CHAMBER + stroke, one, one], axis=1)
        send(f"{self._path}/oil", times, [*rr.Transform3D.columns(scale=scale), *rr.Mesh3D.columns(albedo_factor=oil)])
        along = np.stack([stroke, zero, zero], axis=1)
        send(f"{self._path}/piston", times, rr.Transform3D.columns(translation=along))
        head = _CHAMBER + _PISTON + stroke  # the spring is between piston and wall
        spring = rr.Transform3D.columns(
            translation=np.stack([head, zero, zero], axis=1), scale=np.stack([1.8 - head, one, one], axis=1)
        )
        send(f"{self._path}/spring", times, spring)

        # all gaps share the remaining stroke equally
        count = 2 * _PLATES + 1
        gap = (_STROKE - np.minimum(stroke, _STROKE)) / (count + 1)
        number = np.arange(count)
        x = (_STACK + stroke)[:, None] + gap[:, None] * (number + 1) + _THICKNESS * number
        shift = np.zeros((len(stroke), count, 3))
        shift[..., 0] = x
        send(f"{self._path}/steel", times, _make_poses(shift[:, 0::2]))
        glow = _blend(palette.COLD_PLATE, palette.LOADED_PLATE, np.abs(torque) / _TORQUE)
        tint = rr.Mesh3D.columns(albedo_factor=glow)
        send(f"{self._path}/rotor/friction", times, [*_make_poses(shift[:, 1::2]), *tint])
        half = angle / 2.0
        turn = np.stack([np.sin(half), zero, zero, np.cos(half)], axis=1)
        send(f"{self._path}/rotor", times, rr.Transform3D.columns(quaternion=turn))


def _make_poses(shift: np.ndarray) -> rr.ComponentColumnList:
    """Return copies of one mesh; `shift`, shape (frames, copies, 3)."""
    columns = rr.InstancePoses3D.columns(translations=shift.reshape(-1, 3))
    return columns.partition(np.full(shift.shape[0], shift.shape[1]))


def _blend(low_colour: str, high_colour: str, part: np.ndarray) -> np.ndarray:
    """Return colours (n,), 0xRRGGBBAA, between two; part (n,): 0 is the low colour, 1 the high one."""
    low, high = np.array(split_colour(low_colour)), np.array(split_colour(high_colour))
    mixed = (low + np.clip(part, 0.0, 1.0)[:, None] * (high - low)).astype(np.uint32)
    return (mixed[:, 0] << 24) | (mixed[:, 1] << 16) | (mixed[:, 2] << 8) | 0xFF
