"""Measuring frames against what a person sees in them: how deep in an obstacle, how far down, how symmetric.

Plain NumPy in float64, written without a look at the engine's own distance functions, so that it can check them.
"""

from __future__ import annotations

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

    Knows plane, sphere, cylinder and solid meshes, for which it is the height below the surface.

    Args:
        obstacle: The obstacle.
        points: Points [m], shape (k, 3).
        time: Time of its pose [s].
    """
    position, rotation = obstacle.track.pose(time)
    local = (points - position) @ rotation_matrix(rotation)
    if obstacle.kind == "mesh":
        assert obstacle.vertices is not None
        assert obstacle.faces is not None
        return float(np.max(_depth_in_mesh(local, obstacle.vertices, obstacle.faces), initial=0.0))
    radius, half_height, _ = obstacle.size_vector
    around = radius - np.linalg.norm(local[:, :2], axis=1)
    inside = {
        "plane": -local[:, 2],
        "sphere": radius - np.linalg.norm(local, axis=1),
        "cylinder": np.minimum(around, half_height - np.abs(local[:, 2])),
    }[obstacle.kind]
    return max(0.0, float(inside.max()))


def _depth_in_mesh(points: Array, vertices: Array, faces: NDArray[np.int64]) -> Array:
    """Height of points below the next surface above, where an odd number of surfaces is above; else 0."""
    corners = vertices[faces]
    low, high = corners.min(axis=1), corners.max(axis=1)
    # Off the vertices' coordinates by a shift that no mesh shares, so that no ray meets an edge.
    x, y, z = points.T + np.array([[1.234e-9], [2.345e-9], [0.0]])
    above = [(low[:, k, None] < p) & (p < high[:, k, None]) for k, p in ((0, x), (1, y))]
    face, point = np.nonzero(above[0] & above[1] & (high[:, 2, None] > z))
    a, b, c = (corners[face, k] for k in range(3))
    px, py = x[point], y[point]

    def side(p: Array, q: Array) -> Array:
        return (q[:, 0] - p[:, 0]) * (py - p[:, 1]) - (q[:, 1] - p[:, 1]) * (px - p[:, 0])

    wa, wb, wc = side(b, c), side(c, a), side(a, b)
    total = wa + wb + wc
    hit = ((wa > 0) == (wb > 0)) & ((wb > 0) == (wc > 0)) & (total != 0)
    height = (wa * a[:, 2] + wb * b[:, 2] + wc * c[:, 2])[hit] / total[hit] - z[point[hit]]
    over = height > 0
    struck, heights = point[hit][over], height[over]
    crossings = np.bincount(struck, minlength=len(points))
    nearest = np.full(len(points), np.inf)
    np.minimum.at(nearest, struck, heights)
    return np.where(crossings % 2 == 1, nearest, 0.0)


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
