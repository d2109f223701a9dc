"""Metric and curvature tensors of a body at their samples (paper, first and second fundamental form; design 1.1)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpdeform.grid import ParameterGrid

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Metric:
    """Metric tensor at its samples, in parameter units; along a periodic axis there are as many cells as nodes.

    Attributes:
        G11: On the u-edges: shape (*nodes) with a cell for a node along u; all that curves have.
        G12: Surfaces and solids, at the faces between u and v: with cells for nodes along both.
        G22: Surfaces and solids, on the v-edges.
        G13: Solids, at the faces between u and w.
        G23: Solids, at the faces between v and w.
        G33: Solids, on the w-edges.
    """

    G11: Array
    G12: Array | None = None
    G22: Array | None = None
    G13: Array | None = None
    G23: Array | None = None
    G33: Array | None = None


@dataclass(frozen=True)
class Curvature:
    """Curvature tensor of a surface at its samples [m over parameter units squared].

    Attributes:
        B11: At the nodes that have both u-neighbours: shape (nu - 2, nv), or (nu, nv) where u is periodic. Where u ends
            at a pole, the nodes beside it have both: one row more for each.
        B12: At the cells, shape (*cells).
        B22: At the nodes that have both v-neighbours: shape (nu, nv - 2), or (nu, nv) where v is periodic; poles alike.
    """

    B11: Array
    B12: Array
    B22: Array


@dataclass(frozen=True)
class CurveCurvature:
    """Curvature of a curve at the nodes that have both neighbours.

    Attributes:
        binormal: Curvature times the unit binormal [1/m], shape (n - 2, strands, 3), or (n, strands, 3) where the curve
            is closed.
    """

    binormal: Array


def metric_of(grid: ParameterGrid, positions: Array) -> Metric:
    """The metric tensor: of edges on the edges, of two mean edges at the faces between them.

    Args:
        grid: Parameter grid.
        positions: Node positions [m], shape (*nodes, 3).
    """
    found = {}
    for a in range(grid.dimension):
        edges = grid.differences(positions, a)
        found[f"G{a + 1}{a + 1}"] = np.sum(edges**2, axis=-1) / grid.spacing[a] ** 2
        for b in range(a + 1, grid.dimension):
            # Edges are per node along the other axis: the mean of two neighbours belongs to the face between them.
            along_a, along_b = grid.means(edges, b), grid.means(grid.differences(positions, b), a)
            found[f"G{a + 1}{b + 1}"] = np.sum(along_a * along_b, axis=-1) / (grid.spacing[a] * grid.spacing[b])
    return Metric(**found)


def curvature_of_curve(grid: ParameterGrid, positions: Array) -> CurveCurvature:
    """Curvature binormals kb / l of the edges a and b at a node, kb = 2 a x b / (|a||b| + a.b), l their mean length."""
    edges = grid.differences(positions, 0)
    a, b = edges[:-1], edges[1:]
    if grid.periodic[0]:
        a, b = np.roll(edges, 1, axis=0), edges
    la, lb = np.linalg.norm(a, axis=-1), np.linalg.norm(b, axis=-1)
    length = 0.5 * (la + lb) * (la * lb + np.sum(a * b, axis=-1))
    return CurveCurvature(2.0 * np.cross(a, b) / length[..., None])
