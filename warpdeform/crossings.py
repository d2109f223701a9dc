"""The referee of contact: which edges cross which triangles, and how near bodies come, in double precision.

It shares nothing with the engine's own search and forces, so that it can judge them. An edge and a triangle that have
no vertex in common cross unless an axis separates them by more than what rounding may pretend: whatever touches, lies
in one plane or cannot be told apart counts as crossing. The axes are the normals of the prism that the triangle sweeps
along the edge, so they miss no separation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpdeform.simplices import Ints, Simplices

Array = NDArray[np.float64]
Pairs = tuple[Ints, Ints]

CHUNK = 1 << 19
"""Pairs that are looked at in one go."""
FAN = 4
"""Boxes that one box of the next level holds."""
ROUNDING = 16.0 * np.finfo(np.float64).eps
"""Error of a projection on an axis, as a share of the magnitudes that it adds."""


def crossing_pairs(points: NDArray[np.floating], simplices: Simplices) -> Ints:
    """Edges and triangles without a common vertex that cross or touch.

    Args:
        points: Vertices [m], shape (n, 3).
        simplices: What joins them.

    Returns:
        Numbers of the edge and of the triangle, shape (k, 2), in ascending order.
    """
    p = np.asarray(points, dtype=np.float64)
    edges, triangles = simplices.edges, simplices.triangles
    found = [np.zeros((0, 2), np.int64)]
    for e, t in overlapping(_boxes(p, edges), _boxes(p, triangles)):
        apart = ~simplices.shares_vertex(edges[e], triangles[t])
        e, t = e[apart], t[apart]
        crossing = ~separated(p[edges[e]], p[triangles[t]])
        found.append(np.stack([e[crossing], t[crossing]], axis=1))
    pairs = np.concatenate(found)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


def separated(edges: Array, triangles: Array) -> NDArray[np.bool_]:
    """Whether edges, shape (k, 2, 3), keep a certain distance from triangles, shape (k, 3, 3)."""
    q = np.concatenate([triangles, edges], axis=1) - triangles[:, :1]
    first, second, along = q[:, 1], q[:, 2], q[:, 4] - q[:, 3]
    sides = np.stack([first, second - first, second], axis=1)
    normal = np.cross(first, second)
    axes = np.concatenate(
        [
            normal[:, None],
            np.cross(along[:, None], sides),
            np.cross(normal[:, None], sides),
            np.cross(normal, along)[:, None],
        ],
        axis=1,
    )
    heights = np.einsum("kax,kpx->kap", axes, q)
    error = ROUNDING * np.einsum("kax,kpx->kap", np.abs(axes), np.abs(q)).max(axis=2)
    low, high = heights[..., :3].min(axis=2), heights[..., :3].max(axis=2)
    below, above = heights[..., 3:].max(axis=2) < low - error, heights[..., 3:].min(axis=2) > high + error
    return np.asarray((below | above).any(axis=1))


@dataclass(frozen=True)
class Closest:
    """The closest two things that are no neighbours on their body.

    Attributes:
        distance: Their distance [m]; infinite if it is above the limit that was asked for.
        vertices: Their vertices: a point and a triangle (a triangle of a curve has two), or two edges.
    """

    distance: float
    vertices: tuple[tuple[int, ...], tuple[int, ...]] = ((), ())


def closest(
    points: NDArray[np.floating],
    simplices: Simplices,
    limit: float,
    feels: tuple[Ints, NDArray[np.bool_]] | None = None,
) -> Closest:
    """The closest point and triangle, or edge and edge, that neither share a vertex nor are joined by an edge.

    Args:
        points: Vertices [m], shape (n, 3).
        simplices: What joins them.
        limit: Distances above it do not count [m]; a few lengths of an edge, or the search takes long.
        feels: Body of each vertex, and which bodies count against which; left out: all.
    """
    p = np.asarray(points, dtype=np.float64)
    edges = simplices.edges
    used = np.unique(edges)[:, None]
    best = Closest(np.inf)
    for which, others in enumerate((simplices.triangles, edges)):
        own = edges if which else used
        for a, b in overlapping(_boxes(p, own), _boxes(p, others), limit):
            if which:
                a, b = a[a < b], b[a < b]
            apart = ~simplices.shares_vertex(own[a], others[b])
            if feels is not None:
                apart &= feels[1][feels[0][own[a, 0]], feels[0][others[b, 0]]]
            a, b = a[apart], b[apart]
            measure = segment_distances if which else point_distances
            distance = measure(p[own[a]], p[others[b]])
            near = np.flatnonzero(distance < min(best.distance, limit))
            apart = ~simplices.are_neighbours(own[a[near]], others[b[near]])
            near = near[apart]
            if len(near):
                k = near[np.argmin(distance[near])]
                pair = (tuple(own[a[k]].tolist()), tuple(others[b[k]].tolist()))
                best = Closest(float(distance[k]), pair)
    return best


def point_distances(points: Array, triangles: Array) -> Array:
    """Distances of points, shape (k, 1, 3), from triangles, shape (k, 3, 3)."""
    corner = triangles[:, 0]
    first, second, q = triangles[:, 1] - corner, triangles[:, 2] - corner, points[:, 0] - corner
    normal = np.cross(first, second)
    area = np.einsum("kx,kx->k", normal, normal)
    safe = np.where(area > 0.0, area, 1.0)
    u = np.einsum("kx,kx->k", np.cross(q, second), normal) / safe
    v = np.einsum("kx,kx->k", np.cross(first, q), normal) / safe
    over = (area > 0.0) & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0)
    height = np.abs(np.einsum("kx,kx->k", q, normal)) / np.sqrt(safe)
    corners = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2)
    rim = np.min([_point_segment(points[:, 0], corners[:, side]) for side in range(3)], axis=0)
    return np.where(over, height, rim)


def segment_distances(first: Array, second: Array) -> Array:
    """Distances of segments, both of shape (k, 2, 3)."""
    d, e, r = first[:, 1] - first[:, 0], second[:, 1] - second[:, 0], first[:, 0] - second[:, 0]
    dd, ee, de = (np.einsum("kx,kx->k", a, b) for a, b in ((d, d), (e, e), (d, e)))
    dr, er = np.einsum("kx,kx->k", d, r), np.einsum("kx,kx->k", e, r)
    determinant = dd * ee - de * de
    safe = np.where(determinant > 0.0, determinant, 1.0)
    s, t = (de * er - ee * dr) / safe, (dd * er - de * dr) / safe
    inside = (determinant > 0.0) & (s > 0.0) & (s < 1.0) & (t > 0.0) & (t < 1.0)
    between = np.linalg.norm(r + s[:, None] * d - t[:, None] * e, axis=1)
    ends = [_point_segment(first[:, k], second) for k in (0, 1)] + [_point_segment(second[:, k], first) for k in (0, 1)]
    return np.where(inside, np.minimum(between, np.min(ends, axis=0)), np.min(ends, axis=0))


def _point_segment(points: Array, segments: Array) -> Array:
    d, q = segments[:, 1] - segments[:, 0], points - segments[:, 0]
    length = np.einsum("kx,kx->k", d, d)
    share = np.clip(np.einsum("kx,kx->k", d, q) / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
    return np.asarray(np.linalg.norm(q - share[:, None] * d, axis=1))


# Boxes --------------------------------------------------------------------------------------------------------------


def overlapping(first: tuple[Array, Array], second: tuple[Array, Array], within: float = 0.0) -> Iterator[Pairs]:
    """Numbers of boxes of two sets that overlap or touch, in portions: two hierarchies go down side by side.

    Args:
        first: Lower and upper corners, shapes (k, 3).
        second: The same.
        within: How far apart they may be along every axis [m].
    """
    if not len(first[0]) or not len(second[0]):
        return
    low, high = np.min(first[0], axis=0), np.max(first[1], axis=0)
    a = _Hierarchy(first[0] - within, first[1] + within, low, high)
    b = _Hierarchy(*second, low, high)
    tops = np.meshgrid(np.arange(a.sizes[-1]), np.arange(b.sizes[-1]), indexing="ij")
    waiting = [(len(a.sizes) - 1, len(b.sizes) - 1, tops[0].reshape(-1), tops[1].reshape(-1))]
    while waiting:
        level_a, level_b, i, j = waiting.pop()
        if len(i) > CHUNK:
            half = len(i) // 2
            waiting += [(level_a, level_b, i[half:], j[half:]), (level_a, level_b, i[:half], j[:half])]
            continue
        meet = (a.low[level_a][i] <= b.high[level_b][j]).all(axis=1)
        meet &= (b.low[level_b][j] <= a.high[level_a][i]).all(axis=1)
        i, j = i[meet], j[meet]
        if level_a == level_b == 0:
            yield a.order[i], b.order[j]
        elif len(i) and level_a >= level_b:
            i, j = _children(i, j, a.sizes[level_a - 1])
            waiting.append((level_a - 1, level_b, i, j))
        elif len(i):
            j, i = _children(j, i, b.sizes[level_b - 1])
            waiting.append((level_a, level_b - 1, i, j))


class _Hierarchy:
    """Boxes in the order of a space-filling curve, and boxes of `FAN` neighbours in that order, level by level."""

    def __init__(self, low: Array, high: Array, lowest: Array, highest: Array) -> None:
        self.order = np.argsort(_morton(0.5 * (low + high), lowest, highest), kind="stable")
        self.low, self.high = [low[self.order]], [high[self.order]]
        while len(self.low[-1]) > FAN:
            starts = np.arange(0, len(self.low[-1]), FAN)
            self.low.append(np.minimum.reduceat(self.low[-1], starts))
            self.high.append(np.maximum.reduceat(self.high[-1], starts))
        self.sizes = [len(level) for level in self.low]


def _children(parents: Ints, others: Ints, count: int) -> Pairs:
    children = (FAN * parents[:, None] + np.arange(FAN)).reshape(-1)
    real = children < count
    return children[real], np.repeat(others, FAN)[real]


def _morton(points: Array, low: Array, high: Array) -> Ints:
    """Place of points along a curve that keeps neighbours together: the bits of their coordinates, interleaved."""
    size = np.max(high - low)
    cells = np.clip((points - low) / (size if size > 0.0 else 1.0), 0.0, 1.0) * 1023.0
    code = np.zeros(len(points), np.int64)
    for axis in range(3):
        bits = cells[:, axis].astype(np.int64)
        for k in range(10):
            code |= ((bits >> k) & 1) << (3 * k + axis)
    return code


def _boxes(points: Array, simplices: Ints) -> tuple[Array, Array]:
    corners = points[simplices]
    return corners.min(axis=1), corners.max(axis=1)
