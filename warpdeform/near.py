"""Pairs of points and triangles, and of edges, that are near each other, with the weights of their closest points.

For :mod:`warpdeform.relaxing`; :mod:`warpdeform.crossings`, which judges the outcome, has distances of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Near:
    """Pairs that are near each other.

    Attributes:
        vertices: Their nodes, shape (k, 4).
        weights: b, positive of the first side, shape (k, 4).
        normal: n, from the second side to the first, shape (k, 3).
        distance: d [m].
        owners: Body of each side, shape (k, 2).
        edges: Whether both sides are edges.
        aim, enough, touch: Distances that a sweep aims at, that will do, and below which skins overlap [m].
        asked: Whether the pair asks to be relaxed.
    """

    vertices: Ints
    weights: Array
    normal: Array
    distance: Array
    owners: Ints
    edges: NDArray[np.bool_]
    aim: Array
    enough: Array
    touch: Array
    asked: NDArray[np.bool_]

    def where(self, chosen: NDArray[np.bool_] | Ints) -> Near:
        """Some of them."""
        return Near(**{name: values[chosen] for name, values in vars(self).items()})

    @staticmethod
    def joined(parts: Sequence[Near]) -> Near:
        """Several lists as one, or none."""
        if not parts:
            none, flags = np.zeros(0), np.zeros(0, bool)
            four, two = np.zeros((0, 4), np.int64), np.zeros((0, 2), np.int64)
            return Near(four, np.zeros((0, 4)), np.zeros((0, 3)), none, two, flags, none, none, none, flags)
        return Near(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])})

    def sides(self, k: int) -> tuple[list[int], list[int]]:
        """Nodes of both sides of a pair."""
        split = 2 if self.edges[k] else 1
        nodes = self.vertices[k].tolist()
        return nodes[:split], nodes[split:]


def distinct(near: Near) -> Ints:
    """Numbers of the pairs whose closest points no earlier pair has: edges that end at a node share that node."""
    keys = np.where(near.weights != 0.0, near.vertices, -1)
    # Nodes that take part, the largest of each side first, and of both sides the one with the smaller of these.
    split = np.where(near.edges, 2, 1)[:, None] > np.arange(4)
    sides = [np.sort(np.where(side, keys, -1), axis=1)[:, ::-1] for side in (split, ~split)]
    swapped = (sides[0][:, 0] > sides[1][:, 0])[:, None]
    first, second = np.where(swapped, sides[1], sides[0]), np.where(swapped, sides[0], sides[1])
    return np.unique(np.concatenate([first[:, :3], second[:, :3]], axis=1), axis=0, return_index=True)[1]


def points_over(points: Array, triangles: Array) -> tuple[Array, Array]:
    """Ways from triangles, shape (k, 3, 3), to points over their inside, shape (k, 1, 3), and the weights of all four.

    The first weight is -1 for points that are not over the inside: the edges around have them.
    """
    corner = triangles[:, 0]
    first, second, q = triangles[:, 1] - corner, triangles[:, 2] - corner, points[:, 0] - corner
    normal = np.cross(first, second)
    area = np.einsum("kx,kx->k", normal, normal)
    safe = np.where(area > 0.0, area, 1.0)
    u = np.einsum("kx,kx->k", np.cross(q, second), normal) / safe
    v = np.einsum("kx,kx->k", np.cross(first, q), normal) / safe
    inside = (area > 0.0) & (u > 0.0) & (v > 0.0) & (u + v < 1.0)
    r = (np.einsum("kx,kx->k", q, normal) / safe)[:, None] * normal
    return r, np.stack([np.where(inside, 1.0, -1.0), u + v - 1.0, -u, -v], axis=1)


def edges_between(first: Array, second: Array) -> tuple[Array, Array]:
    """Ways between the closest points of segments, both of shape (k, 2, 3), second to first, and the weights."""
    d, e, r = first[:, 1] - first[:, 0], second[:, 1] - second[:, 0], first[:, 0] - second[:, 0]
    dd, ee, de, dr, er = (np.einsum("kx,kx->k", x, y) for x, y in ((d, d), (e, e), (d, e), (d, r), (e, r)))
    determinant = dd * ee - de * de
    safe = np.where(determinant > 0.0, determinant, 1.0)
    none, whole = np.zeros_like(dd), np.ones_like(dd)
    # Both inside, then each end against the other segment; the nearest of them is the closest.
    shares = [
        ((de * er - ee * dr) / safe, (dd * er - de * dr) / safe),
        (none, er / ee),
        (whole, (er + de) / ee),
        (-dr / dd, none),
        ((de - dr) / dd, whole),
    ]
    s, t = (np.clip([pair[side] for pair in shares], 0.0, 1.0) for side in (0, 1))
    ways = r + s[..., None] * d - t[..., None] * e
    best = np.argmin(np.linalg.norm(ways, axis=2), axis=0), np.arange(len(d))
    s, t = s[best], t[best]
    return ways[best], np.stack([1.0 - s, s, t - 1.0, -t], axis=1)


def boxes(points: Array, simplices: Ints) -> tuple[Array, Array]:
    """Lower and upper corners around simplices, shape (k, 3) each."""
    corners = points[simplices]
    return corners.min(axis=1), corners.max(axis=1)
