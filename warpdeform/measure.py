"""Lengths, areas and volumes of rest shapes, shared among their nodes (design 1.3, weights)."""

import numpy as np
from numpy.typing import NDArray

from warpdeform.grid import ParameterGrid, ring_at

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


def edge_lengths(grid: ParameterGrid, positions: Array) -> list[Array]:
    """Lengths of the edges along each connected axis [m]."""
    return [np.linalg.norm(grid.differences(positions, axis), axis=-1) for axis in range(grid.dimension)]


def mean_edges(grid: ParameterGrid, positions: Array) -> list[Array]:
    """Mean of a cell's edges along each connected axis [m], shape (*cells, 3) each."""
    found = []
    for axis in range(grid.dimension):
        edges = grid.differences(positions, axis)
        for across in range(grid.dimension):
            edges = grid.means(edges, across) if across != axis else edges
        found.append(edges)
    return found


def node_measures(grid: ParameterGrid, positions: Array, density: Array | float = 1.0) -> Array:
    """Node shares of length, area or volume, trapezoid weights, shape (*nodes).

    Args:
        grid: Parameter grid.
        positions: Rest positions [m], shape (*nodes, 3).
        density: What a length, area or volume counts: a number, or one for each cell, shape (*cells).
    """
    measures = cell_measures(grid, positions)
    if not any(grid.poles):
        return grid.cells_to_nodes(density * measures)
    shares = np.zeros(grid.nodes)
    for corner, measure in corner_measures(grid, positions).items():
        shares[grid.corner_of_cells(corner)] += density * measure
    beside = grid.cells_to_nodes(density + 0.0 * measures) / grid.cells_to_nodes(np.ones_like(measures))
    return shares + beside * pole_measures(grid, positions)


def corner_measures(grid: ParameterGrid, positions: Array) -> dict[tuple[int, int], Array]:
    """What each corner of the cells of a surface gets of their areas [m2], shape (*cells) each.

    Towards a pole cells narrow so fast that their quarters differ: there a corner gets the quarter that lies around it.
    Equal quarters would give the nodes around a pole a quarter too much, and even bending would leave forces there.
    """
    areas = cell_measures(grid, positions)
    quarters = dict.fromkeys(((0, 0), (1, 0), (0, 1), (1, 1)), 0.25 * areas)
    if any(grid.poles):
        along, around = grid.periodic.index(False), grid.periodic.index(True)
        across = np.linalg.norm(grid.differences(positions, around), axis=-1)
        near, far = np.delete(across, -1, axis=along), np.delete(across, 0, axis=along)
        moved = 0.125 * areas * (far - near) / (far + near)
        for corner in quarters:
            quarters[corner] = quarters[corner] + (moved if corner[along] else -moved)
    return quarters


def pole_measures(grid: ParameterGrid, positions: Array) -> Array:
    """Areas of what closes the poles of a surface, shared among the nodes around them [m2], shape (*nodes)."""
    shares = np.zeros(grid.nodes)
    for ring in grid.rings:
        r00, r10, r01, r11 = strip_corners(positions[tuple(ring.T)])
        areas = np.tile(np.linalg.norm(np.cross(r11 - r00, r01 - r10), axis=-1) / 2.0, 2)
        shares[tuple(ring.T)] = (areas + np.roll(areas, 1)) / 8.0
    return shares


def strip_corners(ring: Array) -> Array:
    """Corners of the strips that close a pole: quads from an edge around it to the edge on the other side.

    Strip k has the corners r00, r10, r01, r11 at the nodes k, k + 1, k + 1 + n/2 and k + n/2; strip k + n/2 is the same
    one, seen from its other end. Together they cover what lies within the ring twice: whatever they count is halved.

    Args:
        ring: Values at the nodes around the pole, shape (n, ...), n even.

    Returns:
        Values at the corners, shape (4, n/2, ...).
    """
    count = len(ring)
    k = np.arange(count // 2)
    return np.stack([ring[k], ring[k + 1], ring[(k + 1 + count // 2) % count], ring[k + count // 2]])


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


def enclosed_volume(periodic: tuple[bool, ...], positions: Array, poles: tuple[bool, bool] = (False, False)) -> float:
    """Volume that a closed surface encloses [m3], ends of an open axis capped; positive if normals point outwards.

    Between two poles it is taken from the nodes and from the cells' centres (:mod:`warpdeform.kernels.pressure`).

    Args:
        periodic: Axes that close: both, or one.
        positions: Node positions [m], shape (nu, nv, 3).
        poles: Ends of the open axis that close at a pole.
    """
    grid = ParameterGrid(positions.shape[:2], (1.0, 1.0), periodic)
    r = positions - positions.mean(axis=(0, 1))
    rims = [r[tuple(ring_at(grid.nodes, periodic, end).T)] for end in (0, -1)] if not all(periodic) else []
    apexes = [rim.mean(axis=0) for rim in rims]
    volume = _volume_within(grid, r, apexes)
    if not all(poles):
        return volume
    centres = grid.means(grid.means(r, 0), 1)
    dual = ParameterGrid(centres.shape[:2], (1.0, 1.0), periodic)
    return (4.0 * volume - _volume_within(dual, centres, apexes)) / 3.0


def _volume_within(grid: ParameterGrid, r: Array, apexes: list[Array]) -> float:
    """Volume within bilinear cells and, at the ends of an open axis, fans of triangles to the apexes [m3]."""
    m1, m2 = mean_edges(grid, r)
    centre = grid.means(grid.means(r, 0), 1)
    volume = float(np.sum(centre * np.cross(m1, m2))) / 3.0
    rims, turns = rims_of(grid.nodes, grid.periodic)
    for rim, turn, apex in zip(rims, turns, apexes, strict=True):
        points = r[rim[:, 0], rim[:, 1]]
        around = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)
        volume += float(turn * np.dot(apex, around)) / 6.0
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
    rims = np.stack([ring_at(nodes, periodic, end) for end in (0, -1)])
    # Cells are r00, r10, r11, r01: along +u at the start of v, along -v at the start of u.
    return rims, np.array([-1.0, 1.0] if around == 0 else [1.0, -1.0])
