"""What the solid kernels multiply strains with: material, chart and cell volume (design 1.3).

All lengths are undivided differences of the rest shape, so that parameter spacings enter only with the paper's weights.
Strains are relative to the rest lengths of the edges, one by one. Their means over a cell are those of the tensor E_ij
over the cell's mean edges m_i, and go through its metric Gh_ij = m_i.m_j; with L_i = |m_i| and g^ij = L_i L_j Gh^ij

    W/V = lambda/2 (g^ij e_ij)^2 + mu g^ik g^jl e_ij e_kl,      e_ij = E_ij / (L_i L_j)

What varies within a cell stays out of that. Extensions and shear in the plane of two axes that vary along the third
one are in plane stress, as in a plate that bends: the same law in two dimensions, 2 mu nu/(1 - nu) in place of lambda,
a third of it, which is the mean square of a slope. Cross modes of extension are in uniaxial stress, E/2, a ninth of it.
Departs from the design, where slopes do not know of each other and cost E/2: plates one cell thick were 9 % soft at
nu = 0.3 and bend exactly now, beams two cells thick err by half as much, and cells that lean bend and twist as upright
ones do.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from warpdeform.coefficients import Number, PaperSolidWeights, SolidCoefficients
from warpdeform.errors import InputError, Mistake
from warpdeform.grid import ParameterGrid
from warpdeform.kernels.solid_volume import LEAST
from warpdeform.measure import mean_edges

Array = NDArray[np.float64]

BOX = 1e-6
"""Cells are boxes if the lengths and angles of their edges are those of a box to within this fraction.

The coefficients of the orthogonal variant are then as exact; rest lengths are measured one by one all the same.
"""
PAIRS = ((0, 1), (0, 2), (1, 2))
"""Axes of the shears, in the order 12, 13, 23."""


@dataclass(frozen=True)
class SolidStiffness:
    """Coefficients of the discrete energy of one solid.

    Attributes:
        orthogonal: The law is diagonal but for the mean extensions: cells are boxes, or have the paper's weights.
        cells: K per cell, shape (*cells, 21 or 16), or of all cells alike, shape (21,). Orthogonal: of the sums of
            extensions 11, 12, 13, 22, 23, 33; of slopes 11, 22, 33, 12, 13, 23; of cross modes 1, 2, 3; of the sums of
            shears 12, 13, 23, and of their differences. Else: h = sqrt(2 mu V) g; 1/(8 L_i L_j); the cosine between
            m_i and m_j; 2 mu V/3 over the fourth power of its sine; V E/9.
        edges: t of the edges that begin at each node, along u, v, w: a quarter of 1/|e0|^2, zero where there is none,
            shape (*nodes, 3); None if orthogonal.
        ratios: lambda / (2 mu) in space and in plane stress; 0 if orthogonal.
        share: 1 in every cell, shape (*cells).
        volume: kappa V of the barrier against inversion, 1/(64 m1.(m2 x m3)), 1; shape (*cells, 3); None without one.
        cell_volume: Rest volumes by mean edges [m3], shape (*cells).
        node_volume: Trapezoid shares of the rest volume [m3], shape (*nodes).
    """

    orthogonal: bool
    cells: Array
    edges: Array | None
    ratios: tuple[float, float]
    share: Array
    volume: Array | None
    cell_volume: Array
    node_volume: Array

    @property
    def uniform(self) -> bool:
        """All cells have the same K."""
        return self.cells.ndim == 1


def solid_stiffness(
    grid: ParameterGrid,
    rest: Array,
    material: SolidCoefficients | PaperSolidWeights,
    like: SolidStiffness | None = None,
) -> SolidStiffness:
    """Coefficients of a solid from its rest shape and material.

    Args:
        grid: Parameter grid.
        rest: Rest positions [m], shape (*nodes, 3).
        material: Physical constants, or the paper's weights; at the cells where they vary.
        like: Take the variant that is taken there, leaving out what does not fit; None takes what is needed.

    Raises:
        InputError: A cell has no volume, an edge has no length, or a cell is turned inside out.
    """
    chart, share, volume = RestCells(grid, rest), np.ones(grid.cells), None
    if np.any(material.inversion_barrier):
        strength = material.inversion_barrier * chart.volume
        volume = np.stack([strength, 1.0 / (64.0 * chart.signed_volume), share], axis=-1)
    if isinstance(material, PaperSolidWeights):
        orthogonal, cells, edges, ratios = True, _paper_law(grid, material), None, (0.0, 0.0)
    else:
        orthogonal = like.orthogonal if like else chart.boxes
        nu = material.poisson_ratio
        ratios = (nu / (1.0 - 2.0 * nu), nu / (1.0 - nu))
        if orthogonal:
            cells, edges = _box_law(chart, material, ratios), None
        else:
            cells = _chart_law(chart, material)
            edges = np.stack([chart.edge_weights(axis) for axis in range(3)], axis=-1)
    return SolidStiffness(
        orthogonal=orthogonal,
        cells=cells,
        edges=edges,
        ratios=ratios,
        share=share,
        volume=volume,
        cell_volume=chart.volume,
        node_volume=grid.cells_to_nodes(chart.volume),
    )


class RestCells:
    """Rest cells: mean edges, lengths of all edges, volume.

    Args:
        grid: Parameter grid.
        rest: Rest positions [m], shape (*nodes, 3).
        check: Refuse what is no rest shape.

    Attributes:
        mean: Mean edges m_i, shape (*cells, 3 axes, 3).
        signed_volume: m1.(m2 x m3) [m3], shape (*cells).
        volume: Its magnitude.

    Raises:
        InputError: A cell has no volume, an edge has no length, or a cell is turned inside out.
    """

    def __init__(self, grid: ParameterGrid, rest: Array, check: bool = True) -> None:
        self._nodes = grid.nodes
        closed = grid.closed(rest)
        self._squares = [np.sum(np.diff(closed, axis=axis) ** 2, axis=-1) for axis in range(3)]
        self.mean = np.stack(mean_edges(grid, rest), axis=-2)
        self.metric = np.einsum("...ia,...ja->...ij", self.mean, self.mean)
        self.lengths = np.sqrt(np.einsum("...ii->...i", self.metric))
        self.signed_volume = np.linalg.det(self.mean)
        self.volume = np.abs(self.signed_volume)
        if check:
            self._refuse()

    def _refuse(self) -> None:
        flat = self.volume <= 1e-6 * np.prod(self.lengths, axis=-1)
        inside_out = self.signed_volume * np.sum(self.signed_volume) < 0.0
        for wrong, problem, remedy in (
            (flat, "has a cell without volume", "Give a rest shape whose cells are hexahedra."),
            (inside_out, "has a cell that is turned inside out", "Give a rest shape that does not fold over."),
            *(
                (squares <= 0.0, f"has an edge along {name} without length", "Give a rest shape without poles.")
                for name, squares in zip("uvw", self._squares, strict=True)
            ),
        ):
            if wrong.any():
                raise InputError(Mistake("shape", np.argwhere(wrong)[0].tolist(), problem, remedy))

    @property
    def boxes(self) -> bool:
        """Every cell is a rectangular box."""
        for axis, squares in enumerate(self._squares):
            alike = np.square(self.lengths[..., axis])
            if any(np.abs(s - alike).max() > BOX * alike.max() for s in _around_cell(squares, axis)):
                return False
        return bool(max(np.abs(self.cosine(i, j)).max() for i, j in PAIRS) <= BOX)

    def cosine(self, i: int, j: int) -> Array:
        """Of the angle between two mean edges, shape (*cells)."""
        return np.asarray(self.metric[..., i, j] / (self.lengths[..., i] * self.lengths[..., j]))

    def edge_weights(self, axis: int) -> Array:
        """1/(4 |e0|^2) of the edges along an axis that begin at each node, 0 where there is none, shape (*nodes)."""
        weights = np.zeros(self._nodes)
        squares = self._squares[axis][tuple(slice(n) for n in self._nodes)]
        weights[tuple(slice(n) for n in squares.shape)] = 0.25 / squares
        return weights


def _around_cell(edges: Array, axis: int) -> list[Array]:
    """The four edges along an axis of each cell, shape (*cells, ...) each."""
    cells = []
    for offsets in product((0, 1), repeat=2):
        at = list(offsets)
        at.insert(axis, 0)
        ends = [n if k == axis else n - 1 for k, n in enumerate(edges.shape[:3])]
        cells.append(edges[tuple(slice(a, a + n) for a, n in zip(at, ends, strict=True))])
    return cells


def _box_law(chart: RestCells, material: SolidCoefficients, ratios: tuple[float, float]) -> Array:
    """K where all edges of a cell along an axis have one length: sums are four or two times the means."""
    squares, E = np.square(chart.lengths), material.youngs_modulus
    mu = _shear_modulus(material)

    def over(i: int, j: int) -> Array:
        return np.asarray(chart.volume / (16.0 * squares[..., i] * squares[..., j]))

    space, plane = (2.0 * mu * ratio for ratio in ratios)
    sums = [
        (space + (2.0 * mu if i == j else 0.0)) * over(i, j)
        for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    ]
    slopes = [(plane + 2.0 * mu) / 3.0 * over(i, i) for i in range(3)]
    slopes += [plane / 3.0 * over(i, j) for i, j in PAIRS]
    crosses = [E / 9.0 * over(i, i) for i in range(3)]
    shears = [mu * over(i, j) for i, j in PAIRS]
    K = np.stack([*sums, *slopes, *crosses, *shears, *(k / 3.0 for k in shears)], axis=-1)
    mean = K.reshape(-1, K.shape[-1]).mean(axis=0)
    return mean if np.all(np.abs(K - mean) <= 10.0 * BOX * np.abs(mean)) else K


def _chart_law(chart: RestCells, material: SolidCoefficients) -> Array:
    """K of Hooke's law in a chart; edges count by t q, faces by q / (8 L_i L_j)."""
    mu, volume = _shear_modulus(material), chart.volume
    scale = chart.lengths[..., :, None] * chart.lengths[..., None, :]
    h = np.sqrt(2.0 * mu * volume)[..., None, None] * scale * np.linalg.inv(chart.metric)
    cosines = [chart.cosine(i, j) for i, j in PAIRS]
    entries = [h[..., i, j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
    entries += [1.0 / (8.0 * scale[..., i, j]) for i, j in PAIRS]
    entries += cosines
    entries += [2.0 / 3.0 * mu * volume / (1.0 - cosine**2) ** 2 for cosine in cosines]
    return np.stack([*entries, material.youngs_modulus / 9.0 * volume], axis=-1)


def _shear_modulus(material: SolidCoefficients) -> Number:
    return material.youngs_modulus / (2.0 * (1.0 + material.poisson_ratio))


def _paper_law(grid: ParameterGrid, weights: PaperSolidWeights) -> Array:
    """K of eta_ij/4 (G_ij - G0_ij)^2 integrated over the parameters: eta_ii on edges, eta_ij on faces."""
    h = np.array(grid.spacing)
    volume = float(np.prod(h))
    along = [volume * weights.eta[i] / (8.0 * h[i] ** 4) for i in range(3)]
    shears = [volume * weights.eta[3 + n] / (16.0 * (h[i] * h[j]) ** 2) for n, (i, j) in enumerate(PAIRS)]
    sums = [along[0], 0.0, 0.0, along[1], 0.0, along[2]]
    return np.stack(np.broadcast_arrays(*sums, *along, 0.0, 0.0, 0.0, *along, *shears, *shears), axis=-1)


def refuse_inverted(grid: ParameterGrid, rest: Array, positions: Array, key: str = "initial_positions") -> None:
    """Refuse to start a solid with a barrier from where the barrier is infinite.

    Args:
        grid: Parameter grid.
        rest: Rest positions [m], shape (*nodes, 3).
        positions: Where the solid starts [m], same shape.
        key: What to call them in the message.

    Raises:
        InputError: A cell is flat or turned inside out; with its index.
    """
    ratio = RestCells(grid, positions, check=False).signed_volume / RestCells(grid, rest).signed_volume
    if ratio.min() <= LEAST:
        cell = [int(k) for k in np.unravel_index(np.argmin(ratio), ratio.shape)]
        problem = f"has a cell that is flat or turned inside out, with {ratio.min():.3g} of its rest volume"
        remedy = "Start from cells that are upright, or leave out inversion_barrier."
        raise InputError(Mistake(key, cell, problem, remedy))
