"""Triangles of USD's native solids. Each function returns vertices (n, 3), triangles (m, 3) and unit normals (n, 3)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from warpdeform.study.picture.drawing import Floats, Ints

Surface = tuple[Floats, Ints, Floats]

SIDES = 96
"""Corners of a circle."""


def revolved(pieces: Sequence[Floats]) -> Surface:
    """Turn profiles about the z axis; between two pieces lies a sharp edge.

    Args:
        pieces: Each of shape (k, 4): radius, height, and the profile's normal there (radial, axial), bottom first.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    points, triangles, normals, first = [], [], [], 0
    for piece in pieces:
        rings = np.repeat(piece[:, None, :], SIDES, axis=1)
        points.append(np.concatenate([rings[:, :, :1] * around, rings[:, :, 1:2]], axis=-1))
        normals.append(np.concatenate([rings[:, :, 2:3] * around, rings[:, :, 3:]], axis=-1))
        lower = first + np.arange(len(piece) - 1)[:, None] * SIDES + np.arange(SIDES)
        beside = first + np.arange(len(piece) - 1)[:, None] * SIDES + np.roll(np.arange(SIDES), -1)
        opens, closes = piece[:-1, 0] > 1e-9 * piece[:, 0].max(), piece[1:, 0] > 1e-9 * piece[:, 0].max()
        triangles.append(np.stack([lower, beside, beside + SIDES], axis=-1)[opens].reshape(-1, 3))
        triangles.append(np.stack([lower, beside + SIDES, lower + SIDES], axis=-1)[closes].reshape(-1, 3))
        first += len(piece) * SIDES
    return (
        np.concatenate([p.reshape(-1, 3) for p in points]),
        np.concatenate(triangles),
        np.concatenate([n.reshape(-1, 3) for n in normals]),
    )


def _arc(radius: float, start: float, end: float, height: float = 0.0) -> Floats:
    """Profile of a part of a sphere between two latitudes [rad], centred at `height`."""
    latitude = np.linspace(start, end, max(2, int(SIDES * (end - start) / (2.0 * np.pi)) + 1))
    c, s = np.cos(latitude), np.sin(latitude)
    return np.stack([radius * c, height + radius * s, c, s], axis=-1)


def _disc(radius: float, height: float, up: float) -> Floats:
    """Profile of a flat cap that faces up (+1) or down (-1)."""
    cap = np.array([[0.0, height, 0.0, up], [radius, height, 0.0, up]])
    return cap if up < 0 else cap[::-1]


def sphere(radius: float) -> Surface:
    """A sphere about the origin."""
    return revolved([_arc(radius, -np.pi / 2, np.pi / 2)])


def cylinder(radius: float, height: float) -> Surface:
    """A cylinder about z, centred."""
    side = np.array([[radius, -height / 2, 1.0, 0.0], [radius, height / 2, 1.0, 0.0]])
    return revolved([_disc(radius, -height / 2, -1.0), side, _disc(radius, height / 2, 1.0)])


def capsule(radius: float, height: float) -> Surface:
    """`height` is that of the cylinder alone, without the caps, as in USD."""
    bottom = _arc(radius, -np.pi / 2, 0.0, -height / 2)
    return revolved([np.concatenate([bottom, _arc(radius, 0.0, np.pi / 2, height / 2)])])


def cone(radius: float, height: float) -> Surface:
    """A cone about z with its tip up, centred."""
    slope = np.array([height, radius]) / np.hypot(height, radius)
    side = np.array([[radius, -height / 2, *slope], [0.0, height / 2, *slope]])
    return revolved([_disc(radius, -height / 2, -1.0), side])


def plane(width: float, length: float) -> Surface:
    """A rectangle in the xy plane, facing +z."""
    corners = 0.5 * np.array([[-width, -length, 0], [width, -length, 0], [width, length, 0], [-width, length, 0]])
    return corners, np.array([[0, 1, 2], [0, 2, 3]]), np.tile([0.0, 0.0, 1.0], (4, 1))


def cube(size: float) -> Surface:
    """A cube about the origin."""
    points: list[Floats] = []
    triangles: list[Ints] = []
    normals: list[Floats] = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            face, quads, facing = plane(size, size)
            face = np.roll(face * [1.0, sign, 1.0] + [0.0, 0.0, sign * size / 2], axis, axis=1)
            points.append(face)
            triangles.append(quads + 4 * len(triangles))
            normals.append(np.roll(facing * sign, axis, axis=1))
    return np.concatenate(points), np.concatenate(triangles), np.concatenate(normals)


def along(surface: Surface, axis: str) -> Surface:
    """Turn a shape about z into one about the axis "X", "Y" or "Z" (a cyclic exchange: orientation is kept)."""
    shift = {"X": 1, "Y": 2, "Z": 0}[axis]
    points, triangles, normals = surface
    return np.roll(points, shift, axis=1), triangles, np.roll(normals, shift, axis=1)
