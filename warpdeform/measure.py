"""Lengths, areas and volumes of rest shapes, shared among their nodes (design 1.3, weights)."""

import numpy as np
from numpy.typing import NDArray

from warpdeform.grid import ParameterGrid

Array = NDArray[np.float64]


def cell_measures(grid: ParameterGrid, positions: Array) -> Array:
    """Lengths, areas or volumes of the cells of a shape by their mean edges [m, m2 or m3], shape (*cells)."""
    edges = mean_edges(grid, positions)
    if grid.dimension == 1:
        return np.asarray(np.linalg.norm(edges[0], axis=-1))
    across = np.cross(edges[-2], edges[-1])
    if grid.dimension == 2:
        return np.asarray(np.linalg.norm(across, axis=-1))
    return np.abs(np.sum(edges[0] * across, axis=-1))


def mean_edges(grid: ParameterGrid, positions: Array) -> list[Array]:
    """Mean of a cell's edges along each connected axis [m], shape (*cells, 3) each."""
    found = []
    for axis in range(grid.dimension):
        edges = grid.differences(positions, axis)
        for across in range(grid.dimension):
            edges = grid.means(edges, across) if across != axis else edges
        found.append(edges)
    return found


def node_measures(grid: ParameterGrid, positions: Array) -> Array:
    """Node shares of length, area or volume, trapezoid weights, shape (*nodes)."""
    return grid.cells_to_nodes(cell_measures(grid, positions))


def exposed_shares(grid: ParameterGrid, positions: Array, diameter: float = 0.0) -> Array:
    """Node shares of the area that the outer world meets [m2], shape (*nodes, faces).

    Args:
        grid: Parameter grid.
        positions: Rest positions [m], shape (*nodes, 3).
        diameter: Diameter of a curve [m].

    Returns:
        Length times diameter of curves; the area of surfaces; of solids, whose nodes have three faces, the sides at the
        ends of u, v and w: zero at inner nodes.
    """
    if grid.dimension < 3:
        return node_measures(grid, positions)[..., None] * (diameter if grid.dimension == 1 else 1.0)
    shares = np.zeros((*grid.nodes, 3))
    for axis in range(3):
        if not grid.periodic[axis]:
            kept = [k for k in range(3) if k != axis]
            nodes, spacing = tuple(grid.nodes[k] for k in kept), tuple(grid.spacing[k] for k in kept)
            face = ParameterGrid(nodes, spacing, tuple(grid.periodic[k] for k in kept))
            for end in (0, -1):
                at: list[slice | int] = [slice(None)] * 3
                at[axis] = end
                shares[(*at, axis)] = node_measures(face, positions[tuple(at)])
    return shares


def enclosed_volume(periodic: tuple[bool, ...], positions: Array) -> float:
    """Volume that a closed surface encloses [m3], ends of an open axis capped; positive if normals point outwards.

    Args:
        periodic: Axes that close: both, or one.
        positions: Node positions [m], shape (nu, nv, 3).
    """
    grid = ParameterGrid(positions.shape[:2], (1.0, 1.0), periodic)
    r = positions - positions.mean(axis=(0, 1))
    m1, m2 = mean_edges(grid, r)
    centre = grid.means(grid.means(r, 0), 1)
    volume = float(np.sum(centre * np.cross(m1, m2))) / 3.0
    rims, turns = rims_of(grid.nodes, periodic)
    for rim, turn in zip(rims, turns, strict=True):
        points = r[rim[:, 0], rim[:, 1]]
        around = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)
        volume += float(turn * np.dot(points.mean(axis=0), around)) / 6.0
    return volume


def rims_of(nodes: tuple[int, ...], periodic: tuple[bool, ...]) -> tuple[NDArray[np.int64], Array]:
    """The rims of a surface that is periodic along one axis: none if it is along both.

    Returns:
        Index pairs of their nodes in the order of the periodic axis, shape (2 or 0, n, 2), and 1 where that order is
        counter-clockwise on a cap as seen from outside, else -1: the cap goes against the cells beside it.
    """
    if all(periodic):
        return np.zeros((0, 1, 2), dtype=np.int64), np.zeros(0)
    around = periodic.index(True)
    rims = np.zeros((2, nodes[around], 2), dtype=np.int64)
    rims[:, :, around] = np.arange(nodes[around])
    rims[1, :, 1 - around] = nodes[1 - around] - 1
    # Cells are r00, r10, r11, r01: along +u at the start of v, along -v at the start of u.
    return rims, np.array([-1.0, 1.0] if around == 0 else [1.0, -1.0])
