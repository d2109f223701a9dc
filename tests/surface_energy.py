"""The discrete energy of surfaces, design 1.3, written in NumPy.

The oracle knows nothing of the kernels: no diagonals, no K, no fluxes, no halo. Its energy is the formula of the
design, one sample at a time; derivatives of it are taken by complex steps, which are exact to round-off.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpdeform.coefficients import PaperWeights, SurfaceCoefficients
from warpdeform.material import Material
from warpdeform.shape import RestShape

Array = NDArray[Any]

CORNERS = ((0, 0), (1, 0), (0, 1), (1, 1))
"""Offsets (di, dj) of a cell's corners 00, 10, 01, 11."""


def dot(a: Array, b: Array) -> Array:
    return np.asarray(np.sum(a * b, axis=-1))


def unit(a: Array) -> Array:
    return np.asarray(a / np.sqrt(dot(a, a))[..., None])


class Closing(NamedTuple):
    """How a grid closes: its periodic axes, and the ends of the other one that are poles."""

    periodic: tuple[bool, ...] = (False, False)
    poles: tuple[bool, ...] = (False, False)

    @property
    def rings(self) -> list[Any]:
        """Index of the nodes around each pole."""
        ends = [end for end, pole in zip((0, -1), self.poles, strict=True) if pole]
        return [(slice(None), end) if self.periodic[0] else (end, slice(None)) for end in ends]


OPEN = Closing()


def closed(r: Array, periodic: tuple[bool, ...]) -> Array:
    """Positions with the first ones again behind the last along periodic axes: every cell has its corners."""
    return np.pad(r, [(0, int(p)) for p in periodic] + [(0, 0)], mode="wrap")


def neighbours(r: Array, axis: int, closing: Closing) -> tuple[Array, Array]:
    """The last and the next node along an axis: around it, or across a pole; NaN where there is none."""
    last, following = np.roll(r, 1, axis=axis), np.roll(r, -1, axis=axis)
    if not closing.periodic[axis]:
        for array, end, pole in ((last, 0, closing.poles[0]), (following, -1, closing.poles[1])):
            at = (slice(None), end) if axis == 1 else (end, slice(None))
            array[at] = np.roll(r[at], r.shape[1 - axis] // 2, axis=0) if pole else np.nan
    return last, following


def tangents(r: Array, closing: Closing = OPEN) -> list[Array]:
    """Undivided central differences at the nodes, one-sided at borders."""
    found = []
    for axis in (0, 1):
        last, following = neighbours(r, axis, closing)
        back, on = r - last, following - r
        found.append((np.where(np.isnan(back), on, back) + np.where(np.isnan(on), back, on)) / 2)
    return found


def between(nodes: tuple[int, int], closing: Closing = OPEN) -> list[Array]:
    """Whether the nodes have both neighbours, along u and along v, shape (nu, nv) each."""
    return [~np.isnan(sum(neighbours(np.zeros((*nodes, 1)), axis, closing)))[..., 0] for axis in (0, 1)]


def at_corner(cells: tuple[int, ...], nodes: tuple[int, int], corner: tuple[int, int]) -> Any:
    """Index of the nodes that are that corner of the cells."""
    return np.ix_(*((np.arange(count) + step) % n for count, n, step in zip(cells, nodes, corner, strict=True)))


def mean_edges(r: Array) -> tuple[Array, Array]:
    u, v = np.diff(r, axis=0), np.diff(r, axis=1)
    return (u[:, :-1] + u[:, 1:]) / 2, (v[:-1] + v[1:]) / 2


def membrane_numbers(r: Array) -> Array:
    """Per cell the squared lengths of its u-edges and v-edges and m1.m2, shape (*cells, 5), of closed positions."""
    u, v = np.diff(r, axis=0), np.diff(r, axis=1)
    lu, lv = dot(u, u), dot(v, v)
    return np.stack([lu[:, :-1], lu[:, 1:], lv[:-1], lv[1:], dot(*mean_edges(r))], axis=-1)


def bending_numbers(r: Array, closing: Closing = OPEN) -> tuple[Array, Array]:
    """Undivided B11, B22 at the nodes, zero where a neighbour is missing, and B12 at the cells."""
    n, inside = unit(np.cross(*tangents(r, closing))), between(r.shape[:2], closing)
    second = [sum(neighbours(r, axis, closing)) - 2 * r for axis in (0, 1)]
    b = np.stack([np.where(has, dot(n, s), 0.0) for has, s in zip(inside, second, strict=True)], axis=-1)
    c = closed(r, closing.periodic)
    return b, dot(unit(np.cross(*mean_edges(c))), c[:-1, :-1] - c[1:, :-1] - c[:-1, 1:] + c[1:, 1:])


def corner_numbers(b: Array, b12: Array) -> Array:
    """(b11, b22, b12) as the corners 00, 10, 01, 11 of the cells see them, shape (*cells, 4, 3)."""
    at_corners = np.stack([b[at_corner(b12.shape, b.shape[:2], corner)] for corner in CORNERS], axis=2)
    return np.concatenate([at_corners, np.broadcast_to(b12[..., None, None], (*b12.shape, 4, 1))], axis=-1)


def existing(nodes: tuple[int, int], closing: Closing = OPEN) -> Array:
    """Whether the corners of the cells have b11, b22, b12, shape (*cells, 4, 3)."""
    cells = [n if wraps else n - 1 for n, wraps in zip(nodes, closing.periodic, strict=True)]
    return corner_numbers(np.stack(between(nodes, closing), axis=-1), np.ones(cells, dtype=bool))


def node_weights(corners: Array, nodes: tuple[int, int]) -> Array:
    """What weights at the corners of the cells, shape (*cells, 4, 3, 3), add to the nodes' of (b11, b22)."""
    weights = np.zeros((*nodes, 2, 2))
    for index, corner in enumerate(CORNERS):
        weights[at_corner(corners.shape[:2], nodes, corner)] += corners[:, :, index, :2, :2]
    return weights


@dataclass
class DiscreteEnergy:
    """An energy of those numbers: any quadratic `membrane` of the change of the cells' five, and weights of bending.

    Attributes:
        rest: Rest positions, shape (nu, nv, 3).
        membrane: Energy per cell from the change of its five numbers since rest.
        bending: Weights of (b11, b22), shape (nu, nv, 2, 2), or zeros (2, 2).
        twist: Weights of b12, shape (*cells), or 0.
        corners: Weights of (b11, b22, b12) at the cells' corners, shape (*cells, 4, 3, 3), or zeros (3, 3).
        closing: How the grid closes.
        strips: Energies of quads of nodes beside the grid's cells, with the indices of those, shape (2, 2).
    """

    rest: Array
    membrane: Callable[[Array], Array]
    bending: Array
    twist: Array
    corners: Array = field(default_factory=lambda: np.zeros((3, 3)))
    closing: Closing = OPEN
    strips: "list[tuple[DiscreteEnergy, Array]]" = field(default_factory=list)

    def numbers(self, r: Array) -> Array:
        return membrane_numbers(closed(r, self.closing.periodic))

    def bends(self, r: Array) -> tuple[Array, Array]:
        return bending_numbers(r, self.closing)

    def energy(self, r: Array) -> Any:
        (b, c), (b0, c0) = self.bends(r), self.bends(self.rest)
        density = self.membrane(self.numbers(r) - self.numbers(self.rest)) + self.twist * (c - c0) ** 2 / 2
        mixed = corner_numbers(b - b0, c - c0)
        mixed = np.einsum("...a,...ab,...b->...", mixed, self.corners, mixed)
        bent = np.einsum("...a,...ab,...b->...", b - b0, self.bending, b - b0)
        within = sum(strip.energy(r.reshape(-1, 3)[nodes]) for strip, nodes in self.strips)
        return density.sum() + (bent.sum() + mixed.sum()) / 2 + within

    def slope(self, r: Array, p: Array) -> float:
        """Derivative of the energy at r along p, by a complex step."""
        return float(self.energy(r + 1e-30j * p).imag * 1e30)

    def gradient(self, r: Array) -> Array:
        slopes = [self.slope(r, p.reshape(r.shape)) for p in np.eye(r.size)]
        return np.array(slopes).reshape(r.shape)

    def projected_hessian(self, r: Array) -> Array:
        """Design 2.1, dense: J' K J, plus the positive parts of the cells' tensions and shear stress."""
        number = self.numbers(r) - self.numbers(self.rest)
        e, zero = np.eye(5), self.membrane(np.zeros_like(number))
        single = [self.membrane(e[a] + 0 * number) - zero for a in range(5)]
        K = np.moveaxis(
            [
                [self.membrane(e[a] + e[b] + 0 * number) - zero - single[a] - single[b] for b in range(5)]
                for a in range(5)
            ],
            (0, 1), (-2, -1),
        )  # fmt: skip
        stress = np.einsum("...ab,...b->...a", K, number)
        complex_steps = [r + 1e-30j * p.reshape(r.shape) for p in np.eye(r.size)]
        J = np.array([self.numbers(z).imag for z in complex_steps]) * 1e30
        H = np.asarray(np.einsum("pija,ijab,qijb->pq", J, K, J))
        H += self._positive_stresses(stress)
        bends = [self.bends(z) for z in complex_steps]
        B, C = (np.array([b[k].imag for b in bends]) * 1e30 for k in (0, 1))
        H += np.einsum("pija,ijab,qijb->pq", B, self.bending + np.zeros((*B.shape[1:], 2)), B)
        H += np.einsum("pij,ij,qij->pq", C, self.twist + np.zeros(C.shape[1:]), C)
        M = np.array([corner_numbers(b, c) for b, c in zip(B, C, strict=True)])
        H = np.asarray(H + np.einsum("pijca,ijcab,qijcb->pq", M, self.corners + np.zeros((*M.shape[1:], 3)), M))
        for strip, nodes in self.strips:
            unknowns = (3 * nodes[..., None] + np.arange(3)).ravel()
            H[np.ix_(unknowns, unknowns)] += strip.projected_hessian(r.reshape(-1, 3)[nodes])
        return H

    def _positive_stresses(self, stress: Array) -> Array:
        """Tension of each pair of edges (their mean) on both; shear S as (S/4)|dm1 + dm2|^2 or (|S|/4)|dm1 - dm2|^2."""
        tension_u, tension_v = stress[..., 0] + stress[..., 1], stress[..., 2] + stress[..., 3]
        H = np.zeros((self.rest.size, self.rest.size))
        index = np.arange(self.rest.size).reshape(self.rest.shape)
        for i, j in np.ndindex(stress.shape[:2]):
            ii, jj = (i + 1) % index.shape[0], (j + 1) % index.shape[1]
            corners = index[[i, ii, i, ii], [j, j, jj, jj]]  # r00, r10, r01, r11
            edge = np.array([[-1, 1, 0, 0], [0, 0, -1, 1], [-1, 0, 1, 0], [0, -1, 0, 1]])
            m1, m2 = (edge[0] + edge[1]) / 2, (edge[2] + edge[3]) / 2
            S = 2 * stress[i, j, 4]
            form = max(tension_u[i, j], 0) * edge[:2].T @ edge[:2] + max(tension_v[i, j], 0) * edge[2:].T @ edge[2:]
            form = form + abs(S) / 4 * np.outer(m1 + np.sign(S) * m2, m1 + np.sign(S) * m2)
            for k in range(3):
                H[np.ix_(corners[:, k], corners[:, k])] += form
        return H


def koiter_membrane(r: Array, weights: SurfaceCoefficients) -> Callable[[Array], Array]:
    """The membrane energy of the cells of closed rest positions, from the change of their five numbers."""
    n1, n2 = mean_edges(r)
    g11, g12, g22 = dot(n1, n1), dot(n1, n2), dot(n2, n2)
    area = np.sqrt(g11 * g22 - g12**2)
    lengths = membrane_numbers(r)[..., :4]
    inverse = np.linalg.inv(frame(g11, g12, area))

    def membrane(change: Array) -> Array:
        a0, a1, b0, b1 = np.moveaxis(change[..., :4] / lengths / 2, -1, 0)
        l0, l1, k0, k1 = np.moveaxis(np.sqrt(lengths), -1, 0)
        am, bm, ad, bd = (l0 * a0 + l1 * a1) / (l0 + l1), (k0 * b0 + k1 * b1) / (k0 + k1), (a1 - a0) / 2, (b1 - b0) / 2
        c = change[..., 4] / 2
        covariant = np.stack([g11 * am, c, c, g22 * bm], -1).reshape(*c.shape, 2, 2)
        E = np.einsum("...ai,...ij,...bj->...ab", inverse, covariant, inverse)
        voigt = np.stack([E[..., 0, 0], E[..., 1, 1], 2 * E[..., 0, 1]], -1)
        modes = (weights.membrane_modes[0] * ad**2 + weights.membrane_modes[1] * bd**2) / 6
        return np.asarray(area * (np.einsum("...a,...ab,...b->...", voigt, weights.membrane, voigt) / 2 + modes))

    return membrane


def frame(g11: Array, g12: Array, area: Array) -> Array:
    """Mean edges in the orthonormal frame that begins with m1: m_i = F_ia e_a."""
    return np.stack([np.sqrt(g11), 0 * g11, g12 / np.sqrt(g11), area / np.sqrt(g11)], -1).reshape(*g11.shape, 2, 2)


def design_energy(shape: RestShape, material: Material) -> DiscreteEnergy:
    """Design 1.3 for a material, orthogonal and skewed charts alike."""
    rest, weights, closing = shape.positions, material.surface(shape.grid), Closing(shape.periodic, shape.poles)
    at_nodes = material.surface(shape.grid, at="nodes")
    strips = pole_strips(shape, material)
    if isinstance(weights, PaperWeights):
        return _paper_energy(shape, weights, at_nodes, closing, strips)
    around = closed(rest, closing.periodic)
    n1, n2 = mean_edges(around)
    g11, g12, g22 = dot(n1, n1), dot(n1, n2), dot(n2, n2)
    area = np.sqrt(g11 * g22 - g12**2)
    membrane, none = koiter_membrane(around, weights), np.zeros((2, 2))
    if not weights.bending.any():
        return DiscreteEnergy(rest, membrane, none, np.zeros(()), closing=closing, strips=strips)
    quarters = corner_areas(shape, area)
    in_poles, share = pole_areas(shape), np.zeros(shape.nodes)
    D, G = at_nodes.bending + np.zeros((*shape.nodes, 3, 3)), np.stack(steps_squared(rest, closing), -1)
    products = G[..., :, None] * G[..., None, :]
    # Around a pole (k11 - k22)^2 stands for what 4 k12^2 would be in it on average.
    stands = D[..., :2, :2] + D[..., 2, 2, None, None] * np.array([[1, -1], [-1, 1]])
    if np.abs(g12).max() > 1e-9 * g11.max():
        F = frame(g11, g12, area)
        laws = np.stack([D[at_corner(area.shape, shape.nodes, corner)] for corner in CORNERS], axis=2)
        corners = _corner_weights(F, quarters, laws, existing(shape.nodes, closing))
        nodes = in_poles[..., None, None] * stands / products
        return DiscreteEnergy(rest, membrane, nodes, np.zeros(()), corners, closing, strips)
    for corner, quarter in zip(CORNERS, np.moveaxis(quarters, -1, 0), strict=True):
        share[at_corner(area.shape, shape.nodes, corner)] += quarter
    nodes = np.zeros((*shape.nodes, 2, 2))
    alone = 1 / np.diagonal(np.linalg.inv(D[..., :2, :2]), axis1=-2, axis2=-1)
    along_u, along_v = between(shape.nodes, closing)
    nodes[along_u & along_v] = D[along_u & along_v][:, :2, :2]
    for entry, lone in ((0, along_u & ~along_v), (1, ~along_u & along_v)):
        nodes[lone, entry, entry] = alone[lone, entry]
    nodes = (share[..., None, None] * nodes + in_poles[..., None, None] * stands) / products
    # D (1 - nu) B12^2 is 2 D33 B12^2, where D33 belongs to the doubled k12.
    twist = 4 * weights.bending[..., 2, 2] * area / (g11 * g22)
    return DiscreteEnergy(rest, membrane, nodes, twist, closing=closing, strips=strips)


def steps_squared(rest: Array, closing: Closing) -> list[Array]:
    """What second differences divide by: squared tangents, (a^2 + b^2)/2 for steps a and b across a pole."""
    found = []
    for axis, t in enumerate(tangents(rest, closing)):
        back, on = (np.linalg.norm(end - rest, axis=-1) for end in neighbours(rest, axis, closing))
        uneven, at_pole = 2 * (back**2 + on**2) / (back + on) ** 2, np.zeros(rest.shape[:2], dtype=bool)
        for ring in closing.rings:
            at_pole[ring] = not closing.periodic[axis]
        found.append(dot(t, t) * np.where(at_pole, uneven, 1))
    return found


def corner_areas(shape: RestShape, area: Array) -> Array:
    """What the corners of the cells get of their areas, shape (*cells, 4): quarters, uneven where cells narrow."""
    quarters = np.repeat(area[..., None], 4, axis=-1) / 4
    if any(shape.poles):
        along = shape.periodic.index(False)
        edges = np.linalg.norm(np.diff(closed(shape.positions, shape.periodic), axis=1 - along), axis=-1)
        edges = np.moveaxis(edges, along, 0)
        narrowing = np.moveaxis((edges[1:] - edges[:-1]) / (edges[1:] + edges[:-1]), 0, along)
        sides = np.array([1 if corner[along] else -1 for corner in CORNERS])
        quarters *= 1 + narrowing[..., None] / 2 * sides
    return quarters


def strips_of(shape: RestShape) -> list[Array]:
    """Indices of the four nodes of each strip across a pole, shape (2, 2): along the ring, then across."""
    numbers, found = np.arange(np.prod(shape.nodes)).reshape(shape.nodes), []
    for ring in Closing(shape.periodic, shape.poles).rings:
        nodes = numbers[ring]
        half = len(nodes) // 2
        for k in range(half):
            found.append(np.array([[nodes[k], nodes[(k + 1 + half) % (2 * half)]], [nodes[k + 1], nodes[k + half]]]))
    return found


def pole_areas(shape: RestShape) -> Array:
    """Shares of the areas in the poles, shape (nu, nv): an eighth of each strip, of which half counts, to a corner."""
    shares, points = np.zeros(np.prod(shape.nodes)), shape.positions.reshape(-1, 3)
    for nodes in strips_of(shape):
        m1, m2 = (m[0, 0] for m in mean_edges(points[nodes]))
        shares[nodes.ravel()] += np.linalg.norm(np.cross(m1, m2)) / 8
    return shares.reshape(shape.nodes)


def pole_strips(shape: RestShape, material: Material) -> list[tuple[DiscreteEnergy, Array]]:
    """The membrane in the poles."""
    found: list[tuple[DiscreteEnergy, Array]] = []
    if not any(shape.poles):
        return found
    around, at_nodes = 0 if shape.periodic[0] else 1, material.surface(shape.grid, at="nodes")
    for nodes in strips_of(shape):
        quad = shape.positions.reshape(-1, 3)[nodes]
        weights = at_nodes.mapped(lambda v, nodes=nodes: v.reshape(-1, *v.shape[2:])[nodes.ravel()].mean(axis=0))
        if around == 1:
            quad, nodes = quad.swapaxes(0, 1), nodes.T
        if isinstance(weights, PaperWeights):
            membrane = paper_membrane(shape.spacing, weights)
        else:
            membrane = halved(koiter_membrane(quad, weights))
        found.append((DiscreteEnergy(quad, membrane, np.zeros((2, 2)), np.zeros(())), nodes))
    return found


def halved(membrane: Callable[[Array], Array]) -> Callable[[Array], Array]:
    return lambda change: membrane(change) / 2


def _corner_weights(F: Array, quarters: Array, laws: Array, exists: Array) -> Array:
    """Skewed charts: each corner's area times C of its node, with the entries that it lacks condensed out."""
    units = np.array([[[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 1], [1, 0]]])
    inverse = np.linalg.inv(F)
    k = np.einsum("...ai,nij,...bj->...nab", inverse, units, inverse)
    voigt = np.stack([k[..., 0, 0], k[..., 1, 1], 2 * k[..., 0, 1]], -1)
    C = np.einsum("...na,...kab,...mb->...knm", voigt, laws, voigt)
    weights = np.zeros((*exists.shape, 3))
    for i, j, corner in np.ndindex(exists.shape[:3]):
        kept, lost = np.flatnonzero(exists[i, j, corner]), np.flatnonzero(~exists[i, j, corner])
        full = quarters[i, j, corner] * C[i, j, corner]
        across = full[np.ix_(kept, lost)]
        rest = full[np.ix_(kept, kept)] - across @ np.linalg.pinv(full[np.ix_(lost, lost)]) @ across.T
        weights[i, j, corner][np.ix_(kept, kept)] = rest
    return weights


def paper_membrane(spacing: tuple[float, ...], weights: PaperWeights) -> Callable[[Array], Array]:
    """The paper's sum of eta_ij/4 (G - G0)^2, G11 and G22 on edges, integrated over a cell of the parameters."""
    (h1, h2), eta = spacing, weights.eta

    def membrane(change: Array) -> Array:
        on_edges = (
            eta[0] * np.sum(change[..., :2] ** 2, -1) / h1**4 + eta[1] * np.sum(change[..., 2:4] ** 2, -1) / h2**4
        )
        return np.asarray(h1 * h2 / 4 * (on_edges / 2 + 2 * eta[2] * (change[..., 4] / (h1 * h2)) ** 2))

    return membrane


def _paper_energy(
    shape: RestShape,
    weights: PaperWeights,
    at_nodes: PaperWeights,
    closing: Closing,
    strips: list[tuple[DiscreteEnergy, Array]],
) -> DiscreteEnergy:
    """The paper's energy with its sum of xi_ij/2 (B - B0)^2, B11 and B22 at nodes; a pole is half a step deep."""
    (h1, h2), xi = shape.spacing, [x + np.zeros(shape.nodes) for x in at_nodes.xi]
    halves = [np.where(has, 1.0, 0.5) for has in between(shape.nodes, closing)]
    share = h1 * h2 * halves[0] * halves[1]
    bending = share[..., None, None] * (np.stack([xi[0] / h1**4, xi[1] / h2**4], -1)[..., None] * np.eye(2))
    membrane, twist = paper_membrane(shape.spacing, weights), np.array(2 * weights.xi[2] / (h1 * h2))
    return DiscreteEnergy(shape.positions, membrane, bending, twist, closing=closing, strips=strips)
