"""What the surface kernels multiply changes of curvature with (design 1.3), and the differences that measure it.

Across a pole the second difference along the open axis goes on to the node on the other side; it lies half a step
behind the pole on the grid of the rest shape, less on multigrid's coarser ones, where the steps on both sides differ.
The twist b12 is measured at cells, of which a pole has none. What it would store in the pole the nodes around it store
instead: around the ring the mean of 4 k12^2 is that of (k11 - k22)^2, for whatever curvature the pole has.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpdeform.coefficients import PaperWeights, SurfaceCoefficients
from warpdeform.forces.surface_chart import Chart
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.measure import corner_measures, pole_measures

Array = NDArray[np.float64]


class Bending(NamedTuple):
    """Coefficients of bending; attributes as in :class:`~warpdeform.forces.surface_coefficients.SurfaceStiffness`.

    Attributes:
        nodes: Called `bending` there.
        cells: Called `twist` there.
        coupling: The same there.
    """

    nodes: Array | None
    cells: Array | None
    coupling: Array | None


def orthogonal_bending(
    grid: ParameterGrid,
    chart: Chart,
    node_area: Array,
    rest: Array,
    material: SurfaceCoefficients | PaperWeights,
    at_nodes: SurfaceCoefficients | PaperWeights,
) -> Bending:
    """K of (b11, b22) at nodes, with the missing direction condensed out at borders, and of b12 at cells."""
    h1, h2 = grid.spacing
    if isinstance(at_nodes, PaperWeights):
        assert isinstance(material, PaperWeights)
        share = grid.cells_to_nodes(np.full(chart.area.shape, h1 * h2))
        for ring in grid.rings:
            share[tuple(ring.T)] += 0.5 * h1 * h2
        d11, d22 = (np.broadcast_to(xi, grid.nodes) for xi in at_nodes.xi[:2])
        d12 = np.zeros(grid.nodes)
        scale1, scale2 = np.full(grid.nodes, h1**2), np.full(grid.nodes, h2**2)
        twist = np.broadcast_to(2.0 * np.asarray(material.xi[2]) / (h1 * h2), chart.area.shape)
        in_poles = np.zeros((*grid.nodes, 3))
    else:
        assert isinstance(material, SurfaceCoefficients)
        share = node_area
        D = at_nodes.bending
        d11, d12, d22 = (np.broadcast_to(D[..., a, b], grid.nodes) for a, b in ((0, 0), (0, 1), (1, 1)))
        scale1, scale2 = squared_steps(grid, rest)
        twist = 4.0 * chart.area * material.bending[..., 2, 2] / (chart.g11 * chart.g22)
        in_poles = _twist_in_poles(grid, rest, D)
    inside1, inside2 = (np.broadcast_to(inside, grid.nodes) for inside in _between(grid))
    with np.errstate(divide="ignore", invalid="ignore"):
        alone1 = np.where(d22 > 0, d11 - d12**2 / d22, d11)
        alone2 = np.where(d11 > 0, d22 - d12**2 / d11, d22)
    k11 = np.where(inside1, np.where(inside2, d11, alone1), 0.0) * share
    k22 = np.where(inside2, np.where(inside1, d22, alone2), 0.0) * share
    k12 = np.where(inside1 & inside2, d12, 0.0) * share
    nodes = (np.stack([k11, k12, k22], axis=-1) + in_poles) / _products(scale1, scale2)
    return Bending(nodes, np.array(twist, dtype=np.float64), None)


def coupled_bending(grid: ParameterGrid, chart: Chart, rest: Array, at_nodes: SurfaceCoefficients) -> Bending:
    """K of (b11, b22) at nodes, of b12 at cells, and what couples them, on a chart whose axes are not orthogonal.

    Each corner of a cell has the energy b' C b/2 times its share of the cell's area, with the material of its node. The
    traces of design 1.3 are those of the Voigt map, which takes orthotropic bending as well. Until the end b is divided
    by g11, g22, sqrt(g11 g22).
    """
    D = np.broadcast_to(at_nodes.bending, (*grid.nodes, 3, 3))
    length = np.stack([chart.g11, chart.g22, np.sqrt(chart.g11 * chart.g22)], axis=-1)
    voigt = chart.voigt() * (length * np.array([1.0, 1.0, 2.0]))[..., None, :]
    bending, twist = np.zeros((*grid.nodes, 3)), np.zeros(chart.area.shape)
    coupling = np.zeros((*chart.area.shape, 2, 4))
    inside = [np.broadcast_to(inside, grid.nodes) for inside in _between(grid)]
    # The order of the corners 00, 10, 01, 11.
    for corner, ((di, dj), share) in enumerate(corner_measures(grid, rest).items()):
        owners = grid.corner_of_cells((di, dj))
        C = share[..., None, None] * np.einsum("...ap,...ab,...bq->...pq", voigt, D[owners], voigt)
        for entry in (0, 1):
            C = np.where(inside[entry][owners][..., None, None], C, _condensed(C, entry))
        C /= length[..., :, None] * length[..., None, :]
        bending[owners] += C[..., [0, 0, 1], [0, 1, 1]]
        twist += C[..., 2, 2]
        coupling[..., corner] = C[..., :2, 2]
    in_poles = pole_measures(grid, rest)[..., None] * D[..., [0, 0, 1], [0, 1, 1]] + _twist_in_poles(grid, rest, D)
    bending += in_poles / _products(*squared_steps(grid, rest))
    return Bending(bending, twist, coupling.reshape(*chart.area.shape, 8))


def _twist_in_poles(grid: ParameterGrid, rest: Array, D: Array) -> Array:
    """What (k11, k22) at the nodes around poles store in place of the twist there: 11, 12, 22, shape (nu, nv, 3).

    Its energy is D33 (2 k12)^2/2 times the area.
    """
    return (pole_measures(grid, rest) * D[..., 2, 2])[..., None] * np.array([1.0, -1.0, 1.0])


def _condensed(C: Array, entry: int) -> Array:
    """C, shape (..., 3, 3), for the rest of b when one entry is missing: it takes the value of least energy."""
    pivot, row = C[..., entry, entry], C[..., entry, :]
    soft = pivot <= 1e-12 * np.abs(C).max(axis=(-2, -1))
    ratio = np.where(soft, 0.0, 1.0 / np.where(soft, 1.0, pivot))
    C = C - ratio[..., None, None] * row[..., :, None] * row[..., None, :]
    C[..., entry, :] = C[..., :, entry] = 0.0
    return C


def _products(scale1: Array, scale2: Array) -> Array:
    """What divides the entries 11, 12, 22 of K where b is undivided, shape (nu, nv, 3)."""
    return np.stack([scale1**2, scale1 * scale2, scale2**2], axis=-1)


def _ends(grid: ParameterGrid | Layout, axis: int) -> tuple[bool, bool]:
    """Whether the first and the last node along an axis have a neighbour beyond."""
    return (True, True) if grid.periodic[axis] else grid.poles


def _between(grid: ParameterGrid) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether nodes have both neighbours along u, shape (nu, 1), and along v, shape (1, nv)."""
    inside1, inside2 = np.ones((grid.nodes[0], 1), bool), np.ones((1, grid.nodes[1]), bool)
    inside1[0, 0], inside1[-1, 0] = _ends(grid, 0)
    inside2[0, 0], inside2[0, -1] = _ends(grid, 1)
    return inside1, inside2


def _with_neighbours(grid: ParameterGrid, values: Array, axis: int) -> Array:
    """Values per node, shape (nu, nv, ...), with one more before and behind along an axis; NaN beyond a border."""
    around = 1 - axis
    before, behind = (np.take(values, [end], axis=axis) for end in ((-1, 0) if grid.periodic[axis] else (0, -1)))
    if not grid.periodic[axis]:
        half = grid.nodes[around] // 2
        before, behind = (
            np.roll(values_at_end, half, axis=around) if pole else np.full_like(values_at_end, np.nan)
            for values_at_end, pole in zip((before, behind), grid.poles, strict=True)
        )
    return np.concatenate([before, values, behind], axis=axis)


def _steps(grid: ParameterGrid, rest: Array, axis: int) -> tuple[Array, Array]:
    """Undivided differences of the nodes to the last and to the next ones along an axis; one is both at a border."""
    steps = np.diff(_with_neighbours(grid, rest, axis), axis=axis)
    last, following = np.delete(steps, -1, axis=axis), np.delete(steps, 0, axis=axis)
    return np.where(np.isnan(last), following, last), np.where(np.isnan(following), last, following)


def tangents(grid: ParameterGrid, rest: Array) -> tuple[Array, Array]:
    """Undivided tangents at the nodes: half central differences, whole one-sided differences at borders."""
    r1, r2 = (0.5 * sum(_steps(grid, rest, axis)) for axis in (0, 1))
    return np.asarray(r1), np.asarray(r2)


def squared_steps(grid: ParameterGrid, rest: Array) -> tuple[Array, Array]:
    """What second differences along u and v divide by to be second derivatives [m2], shape (nu, nv) each.

    The squared tangent; across a pole, where two steps may differ, the mean of their squares over that of their mean is
    a further factor.
    """
    found = []
    for axis in (0, 1):
        last, following = _steps(grid, rest, axis)
        scale = np.sum((0.5 * (last + following)) ** 2, axis=-1)
        for end, beyond in ((0, grid.poles[0]), (-1, grid.poles[1])):
            if beyond and not grid.periodic[axis]:
                at = (end, slice(None)) if axis == 0 else (slice(None), end)
                a, b = (np.linalg.norm(step[at], axis=-1) for step in (last, following))
                scale[at] *= 2.0 * (a**2 + b**2) / (a + b) ** 2
        found.append(scale)
    return found[0], found[1]


def difference_weights(layout: Layout) -> tuple[Array, Array]:
    """Weights of the forward and backward differences that make the tangents r_u and r_v at the nodes of a surface.

    Half and half inside, all on the one difference that exists at a border. Where an axis closes, around or at a pole,
    the places beside the body have weights too: those of the nodes that they repeat.

    Returns:
        Weights along u, shape (2, rows, 1), and along v, shape (2, 1, columns).
    """
    alpha_u, alpha_v = np.zeros((2, layout.rows, 1)), np.zeros((2, 1, layout.columns))
    u, v = alpha_u[:, :, 0], alpha_v[:, 0, layout.halo - 1 :]
    for axis, (along, count) in enumerate(zip((u, v), layout.nodes, strict=True)):
        starts, ends = _ends(layout, axis)
        along[:, 1 - starts : count + 1 + ends] = 0.5
        if not starts:
            along[:, 1] = 1.0, 0.0
        if not ends:
            along[:, count] = 0.0, 1.0
    return alpha_u, alpha_v
