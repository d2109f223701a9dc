"""What the surface kernels multiply strains with: material, chart and cell area in one matrix per sample (design 1.3).

All lengths are undivided differences of the rest shape, so that parameter spacings enter only with the paper's weights.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpdeform.errors import InputError, Mistake
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.material import PaperWeights, SurfaceCoefficients

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
) -> SurfaceStiffness:
    """Coefficients of a surface from its rest shape and material.

    Args:
        grid: Parameter grid.
        rest: Rest positions [m], shape (nu, nv, 3).
        material: Physical constants, or the paper's weights.
        like: Describe the surface by as many entries as there, leaving out what does not fit; None takes as many as it
            needs.

    Raises:
        InputError: A cell has no area.
    """
    chart = _Chart(grid.closed(rest))
    area = chart.area
    node_area = grid.cells_to_nodes(area)
    if isinstance(material, PaperWeights):
        membrane = _paper_membrane(grid, area.shape, material)
        bends = any(xi > 0 for xi in material.xi)
    else:
        membrane = _koiter_membrane(chart, material)
        bends = bool(np.any(material.bending))
    bending = twist = coupling = None
    if bends:
        right_angles = like.coupling is None if like else bool(np.all(np.abs(chart.cosine) <= RIGHT_ANGLE))
        if isinstance(material, PaperWeights) or right_angles:
            bending, twist = _bending(grid, chart, node_area, rest, material)
        else:
            bending, twist, coupling = _coupled_bending(grid, chart, material.bending)
    K = np.einsum("ap,...ab,bq->...pq", _FROM_Q, membrane, _FROM_Q)
    orthogonal = like.orthogonal if like else _is_orthogonal(K)
    entries = _ORTHOGONAL if orthogonal else _UPPER
    r1, r2 = _tangents(grid, rest)
    return SurfaceStiffness(
        orthogonal=orthogonal,
        membrane=np.stack([K[..., a, b] for a, b in entries], axis=-1),
        bending=bending,
        twist=twist,
        coupling=coupling,
        cell_area=area,
        node_area=node_area,
        cell_floor=4e-6 * float(np.min(area**2)),
        node_floor=1e-6 * float(np.min(np.sum(np.cross(r1, r2) ** 2, axis=-1))),
    )


class _Chart:
    """Rest cells: mean edges m1, m2, squared edge lengths, area, and the map to an orthonormal frame."""

    def __init__(self, rest: Array) -> None:
        r00, r10, r01, r11 = rest[:-1, :-1], rest[1:, :-1], rest[:-1, 1:], rest[1:, 1:]
        self.m1, self.m2 = 0.5 * (r10 + r11 - r00 - r01), 0.5 * (r01 + r11 - r00 - r10)
        self.edges_u = np.sum((r10 - r00) ** 2, axis=-1), np.sum((r11 - r01) ** 2, axis=-1)
        self.edges_v = np.sum((r01 - r00) ** 2, axis=-1), np.sum((r11 - r10) ** 2, axis=-1)
        self.g11, self.g12, self.g22 = (np.sum(a * b, axis=-1) for a, b in self._pairs())
        self.area = np.sqrt(np.maximum(self.g11 * self.g22 - self.g12**2, 0.0))
        if np.any(self.area <= 1e-6 * np.sqrt(self.g11 * self.g22)):
            i, j = np.argwhere(self.area <= 1e-6 * np.sqrt(self.g11 * self.g22))[0]
            raise InputError(
                Mistake(
                    "shape", [int(i), int(j)], "has a cell without area", "Give a rest shape whose cells are quads."
                )
            )
        self.cosine = self.g12 / np.sqrt(self.g11 * self.g22)

    def _pairs(self) -> list[tuple[Array, Array]]:
        return [(self.m1, self.m1), (self.m1, self.m2), (self.m2, self.m2)]

    def voigt(self) -> Array:
        """(E11, E22, 2 E12) over m1, m2 to the orthonormal frame whose first axis is m1, shape (..., 3, 3)."""
        f11 = np.sqrt(self.g11)
        f12, f22 = self.g12 / f11, self.area / f11
        a, b, d = 1.0 / f11, -f12 / (f11 * f22), 1.0 / f22
        zero = np.zeros_like(a)
        rows = [[a * a, zero, zero], [b * b, d * d, b * d], [2 * a * b, zero, a * d]]
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _koiter_membrane(chart: _Chart, material: SurfaceCoefficients) -> Array:
    """K over (A1, A2, m1.m2, X1, X2): edge strains normalised per edge first, Legendre modes on their own."""
    shape = chart.area.shape
    to_strain = np.zeros((*shape, 5, 5))
    for axis, (edges, g) in enumerate(((chart.edges_u, chart.g11), (chart.edges_v, chart.g22))):
        low, high = 0.5 / edges[0], 0.5 / edges[1]
        mean, difference = 0.5 * (low + high), 0.5 * (high - low)
        to_strain[..., axis, axis], to_strain[..., axis, 3 + axis] = g * mean, g * difference
        to_strain[..., 3 + axis, axis], to_strain[..., 3 + axis, 3 + axis] = difference, mean
    to_strain[..., 2, 2] = 1.0
    voigt = chart.voigt()
    law = np.zeros((*shape, 5, 5))
    law[..., :3, :3] = np.einsum("...ap,ab,...bq->...pq", voigt, material.membrane, voigt)
    for mode in (0, 1):
        law[..., 3 + mode, 3 + mode] = material.membrane_modes[mode] / 3.0
    return np.einsum("...ap,...ab,...bq->...pq", to_strain, law, to_strain) * chart.area[..., None, None]


def _paper_membrane(grid: ParameterGrid, cells: tuple[int, ...], weights: PaperWeights) -> Array:
    """The paper's eta_ij/4 (G_ij - G0_ij)^2: eta_11, eta_22 on edges, eta_12 on cells, integrated over parameters."""
    h1, h2 = grid.spacing
    K = np.zeros((*cells, 5, 5))
    for axis, (h, eta) in enumerate(zip((h1, h2), weights.eta[:2], strict=True)):
        K[..., axis, axis] = K[..., 3 + axis, 3 + axis] = h1 * h2 * eta / (2.0 * h**4)
    K[..., 2, 2] = weights.eta[2] / (h1 * h2)
    return K


def _bending(
    grid: ParameterGrid,
    chart: _Chart,
    node_area: Array,
    rest: Array,
    material: SurfaceCoefficients | PaperWeights,
) -> tuple[Array, Array]:
    """K of (b11, b22) at nodes, with the missing direction condensed out at borders, and of b12 at cells."""
    h1, h2 = grid.spacing
    if isinstance(material, PaperWeights):
        share = grid.cells_to_nodes(np.full(chart.area.shape, h1 * h2))
        d11, d22 = (np.full(grid.nodes, xi) for xi in material.xi[:2])
        d12 = np.zeros(grid.nodes)
        scale1, scale2 = np.full(grid.nodes, h1**2), np.full(grid.nodes, h2**2)
        twist = np.full(chart.area.shape, 2.0 * material.xi[2] / (h1 * h2))
    else:
        share = node_area
        D = material.bending
        d11, d12, d22 = (np.full(grid.nodes, D[a, b]) for a, b in ((0, 0), (0, 1), (1, 1)))
        r1, r2 = _tangents(grid, rest)
        scale1, scale2 = np.sum(r1**2, axis=-1), np.sum(r2**2, axis=-1)
        twist = 4.0 * chart.area * D[2, 2] / (chart.g11 * chart.g22)
    inside1, inside2 = np.ones(grid.nodes, bool), np.ones(grid.nodes, bool)
    if not grid.periodic[0]:
        inside1[[0, -1]] = False
    if not grid.periodic[1]:
        inside2[:, [0, -1]] = False
    with np.errstate(divide="ignore", invalid="ignore"):
        alone1 = np.where(d22 > 0, d11 - d12**2 / d22, d11)
        alone2 = np.where(d11 > 0, d22 - d12**2 / d11, d22)
    k11 = np.where(inside1, np.where(inside2, d11, alone1), 0.0) * share / scale1**2
    k22 = np.where(inside2, np.where(inside1, d22, alone2), 0.0) * share / scale2**2
    k12 = np.where(inside1 & inside2, d12, 0.0) * share / (scale1 * scale2)
    return np.stack([k11, k12, k22], axis=-1), twist


def _coupled_bending(grid: ParameterGrid, chart: _Chart, D: Array) -> tuple[Array, Array, Array]:
    """K of (b11, b22) at nodes, of b12 at cells, and what couples them, on a chart whose axes are not orthogonal.

    Each corner of a cell has the energy b' C b/2 times a quarter of the cell's area. The traces of design 1.3 are those
    of the Voigt map, which takes orthotropic bending as well. Until the end b is divided by g11, g22, sqrt(g11 g22).
    """
    nu, nv = grid.nodes
    length = np.stack([chart.g11, chart.g22, np.sqrt(chart.g11 * chart.g22)], axis=-1)
    voigt = chart.voigt() * (length * np.array([1.0, 1.0, 2.0]))[..., None, :]
    law = 0.25 * chart.area[..., None, None] * np.einsum("...ap,ab,...bq->...pq", voigt, D, voigt)
    bending, twist = np.zeros((nu, nv, 3)), np.zeros(chart.area.shape)
    coupling = np.zeros((*chart.area.shape, 2, 4))
    for corner, (di, dj) in enumerate(((0, 0), (1, 0), (0, 1), (1, 1))):
        C = law.copy()
        if not grid.periodic[0]:
            C[-di] = _condensed(C[-di], 0)
        if not grid.periodic[1]:
            C[:, -dj] = _condensed(C[:, -dj], 1)
        C /= length[..., :, None] * length[..., None, :]
        owners = np.ix_((np.arange(C.shape[0]) + di) % nu, (np.arange(C.shape[1]) + dj) % nv)
        bending[owners] += C[..., [0, 0, 1], [0, 1, 1]]
        twist += C[..., 2, 2]
        coupling[..., corner] = C[..., :2, 2]
    return bending, twist, coupling.reshape(*chart.area.shape, 8)


def _condensed(C: Array, entry: int) -> Array:
    """C, shape (..., 3, 3), for the rest of b when one entry is missing: it takes the value of least energy."""
    pivot, row = C[..., entry, entry], C[..., entry, :]
    soft = pivot <= 1e-12 * np.abs(C).max(axis=(-2, -1))
    ratio = np.where(soft, 0.0, 1.0 / np.where(soft, 1.0, pivot))
    C = C - ratio[..., None, None] * row[..., :, None] * row[..., None, :]
    C[..., entry, :] = C[..., :, entry] = 0.0
    return C


def _tangents(grid: ParameterGrid, rest: Array) -> tuple[Array, Array]:
    """Undivided tangents at the nodes: half central differences, whole one-sided differences at borders."""

    def along(axis: int) -> Array:
        if not grid.periodic[axis]:
            return np.asarray(np.gradient(rest, axis=axis))
        return 0.5 * (np.roll(rest, -1, axis=axis) - np.roll(rest, 1, axis=axis))

    return along(0), along(1)


def difference_weights(layout: Layout) -> tuple[Array, Array]:
    """Weights of the forward and backward differences that make the tangents r_u and r_v at the nodes of a surface.

    Half and half inside, all on the one difference that exists at a border. Along a periodic axis the places beside the
    body have weights too: those of the nodes that they repeat.

    Returns:
        Weights along u, shape (2, rows, 1), and along v, shape (2, 1, columns).
    """
    alpha_u, alpha_v = np.zeros((2, layout.rows, 1)), np.zeros((2, 1, layout.columns))
    u, v = alpha_u[:, :, 0], alpha_v[:, 0, layout.halo - 1 :]
    for along, count, periodic in zip((u, v), layout.nodes, layout.periodic, strict=True):
        if periodic:
            along[:, : count + 2] = 0.5
        else:
            along[:, 1 : count + 1] = 0.5
            along[:, 1], along[:, count] = (1.0, 0.0), (0.0, 1.0)
    return alpha_u, alpha_v


def _is_orthogonal(K: Array) -> bool:
    """True if only the six entries of the orthogonal variant differ from zero, uu and vv being the same."""
    rest = np.abs(K)
    limit = NEGLIGIBLE * rest.max(axis=(-2, -1), initial=0.0)
    rest[..., 3, 3] = rest[..., 4, 4] = np.abs(K[..., 3, 3] - K[..., 4, 4])
    for a, b in ((0, 0), (0, 1), (1, 0), (1, 1), (2, 2), (3, 4), (4, 3)):
        rest[..., a, b] = 0.0
    return bool(np.all(rest <= limit[..., None, None]))
