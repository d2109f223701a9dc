"""Obstacles, meshes and reference distances for obstacle tests, by other formulas than the kernels'."""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpdeform.obstacle import Obstacle

Points = NDArray[np.float64]
Faces = NDArray[np.int64]


PRIMITIVES: dict[str, dict[str, Any]] = {
    "plane": {},
    "sphere": {"radius": 0.5},
    "box": {"size": (1.2, 0.6, 0.4)},
    "capsule": {"radius": 0.25, "height": 0.8},
    "cylinder": {"radius": 0.4, "height": 1.0},
    "cone": {"radius": 0.4, "height": 1.2},
    "torus": {"radius": 0.5, "tube_radius": 0.2},
}


def obstacle(kind: str, **words: Any) -> Obstacle:
    """One of `PRIMITIVES`, or the box as a mesh."""
    if kind == "mesh":
        vertices, faces = box_mesh((1.2, 0.6, 0.4))
        return Obstacle(kind, vertices=vertices, faces=faces, **words)
    return Obstacle(kind, PRIMITIVES[kind], **words)


def box_mesh(size: Sequence[float]) -> tuple[Points, Faces]:
    """A closed box of 12 triangles about the origin."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * np.array(size) / 2
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return corners, np.array([[q[0], q[a], q[a + 1]] for q in quads for a in (1, 2)])


def torus_mesh(radius: float, tube_radius: float, around: int = 40, across: int = 20) -> tuple[Points, Faces]:
    """A closed torus around z."""
    a, b = np.meshgrid(np.arange(around) * 2 * np.pi / around, np.arange(across) * 2 * np.pi / across, indexing="ij")
    rho = radius + tube_radius * np.cos(b)
    vertices = np.stack([rho * np.cos(a), rho * np.sin(a), tube_radius * np.sin(b)], axis=-1).reshape(-1, 3)
    i, j = (k.reshape(-1) for k in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))

    def node(i: Faces, j: Faces) -> Faces:
        return (i % around) * across + j % across

    first = np.stack([node(i, j), node(i + 1, j), node(i + 1, j + 1)], axis=1)
    second = np.stack([node(i, j), node(i + 1, j + 1), node(i, j + 1)], axis=1)
    return vertices, np.concatenate([first, second])


def sheet_mesh(size: float, cells: int = 4) -> tuple[Points, Faces]:
    """An open square in the plane z = 0 about the origin."""
    u = np.linspace(-size / 2, size / 2, cells + 1)
    vertices = np.array([[x, y, 0.0] for x in u for y in u])
    corner = np.array([i * (cells + 1) + j for i in range(cells) for j in range(cells)])[:, None]
    return vertices, np.concatenate([corner + [0, cells + 1, cells + 2], corner + [0, cells + 2, 1]])


def distance_to(kind: str, size: Sequence[float], points: Points) -> Points:
    """Signed distance of the primitives; `size` as kernels take it (radii, half heights, half lengths)."""
    rho, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    a, b, _ = size
    if kind == "plane":
        return z
    if kind == "sphere":
        return np.sqrt(np.sum(points**2, axis=1)) - a
    if kind == "box":
        outside = np.linalg.norm(points - np.clip(points, -np.array(size), size), axis=1)
        return np.where(outside > 0, outside, -np.min(np.array(size) - np.abs(points), axis=1))
    if kind == "capsule":
        return np.hypot(rho, np.maximum(np.abs(z) - b, 0.0)) - a
    if kind == "torus":
        return np.hypot(rho - a, z) - b
    profile = {"cylinder": [(0, b), (a, b), (a, -b), (0, -b)], "cone": [(0, b), (a, -b), (0, -b)]}[kind]
    return _inside_profile(np.array(profile, dtype=np.float64), np.stack([rho, z], axis=1))


def _inside_profile(profile: Points, points: Points) -> Points:
    """Signed distance to a convex profile in the half plane (rho, z), given from top to bottom."""
    nearest, inside = np.full(len(points), np.inf), np.ones(len(points), dtype=bool)
    for start, end in itertools.pairwise(profile):
        e, d = end - start, points - start
        t = np.clip(d @ e / (e @ e), 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(d - t[:, None] * e, axis=1))
        inside &= e[1] * d[:, 0] - e[0] * d[:, 1] > 0
    return np.where(inside, -nearest, nearest)


def crossings(vertices: Points, faces: Faces, start: Points, end: Points) -> int:
    """How many of the segments from `start` to `end`, shape (n, 3), cross a triangle (Moeller and Trumbore)."""
    a, b, c = (vertices[faces[:, k]][None] for k in range(3))
    d = (end - start)[:, None]
    h = np.cross(d, c - a)
    det = np.sum((b - a) * h, axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = start[:, None] - a
        u = np.sum(s * h, axis=2) / det
        q = np.cross(s, b - a)
        v = np.sum(d * q, axis=2) / det
        t = np.sum((c - a) * q, axis=2) / det
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t <= 1)
    return int(np.any(hit, axis=1).sum())
