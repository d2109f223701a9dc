"""Measuring frames against what a person sees in them: how deep in an obstacle, how far down, how symmetric.

Plain NumPy in float64, written without a look at the engine's own distance functions, so that it can check them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from warpdeform.obstacle import Obstacle
from warpdeform.track import rotation_matrix

Array = NDArray[np.float64]


def samples(positions: Array) -> Array:
    """Nodes, midpoints of edges and centres of cells of a grid (nu, nv, 3): shape (k, 3)."""
    u, v = 0.5 * (positions[1:] + positions[:-1]), 0.5 * (positions[:, 1:] + positions[:, :-1])
    cells = 0.5 * (u[:, 1:] + u[:, :-1])
    return np.concatenate([part.reshape(-1, 3) for part in (positions, u, v, cells)])


def depth(obstacle: Obstacle, points: Array, time: float) -> float:
    """How deep the deepest of some points is inside an obstacle [m]; 0 if all are outside.

    Knows plane, sphere, cylinder, capsule and solid meshes.

    Args:
        obstacle: The obstacle.
        points: Points [m], shape (k, 3).
        time: Time of its pose [s].
    """
    local = _seen_from(obstacle, points, time)
    if obstacle.kind == "mesh":
        assert obstacle.vertices is not None
        assert obstacle.faces is not None
        corners = obstacle.vertices[obstacle.faces]
        inside = local[_in_mesh(local, corners)]
        return max((_distance(point, corners) for point in inside[:: 1 + len(inside) // 100]), default=0.0)
    radius, half_height, _ = obstacle.size_vector
    around = radius - np.linalg.norm(local[:, :2], axis=1)
    inside = {
        "plane": -local[:, 2],
        "sphere": radius - np.linalg.norm(local, axis=1),
        "cylinder": np.minimum(around, half_height - np.abs(local[:, 2])),
        "capsule": -_from_capsule(obstacle, local),
    }[obstacle.kind]
    return max(0.0, float(inside.max()))


def capsule_gaps(obstacles: Sequence[Obstacle], points: Array, time: float) -> Array:
    """Distances of points, shape (k, 3), from the nearest of some capsules [m], shape (k,); negative inside."""
    return np.min([_from_capsule(each, _seen_from(each, points, time)) for each in obstacles], axis=0)


def load_on_sphere(obstacle: Obstacle, points: Array, masses: Array, time: float, gravity: Sequence[float]) -> Array:
    """What a body presses a sphere with through the sphere's field [N], shape (3,).

    A node of mass m at the distance f is pushed by m (V^2 / 2 eps) exp(-f / eps), evenly more inside.

    Args:
        obstacle: The sphere, with a design speed of its own.
        points: Positions of the nodes [m], shape (k, 3).
        masses: Their masses [kg], shape (k,).
        time: Time of the sphere's pose [s].
        gravity: Acceleration of gravity [m/s2].
    """
    assert obstacle.design_speed is not None
    constants = obstacle.field_constants(gravity, obstacle.design_speed)
    local = points - obstacle.track.pose(time)[0]
    reach = np.linalg.norm(local, axis=1)
    scaled = (reach - obstacle.size_vector[0]) / constants.range
    push = np.where(scaled < 0.0, 1.0 - scaled, np.exp(-np.maximum(scaled, 0.0)))
    strength = masses * constants.design_speed**2 / (2.0 * constants.range)
    return np.asarray(-np.sum((strength * push / reach)[:, None] * local, axis=0))


def _seen_from(obstacle: Obstacle, points: Array, time: float) -> Array:
    """Points in the coordinates of an obstacle."""
    position, rotation = obstacle.track.pose(time)
    return np.asarray((points - position) @ rotation_matrix(rotation))


def _from_capsule(obstacle: Obstacle, local: Array) -> Array:
    radius, half_height, _ = obstacle.size_vector
    beyond = np.maximum(np.abs(local[:, 2]) - half_height, 0.0)
    return np.asarray(np.sqrt(local[:, 0] ** 2 + local[:, 1] ** 2 + beyond**2) - radius)


def _in_mesh(points: Array, corners: Array) -> NDArray[np.bool_]:
    """Which points have an odd number of triangles straight above them.

    Args:
        points: Points, shape (k, 3).
        corners: Corners of the triangles, shape (m, 3, 3).
    """
    # Off the vertices' coordinates by a shift that no mesh shares, so that no ray meets an edge.
    x, y, z = points.T + np.array([[1.234e-9], [2.345e-9], [0.0]])
    point, face = _pairs_in_x(x, corners[..., 0])
    low, high = corners.min(axis=1), corners.max(axis=1)
    near = (low[face, 1] < y[point]) & (y[point] < high[face, 1]) & (high[face, 2] > z[point])
    point, face = point[near], face[near]
    a, b, c = (corners[face, k] for k in range(3))

    def side(p: Array, q: Array) -> Array:
        return (q[:, 0] - p[:, 0]) * (y[point] - p[:, 1]) - (q[:, 1] - p[:, 1]) * (x[point] - p[:, 0])

    wa, wb, wc = side(b, c), side(c, a), side(a, b)
    hit = ((wa > 0) == (wb > 0)) & ((wb > 0) == (wc > 0))
    height = (wa * a[:, 2] + wb * b[:, 2] + wc * c[:, 2])[hit] / (wa + wb + wc)[hit] - z[point[hit]]
    return np.bincount(point[hit][height > 0], minlength=len(points)) % 2 == 1


def _pairs_in_x(x: Array, corners: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Points and triangles that may overlap in x: indices of both.

    Args:
        x: Of the points, shape (k,).
        corners: x of the corners of the triangles, shape (m, 3).
    """
    low, high = corners.min(axis=1), corners.max(axis=1)
    order = np.argsort(low)
    first = np.searchsorted(low[order], x - (high - low).max())
    count = np.searchsorted(low[order], x) - first
    point = np.repeat(np.arange(len(x)), count)
    step = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    face = order[first[point] + step]
    inside = x[point] < high[face]
    return point[inside], face[inside]


def _distance(point: Array, corners: Array) -> float:
    """Distance of a point from the nearest triangle [m].

    Args:
        point: The point, shape (3,).
        corners: Corners of the triangles, shape (m, 3, 3).
    """
    a, b, c = (corners[:, k] - point for k in range(3))
    normal = np.cross(b - a, c - a)
    above = np.einsum("ij,ij->i", a, normal) / np.maximum(np.linalg.norm(normal, axis=1), 1e-30)
    within = np.ones(len(a), dtype=bool)
    nearest = np.full(len(a), np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        edge = q - p
        within &= np.einsum("ij,ij->i", np.cross(edge, -p), normal) >= 0
        along = np.clip(-np.einsum("ij,ij->i", p, edge) / np.maximum(np.einsum("ij,ij->i", edge, edge), 1e-30), 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(p + along[:, None] * edge, axis=1))
    return float(np.where(within, np.abs(above), nearest).min())


def relative_volumes(positions: Array, rest: Array) -> Array:
    """Signed volumes of a solid's cells over those at rest, from the means of their edges: 0 or less is turned over.

    Args:
        positions: Node positions [m], shape (nu, nv, nw, 3).
        rest: Those at rest, likewise.
    """

    def volumes(r: Array) -> Array:
        edges = []
        for axis in range(3):
            edge = np.diff(r, axis=axis)
            for across in {0, 1, 2} - {axis}:
                edge = np.delete(edge, -1, across) + np.delete(edge, 0, across)
            edges.append(edge / 4.0)
        return np.asarray(np.sum(edges[0] * np.cross(edges[1], edges[2]), axis=-1))

    return np.asarray(volumes(positions) / volumes(rest))


def asymmetry(positions: Array, axis: int, across: int) -> float:
    """Largest distance of a node from the mirror image of its counterpart [m].

    Args:
        positions: Node positions, shape (nu, nv, 3), symmetric about the plane where coordinate `across` is 0.
        axis: Grid axis whose ends are each other's counterparts: 0 for u, 1 for v.
        across: Coordinate that changes its sign: 0 for x, 1 for y, 2 for z.
    """
    mirrored = np.flip(positions, axis=axis).copy()
    mirrored[..., across] *= -1.0
    return float(np.max(np.linalg.norm(mirrored - positions, axis=-1)))


def folds(positions: NDArray[np.float64]) -> float:
    """Largest angle between the normals of neighbouring cells [degrees]; positions of shape (nu, nv, 3)."""
    normals = np.cross(positions[1:, 1:] - positions[:-1, :-1], positions[:-1, 1:] - positions[1:, :-1])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    cosines = [np.sum(normals[1:] * normals[:-1], axis=-1), np.sum(normals[:, 1:] * normals[:, :-1], axis=-1)]
    return float(np.degrees(np.arccos(np.clip(min(c.min() for c in cosines), -1.0, 1.0))))
