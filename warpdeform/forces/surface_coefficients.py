"""What the surface kernels multiply strains with: material, chart and cell area in one matrix per sample (design 1.3).

All lengths are undivided differences of the rest shape, so that parameter spacings enter only with the paper's weights.

A departure from the design: the strain of a cell along an axis is the mean of its two edges' strains *by their length*,
am = (a0 e0 + a1 e1)/(a0 + a1), not half of each. Where opposite edges are alike it is the same. Where they are not, a
cell under an even strain then pulls at its corners by the derivative of its area, and an even stress leaves no force on
a flat sheet whatever its chart; with halves a polar chart has forces beside its pole that do not fall with the spacing
(a sphere under pressure was 40 % off there on every grid).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpdeform.coefficients import PaperWeights, SurfaceCoefficients
from warpdeform.errors import InputError, Mistake
from warpdeform.forces.surface_bending import Bending, coupled_bending, orthogonal_bending, tangents
from warpdeform.forces.surface_chart import Chart, cells_of
from warpdeform.grid import ParameterGrid
from warpdeform.measure import node_measures, strip_corners

Array = NDArray[np.float64]

RIGHT_ANGLE = 1e-5
"""Largest |cos| between the axes of a chart for which twist is not coupled to the other curvatures.

Uncoupled, bending is off by up to 1.8 times the cosine; shapes kept in single precision are skewed by 1e-7.
"""
NEGLIGIBLE = 1e-10
"""Entries of K below this fraction of the largest are round-off of the rest shape and count as zero."""

# Columns: q = (s, t, c, u, v). Rows: mean squared lengths A1, A2 of the u- and v-edges, m1.m2, half-differences X1, X2.
_FROM_Q = 0.5 * np.array([[1, 1, 0, 0, 0], [1, -1, 0, 0, 0], [0, 0, 1, 0, 0], [0, 0, 0, 1, 1], [0, 0, 0, 1, -1]])
_ORTHOGONAL = [(0, 0), (0, 1), (1, 1), (2, 2), (3, 3), (3, 4)]
_UPPER = [(a, b) for a in range(5) for b in range(a, 5)]


@dataclass(frozen=True)
class SurfaceStiffness:
    """Coefficients of the discrete energy of one surface, which has as many cells along a periodic axis as nodes.

    Attributes:
        orthogonal: Cells have right angles and opposite edges of one length, so six entries describe K.
        membrane: K of q per cell, shape (*cells, 6 or 15).
        strips: K of q per strip across a pole, shape (poles, n/2, 15); no poles, shape (0, 0, 15).
        bending: K of (b11, b22) per node: 11, 12, 22, shape (nu, nv, 3); None without bending.
        twist: K of b12 per cell, shape (*cells); None without bending.
        coupling: K of b12 with b11, then with b22, at the corners 00, 10, 01, 11 of each cell, shape
            (*cells, 8); None without bending, on charts with right angles, and with the paper's weights.
        cell_area: Rest areas [m2], shape (*cells).
        node_area: Trapezoid shares of the rest area [m2], shape (nu, nv).
        cell_floor: Smallest |D x E|^2 that curvature divides by [m4]: a cell at a thousandth of its rest area.
        node_floor: Smallest |r_u x r_v|^2 that curvature divides by [m4].
    """

    orthogonal: bool
    membrane: Array
    strips: Array
    bending: Array | None
    twist: Array | None
    coupling: Array | None
    cell_area: Array
    node_area: Array
    cell_floor: float
    node_floor: float


def surface_stiffness(
    grid: ParameterGrid,
    rest: Array,
    material: SurfaceCoefficients | PaperWeights,
    like: "SurfaceStiffness | None" = None,
    at_nodes: SurfaceCoefficients | PaperWeights | None = None,
) -> SurfaceStiffness:
    """Coefficients of a surface from its rest shape and material.

    Args:
        grid: Parameter grid.
        rest: Rest positions [m], shape (nu, nv, 3).
        material: Physical constants, or the paper's weights; of one that varies, those at the cells.
        like: Describe the surface by as many entries as there, leaving out what does not fit; None takes as many as it
            needs.
        at_nodes: Of a material that varies, those at the nodes; None if it does not.

    Raises:
        InputError: A cell has no area.
    """
    nodes = at_nodes or material
    chart = cells_of(grid, rest)
    if (where := chart.flat()) is not None:
        problem, remedy = "has a cell without area", "Give a rest shape whose cells are quads."
        raise InputError(Mistake("shape", where, problem, remedy))
    node_area = node_measures(grid, rest)
    if isinstance(material, PaperWeights):
        membrane = _paper_membrane(grid.spacing, chart, material)
        bends = any(np.any(np.asarray(xi) > 0) for xi in material.xi)
    else:
        membrane = _koiter_membrane(chart, material)
        bends = bool(np.any(material.bending))
    bent = Bending(None, None, None)
    if bends:
        right_angles = like.coupling is None if like else bool(np.all(np.abs(chart.cosine) <= RIGHT_ANGLE))
        if right_angles or isinstance(nodes, PaperWeights):
            bent = orthogonal_bending(grid, chart, node_area, rest, material, nodes)
        else:
            bent = coupled_bending(grid, chart, rest, nodes)
    K = _of_q(membrane)
    orthogonal = like.orthogonal if like else _is_orthogonal(K)
    r1, r2 = tangents(grid, rest)
    strips = [_strip_stiffness(grid, tuple(ring.T), rest, nodes) for ring in grid.rings]
    return SurfaceStiffness(
        orthogonal=orthogonal,
        membrane=_entries(K, _ORTHOGONAL if orthogonal else _UPPER),
        strips=np.array(strips) if strips else np.zeros((0, 0, len(_UPPER))),
        bending=bent.nodes,
        twist=bent.cells,
        coupling=bent.coupling,
        cell_area=chart.area,
        node_area=node_area,
        cell_floor=4e-6 * float(np.min(chart.area**2)),
        node_floor=1e-6 * float(np.min(np.sum(np.cross(r1, r2) ** 2, axis=-1))),
    )


def _strip_stiffness(
    grid: ParameterGrid, ring: tuple[Array, ...], rest: Array, material: SurfaceCoefficients | PaperWeights
) -> Array:
    """K of q of the strips across a pole, shape (n/2, 15); `ring` is the index of the nodes around it.

    A strip obeys the law of a cell, its first axis along the ring. It is a rectangle, so an even strain of the pole is
    measured exactly; together the strips cover the pole twice, so each counts half. In parameters, in which the paper's
    weights count, the pole is half a step deep, and they cover it once.
    """
    around = grid.periodic.index(True)
    chart = Chart(*strip_corners(rest[ring]))
    material = material.mapped(lambda values: strip_corners(values[ring]).mean(axis=0))
    if around == 1:
        material = material.exchanged()
    if isinstance(material, PaperWeights):
        K = _paper_membrane((grid.spacing[around], grid.spacing[1 - around]), chart, material)
    else:
        K = 0.5 * _koiter_membrane(chart, material)
    return _entries(_of_q(K), _UPPER)


def _koiter_membrane(chart: Chart, material: SurfaceCoefficients) -> Array:
    """K over (A1, A2, m1.m2, X1, X2): edge strains normalised per edge first, Legendre modes on their own."""
    shape = chart.area.shape
    to_strain = np.zeros((*shape, 5, 5))
    for axis, (edges, g) in enumerate(((chart.edges_u, chart.g11), (chart.edges_v, chart.g22))):
        low, high = 0.5 / edges[0], 0.5 / edges[1]
        share = np.sqrt(edges[0]) / (np.sqrt(edges[0]) + np.sqrt(edges[1]))
        for row, factor, a, b in (
            (axis, g, share * low, (1.0 - share) * high),
            (3 + axis, 1.0, -0.5 * low, 0.5 * high),
        ):
            to_strain[..., row, axis], to_strain[..., row, 3 + axis] = factor * (b + a), factor * (b - a)
    to_strain[..., 2, 2] = 1.0
    voigt = chart.voigt()
    law = np.zeros((*shape, 5, 5))
    law[..., :3, :3] = np.einsum("...ap,...ab,...bq->...pq", voigt, material.membrane, voigt)
    for mode in (0, 1):
        law[..., 3 + mode, 3 + mode] = material.membrane_modes[mode] / 3.0
    return np.einsum("...ap,...ab,...bq->...pq", to_strain, law, to_strain) * chart.area[..., None, None]


def _paper_membrane(spacing: tuple[float, ...], chart: Chart, weights: PaperWeights) -> Array:
    """The paper's eta_ij/4 (G_ij - G0_ij)^2: eta_11, eta_22 on edges, eta_12 on cells, integrated over parameters."""
    h1, h2 = spacing
    K = np.zeros((*chart.area.shape, 5, 5))
    for axis, (h, eta) in enumerate(zip((h1, h2), weights.eta[:2], strict=True)):
        K[..., axis, axis] = K[..., 3 + axis, 3 + axis] = h1 * h2 * eta / (2.0 * h**4)
    K[..., 2, 2] = weights.eta[2] / (h1 * h2)
    return K


def _of_q(membrane: Array) -> Array:
    """K over q, of K over (A1, A2, m1.m2, X1, X2)."""
    return np.einsum("ap,...ab,bq->...pq", _FROM_Q, membrane, _FROM_Q)


def _entries(K: Array, entries: list[tuple[int, int]]) -> Array:
    return np.stack([K[..., a, b] for a, b in entries], axis=-1)


def _is_orthogonal(K: Array) -> bool:
    """True if only the six entries of the orthogonal variant differ from zero, uu and vv being the same."""
    rest = np.abs(K)
    limit = NEGLIGIBLE * rest.max(axis=(-2, -1), initial=0.0)
    rest[..., 3, 3] = rest[..., 4, 4] = np.abs(K[..., 3, 3] - K[..., 4, 4])
    for a, b in ((0, 0), (0, 1), (1, 0), (1, 1), (2, 2), (3, 4), (4, 3)):
        rest[..., a, b] = 0.0
    return bool(np.all(rest <= limit[..., None, None]))
