"""What of bodies can touch: points, edges and triangles, by the numbers of their vertices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpdeform.grid import ParameterGrid
from warpdeform.topology import block_sides, quad_indices

Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Simplices:
    """Triangles and edges of one body or of several.

    Attributes:
        vertices: Number of vertices.
        triangles: Their vertices, shape (t, 3), counter-clockwise seen from outside.
        edges: Vertices of every edge once, the smaller number first: those of triangles and of curves, shape (e, 2).
    """

    vertices: int
    triangles: Ints
    edges: Ints

    @staticmethod
    def of_triangles(vertices: int, triangles: NDArray[np.integer]) -> Simplices:
        """Triangles and their edges."""
        corners = np.asarray(triangles, dtype=np.int64).reshape(-1, 3)
        sides = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
        return Simplices(vertices, corners, np.unique(sides, axis=0))

    @staticmethod
    def of_polygons(vertices: int, counts: NDArray[np.integer], indices: NDArray[np.integer]) -> Simplices:
        """Polygons, cut from their first corner on: the diagonal of a quad joins its first and its third corner."""
        starts = np.cumsum(counts) - counts
        fans = np.maximum(np.asarray(counts) - 2, 0)
        first = np.repeat(starts, fans)
        step = np.arange(fans.sum()) - np.repeat(np.cumsum(fans) - fans, fans)
        corners = np.stack([indices[first], indices[first + step + 1], indices[first + step + 2]], axis=1)
        return Simplices.of_triangles(vertices, corners)

    @staticmethod
    def of_strands(counts: Sequence[int], closed: bool) -> Simplices:
        """Strands of so many vertices each, one strand after the other."""
        found, start = [np.zeros((0, 2), np.int64)], 0
        for count in counts:
            numbers = np.arange(start, start + count)
            following = np.roll(numbers, -1)
            found.append(np.stack([numbers, following], axis=1)[: None if closed else -1])
            start += count
        return Simplices(start, np.zeros((0, 3), np.int64), np.sort(np.concatenate(found), axis=1))

    @staticmethod
    def of_grid(grid: ParameterGrid) -> Simplices:
        """The strands of a curve, the cells of a surface, the skin of a solid; vertices are nodes, numbered by rows."""
        count = grid.node_count
        if grid.dimension == 1:
            nodes = np.arange(count).reshape(grid.nodes)
            if grid.periodic[0]:
                nodes = np.concatenate([nodes, nodes[:1]])
            edges = np.stack([nodes[:-1], nodes[1:]], axis=-1).swapaxes(0, 1).reshape(-1, 2)
            return Simplices(count, np.zeros((0, 3), np.int64), np.sort(edges, axis=1))
        if grid.dimension == 2:
            quads = quad_indices(grid.nodes, grid.periodic).astype(np.int64)
        else:
            sides = block_sides(grid.nodes, grid.periodic)
            quads = np.concatenate([s.nodes.reshape(-1)[quad_indices(s.nodes.shape, s.periodic)] for s in sides])
        return Simplices.of_polygons(count, np.full(len(quads), 4), quads.reshape(-1))

    @staticmethod
    def joined(parts: Sequence[Simplices]) -> Simplices:
        """Several bodies as one, their vertices one after the other."""
        starts = np.cumsum([0, *(part.vertices for part in parts)])
        triangles = [part.triangles + start for part, start in zip(parts, starts[:-1], strict=True)]
        edges = [part.edges + start for part, start in zip(parts, starts[:-1], strict=True)]
        none = (np.zeros((0, 3), np.int64), np.zeros((0, 2), np.int64))
        return Simplices(int(starts[-1]), np.concatenate([none[0], *triangles]), np.concatenate([none[1], *edges]))

    def shares_vertex(self, first: Ints, second: Ints) -> NDArray[np.bool_]:
        """Whether simplices, given by their vertices, shapes (k, m) and (k, n), have one in common."""
        return np.asarray((first[:, :, None] == second[:, None, :]).any(axis=(1, 2)))

    def are_neighbours(self, first: Ints, second: Ints) -> NDArray[np.bool_]:
        """Whether an edge joins the simplices, or they share a vertex."""
        keys = np.sort(self.edges[:, 0] * self.vertices + self.edges[:, 1])
        a, b = (
            np.broadcast_to(x, (len(first), first.shape[1], second.shape[1]))
            for x in (first[:, :, None], second[:, None, :])
        )
        wanted = np.minimum(a, b) * self.vertices + np.maximum(a, b)
        place = np.minimum(np.searchsorted(keys, wanted), max(len(keys) - 1, 0))
        joined = (keys[place] == wanted) if len(keys) else np.zeros(wanted.shape, bool)
        return np.asarray((joined | (a == b)).any(axis=(1, 2)))


def body_of_vertices(counts: Sequence[int]) -> Ints:
    """Number of the body that each vertex of joined simplices belongs to."""
    return np.repeat(np.arange(len(counts)), counts)
