"""Solids of revolution about the x axis, as triangle meshes."""

from collections.abc import Sequence
from math import pi

import numpy as np
import rerun as rr

_SECTORS = 48  # per full turn: round enough at the size of a picture


def revolve(
    profile: Sequence[tuple[float, float]],
    color: int,
    stripe: int | None = None,
    begin: float = 0.0,
    end: float = 2 * pi,
) -> rr.Mesh3D:
    """Return the solid that a closed convex `profile` of (x, radius) sweeps from angle `begin` to `end` [rad].

    stripe: colour of every other quarter turn, which makes rotation visible, at 25 Hz up to 39 rad/s; None for none.
    """
    corners = np.asarray(profile, dtype=float)
    angles = np.linspace(begin, end, _SECTORS + 1)
    turn = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = np.empty((len(angles), len(corners), 3))
    points[..., 0] = corners[:, 0]
    points[..., 1:] = corners[None, :, 1, None] * turn[:, None, :]
    after = np.roll(points, -1, axis=1)
    quads = np.stack([points[:-1], after[:-1], after[1:], points[1:]], axis=2)  # sector, edge, corner, xyz
    colors = np.full(len(angles) - 1, color, dtype=np.uint32)
    if stripe is not None:
        colors[(np.arange(len(colors)) * 4 // _SECTORS) % 2 == 0] = stripe
    faces = [quads.reshape(-1, 4, 3)]
    tints = [np.repeat(colors, len(corners))]
    if end - begin < 2 * pi:  # the cut surfaces
        for cut in (points[0], points[-1]):
            faces.append(np.stack([[cut[0], cut[k], cut[k + 1], cut[k + 1]] for k in range(1, len(cut) - 1)]))
            tints.append(np.full(len(cut) - 2, color, dtype=np.uint32))
    quad = np.concatenate(faces)
    normal = np.cross(quad[:, 2] - quad[:, 0], quad[:, 3] - quad[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-12
    corner = 4 * np.arange(len(quad))[:, None]
    return rr.Mesh3D(
        vertex_positions=quad.reshape(-1, 3),
        vertex_normals=np.repeat(normal, 4, axis=0),
        vertex_colors=np.repeat(np.concatenate(tints), 4),
        triangle_indices=(corner + np.array([0, 1, 2, 0, 2, 3])).reshape(-1, 3),
    )


def make_ring_profile(at: float, thickness: float, inner: float, outer: float) -> list[tuple[float, float]]:
    """Return the profile of a ring that begins at x = `at`, as (x, radius) of its corners."""
    return [(at, inner), (at + thickness, inner), (at + thickness, outer), (at, outer)]
