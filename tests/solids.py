"""Solids for tests: shapes, materials, deformed states, and the discrete energy of design 1.3 written in NumPy.

The oracle knows nothing of the kernels: no springs, no K, no fluxes. Its energy is the formula of the design, cell by
cell from edges and faces; derivatives of it are taken by complex steps, which are exact to round-off.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import spsolve
from surface_energy import dot
from surfaces import noise, spacing, turned

from warpdeform.coefficients import PaperSolidWeights
from warpdeform.forces.solid_coefficients import SolidStiffness
from warpdeform.forces.solid_elasticity import SolidElasticity
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.material import Material

Array = NDArray[Any]
Nodes = tuple[int, int, int]

GRIDS = [(2, 2, 2), (2, 3, 5), (4, 2, 3), (5, 6, 17), (3, 4, 16)]
AXES = (0, 1, 2)
PAIRS = ((0, 1), (0, 2), (1, 2))
OFFSETS = tuple(product((0, 1), repeat=2))

MATERIALS = {
    "soft": Material(density=1000.0, youngs_modulus=1e5, poisson_ratio=0.3),
    "rubber": Material(density=1000.0, youngs_modulus=1e5, poisson_ratio=0.49),
    "paper": Material(density=1000.0, eta=(5e4, 3e4, 4e4, 2e4, 1e4, 3e4)),
    "barrier": Material(density=1000.0, youngs_modulus=1e5, poisson_ratio=0.3, inversion_barrier=2e4),
}


@dataclass(frozen=True)
class Block:
    """A rest shape.

    Attributes:
        positions: Rest positions [m], shape (nu, nv, nw, 3).
        spacing: Parameter spacings.
    """

    positions: Array
    spacing: tuple[float, float, float]

    @property
    def nodes(self) -> Nodes:
        return self.positions.shape[0], self.positions.shape[1], self.positions.shape[2]

    @property
    def grid(self) -> ParameterGrid:
        return ParameterGrid(self.nodes, self.spacing)


def solid_map(function: Callable[..., Array], nodes: Nodes, extent: tuple[tuple[float, float], ...]) -> Block:
    """An analytic map of the parameters, sampled at the nodes."""
    along = [np.linspace(low, high, n) for (low, high), n in zip(extent, nodes, strict=True)]
    spacing = [(high - low) / (n - 1) for (low, high), n in zip(extent, nodes, strict=True)]
    u, v, w = np.meshgrid(*along, indexing="ij")
    return Block(np.asarray(function(u, v, w)), (spacing[0], spacing[1], spacing[2]))


def box(nodes: Nodes, size: tuple[float, float, float] = (1.0, 0.7, 0.9)) -> Block:
    return solid_map(lambda *a: np.stack(a, -1), nodes, tuple((0.0, s) for s in size))


def graded(nodes: Nodes) -> Block:
    """Boxes of different sizes."""
    return solid_map(lambda u, v, w: np.stack([u + 0.3 * u**2, v - 0.2 * v**2, w**1.3], -1), nodes, ((0.0, 1.0),) * 3)


def leaning(nodes: Nodes) -> Block:
    """A parallelepiped without a right angle."""
    lean = np.array([[1.0, 0.0, 0.0], [0.4, 0.8, 0.0], [-0.3, 0.5, 0.9]])
    return Block(box(nodes).positions @ lean, box(nodes).spacing)


def thick_cylinder(nodes: Nodes) -> Block:
    """A sector of it: rho, theta, z, as in the worked examples."""
    return solid_map(
        lambda rho, theta, z: np.stack([rho * np.cos(theta), rho * np.sin(theta), z], -1),
        nodes, ((0.5, 0.9), (0.2, 1.0), (0.0, 0.6)),
    )  # fmt: skip


def bent(nodes: Nodes) -> Block:
    """A block without a straight line in it, left-handed."""

    def wavy(u: Array, v: Array, w: Array) -> Array:
        return np.stack([v + 0.1 * np.sin(2 * w), u + 0.15 * v * w, w + 0.1 * np.sin(3 * u) * np.cos(2 * v)], -1)

    return solid_map(wavy, nodes, ((0.0, 1.0), (0.0, 0.7), (0.0, 0.9)))


SHAPES: dict[str, Callable[[Nodes], Block]] = {
    "box": box,
    "graded": graded,
    "leaning": leaning,
    "cylinder": thick_cylinder,
    "bent": bent,
}
CASES = [(shape, "soft") for shape in SHAPES] + [("box", "paper"), ("bent", "paper"), ("bent", "rubber")]


def crumpled(rest: Array) -> Array:
    """Every node displaced by a fifth of the spacing."""
    return rest + noise(rest, 0.2)


def stretched(rest: Array) -> Array:
    """Longer by 40 % one way, shorter by 20 % another, sheared, turned, and not quite even."""
    F = np.array([[1.4, 0.25, 0.0], [0.1, 0.8, 0.2], [0.2, 0.0, 1.1]])
    return turned(rest @ F.T, (1, 2, 3), 0.7) + noise(rest, 0.03)


def squashed(rest: Array) -> Array:
    """Pressed together, more on one side than on the other."""
    r = rest - rest.mean((0, 1, 2))
    return r * [0.7, 0.8, 0.6] + 0.3 * r[..., :1] * r * [0.0, 1.0, 1.0] + noise(rest, 0.05)


STATES: dict[str, Callable[[Array], Array]] = {"crumpled": crumpled, "stretched": stretched, "squashed": squashed}


class Term:
    """A term of one solid, with NumPy arrays of shape (nu, nv, nw, ...) going in and coming out."""

    def __init__(
        self,
        rest: Block,
        material: Material,
        real: Any = wp.float64,
        lane_width: int = 1,
        kind: Any = SolidElasticity,
        **options: Any,
    ) -> None:
        self.real, self.nodes, self.rest = real, rest.nodes, rest.positions
        self.layout = Layout(rest.nodes, lane_width)
        self.force: Any = kind(rest.grid, self.layout, rest.positions, material, real, "cpu", **options)

    @property
    def stiffness(self) -> SolidStiffness:
        return self.force.stiffness

    def upload(self, values: Array) -> wp.array:
        return wp.array(self.layout.pack(values), dtype=self.real, device="cpu")

    def download(self, array: wp.array) -> Array:
        return self.layout.unpack(array.numpy())

    def energy(self, z: Array) -> float:
        partials = wp.zeros((self.layout.rows, self.layout.columns), dtype=wp.float64, device="cpu")
        self.force.add_energy(None, self.upload(z), partials)
        return float(partials.numpy().sum())

    def linearise(self, z: Array) -> None:
        self.position = self.upload(z)
        self.force.linearise(None, self.position)

    def gradient(self, z: Array) -> Array:
        self.linearise(z)
        out = self.upload(np.zeros_like(z))
        self.force.add_gradient(None, self.position, out)
        return self.download(out)

    def product(self, p: Array) -> Array:
        """Hessian at the last linearised state times p."""
        out = self.upload(np.zeros_like(p))
        self.force.add_hessian_product(None, self.upload(p), out)
        return self.download(out)

    def blocks(self) -> Array:
        """Diagonal blocks at the last linearised state, shape (nu, nv, nw, 3, 3)."""
        out = self.upload(np.zeros((*self.nodes, 6)))
        self.force.add_block_diagonal(None, out)
        return self.download(out)[..., [0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(*self.nodes, 3, 3)

    def dense(self) -> Array:
        """The Hessian at the last linearised state, shape (3 n, 3 n)."""
        size = 3 * int(np.prod(self.nodes))
        return np.array([self.product(p.reshape(*self.nodes, 3)).ravel() for p in np.eye(size)]).T


def around(samples: Array, axis: int) -> Array:
    """The four edges along an axis of each cell, shape (*cells, 2, 2, ...)."""
    others = [k for k in AXES if k != axis]
    cells = [n - (k != axis) for k, n in enumerate(samples.shape[:3])]
    found = []
    for offsets in OFFSETS:
        start = [0, 0, 0]
        for k, at in zip(others, offsets, strict=True):
            start[k] = at
        found.append(samples[tuple(slice(a, a + n) for a, n in zip(start, cells, strict=True))])
    stacked = np.stack(found, axis=3)
    return stacked.reshape(*cells, 2, 2, *samples.shape[3:])


def on_faces(edges: Array, axis: int, other: int) -> Array:
    """Mean edges along an axis of the faces that it spans with another one."""
    low = np.take(edges, range(edges.shape[other] - 1), axis=other)
    high = np.take(edges, range(1, edges.shape[other]), axis=other)
    return (low + high) / 2


def edge_squares(r: Array) -> list[Array]:
    """Squared lengths of the edges along each axis."""
    return [dot(e, e) for e in (np.diff(r, axis=axis) for axis in AXES)]


def face_products(r: Array) -> list[Array]:
    """m_i.m_j of the faces of each orientation."""
    edges = [np.diff(r, axis=axis) for axis in AXES]
    return [dot(on_faces(edges[i], i, j), on_faces(edges[j], j, i)) for i, j in PAIRS]


def two_faces(samples: Array, i: int, j: int) -> Array:
    """Both faces of an orientation of each cell, shape (*cells, 2)."""
    k = 3 - i - j
    n = samples.shape[k]
    return np.stack([np.take(samples, range(n - 1), axis=k), np.take(samples, range(1, n), axis=k)], axis=-1)


def cell_numbers(r: Array) -> Array:
    """Per cell twelve squared lengths of edges and six m_i.m_j of faces, shape (*cells, 18)."""
    edges = [around(s, axis).reshape(*(n - 1 for n in r.shape[:3]), 4) for axis, s in enumerate(edge_squares(r))]
    faces = [two_faces(c, i, j) for (i, j), c in zip(PAIRS, face_products(r), strict=True)]
    return np.concatenate([*edges, *faces], axis=-1)


def mean_edges(r: Array) -> Array:
    """m_i of the cells, shape (*cells, 3 axes, 3)."""
    return np.stack([around(np.diff(r, axis=axis), axis).mean(axis=(3, 4)) for axis in AXES], axis=-2)


Law = Callable[[Array], Array]
"""Energy of each cell from the change of its eighteen numbers since rest."""


def hooke(rest: Array, youngs_modulus: float, nu: float) -> Law:
    """Design 1.3, right angles and skewed charts alike."""
    m = mean_edges(rest)
    G = np.einsum("...ia,...ja->...ij", m, m)
    inverse, volume = np.linalg.inv(G), np.abs(np.linalg.det(m))
    squares, mu = cell_numbers(rest)[..., :12], youngs_modulus / (2 * (1 + nu))

    def law(change: Array) -> Array:
        a = (change[..., :12] / squares / 2).reshape(*change.shape[:-1], 3, 2, 2)
        shears = change[..., 12:].reshape(*change.shape[:-1], 3, 2) / 2
        E = np.zeros((*change.shape[:-1], 3, 3), dtype=change.dtype)
        slopes = np.zeros((*change.shape[:-1], 3, 3, 3), dtype=change.dtype)  # of E, along each axis
        density = np.zeros(change.shape[:-1], dtype=change.dtype)
        for axis in AXES:
            b, c = (k for k in AXES if k != axis)
            own, square = a[..., axis, :, :], G[..., axis, axis]
            E[..., axis, axis] = square * own.mean(axis=(-2, -1))
            slopes[..., b, axis, axis] = square * (own[..., 1, :] - own[..., 0, :]).sum(axis=-1) / 4
            slopes[..., c, axis, axis] = square * (own[..., :, 1] - own[..., :, 0]).sum(axis=-1) / 4
            cross = (own[..., 1, 1] - own[..., 0, 1] - own[..., 1, 0] + own[..., 0, 0]) / 4
            density += youngs_modulus / 2 * cross**2 / 9
        for n, (i, j) in enumerate(PAIRS):
            k = 3 - i - j
            E[..., i, j] = E[..., j, i] = shears[..., n, :].mean(axis=-1)
            slopes[..., k, i, j] = slopes[..., k, j, i] = (shears[..., n, 1] - shears[..., n, 0]) / 2
            plane = np.linalg.inv(G[..., [[i], [j]], [i, j]])
            density += quadratic(plane, slopes[..., k, :, :][..., [[i], [j]], [i, j]], 2 * mu * nu / (1 - nu)) / 3
        return np.asarray(volume * (density + quadratic(inverse, E, 2 * mu * nu / (1 - 2 * nu))))

    def quadratic(inverse: Array, E: Array, lame: float) -> Array:
        mixed = np.einsum("...ik,...kj->...ij", inverse, E)
        trace = np.einsum("...ii->...", mixed)
        return np.asarray(lame / 2 * trace**2 + mu * np.einsum("...ij,...ji->...", mixed, mixed))

    return law


def paper_law(spacing: tuple[float, ...], weights: PaperSolidWeights) -> Law:
    """The paper's sum of eta_ij/4 (G_ij - G0_ij)^2, G_ii on edges, G_ij on faces."""
    h = np.array(spacing)

    def law(change: Array) -> Array:
        total = np.zeros(change.shape[:-1], dtype=change.dtype)
        for axis in AXES:
            G = change[..., 4 * axis : 4 * axis + 4] / h[axis] ** 2
            total += weights.eta[axis] / 4 * np.mean(G**2, axis=-1)
        for n, (i, j) in enumerate(PAIRS):
            G = change[..., 12 + 2 * n : 14 + 2 * n] / (h[i] * h[j])
            total += 2 * weights.eta[3 + n] / 4 * np.mean(G**2, axis=-1)
        return np.asarray(np.prod(h) * total)

    return law


@dataclass
class DiscreteEnergy:
    """An energy of the cells' numbers.

    Attributes:
        rest: Rest positions, shape (*nodes, 3).
        law: Energy of each cell, quadratic.
    """

    rest: Array
    law: Law

    def energy(self, r: Array) -> Any:
        return self.law(cell_numbers(r) - cell_numbers(self.rest)).sum()

    def slope(self, r: Array, p: Array) -> float:
        """Derivative of the energy at r along p, by a complex step."""
        return float(self.energy(r + 1e-30j * p).imag * 1e30)

    def gradient(self, r: Array) -> Array:
        return np.array([self.slope(r, p.reshape(r.shape)) for p in np.eye(r.size)]).reshape(r.shape)

    def projected_hessian(self, r: Array) -> Array:
        """Design 2.1, dense: J' K J, plus what of the stresses of edges and face diagonals is tension."""
        number = cell_numbers(r) - cell_numbers(self.rest)
        e, zero = np.eye(18), self.law(0 * number)
        single = [self.law(e[a] + 0 * number) - zero for a in range(18)]
        pairs = [
            [self.law(e[a] + e[b] + 0 * number) - single[a] - single[b] - zero for b in range(18)] for a in range(18)
        ]
        K = np.moveaxis(np.array(pairs), (0, 1), (-2, -1))
        J = np.array([cell_numbers(r + 1e-30j * p.reshape(r.shape)).imag for p in np.eye(r.size)]) * 1e30
        H = np.einsum("pijka,ijkab,qijkb->pq", J, K, J, optimize=True)
        return np.asarray(H + self._tensions(np.einsum("...ab,...b->...a", K, number)))

    def _tensions(self, stress: Array) -> Array:
        """Means over a cell: tension of its edges; a face stress S of m_i.m_j is (S/4)(|D|^2 - |E|^2)."""
        index = np.arange(self.rest[..., 0].size).reshape(self.rest.shape[:3])
        form = np.zeros((index.size, index.size))

        def add(low: Array, high: Array, weight: Array) -> None:
            for a, b, w in zip(low.ravel(), high.ravel(), weight.ravel(), strict=True):
                form[[a, b], [a, b]] += w
                form[[a, b], [b, a]] -= w

        corner = {
            at: index[tuple(slice(a, n - 1 + a) for a, n in zip(at, index.shape, strict=True))]
            for at in product((0, 1), repeat=3)
        }
        for axis in AXES:
            tension = np.maximum(2 * stress[..., 4 * axis : 4 * axis + 4].mean(axis=-1), 0)
            for at in corner:
                if at[axis] == 0:
                    add(corner[at], corner[tuple(a + (k == axis) for k, a in enumerate(at))], tension)
        for n, (i, j) in enumerate(PAIRS):
            S = stress[..., 12 + 2 * n : 14 + 2 * n].mean(axis=-1)
            for level in (0, 1):
                ends = [[level] * 3 for _ in range(4)]
                for end, (a, b) in zip(ends, ((0, 0), (1, 1), (1, 0), (0, 1)), strict=True):
                    end[i], end[j] = a, b
                r00, r11, r10, r01 = (corner[(end[0], end[1], end[2])] for end in ends)
                add(r00, r11, np.maximum(S, 0) / 2)
                add(r10, r01, np.maximum(-S, 0) / 2)
        return np.kron(form, np.eye(3))


def design_energy(shape: Block, material: Material) -> DiscreteEnergy:
    """Design 1.3 for a material."""
    weights = material.solid()
    if isinstance(weights, PaperSolidWeights):
        return DiscreteEnergy(shape.positions, paper_law(shape.spacing, weights))
    return DiscreteEnergy(shape.positions, hooke(shape.positions, weights.youngs_modulus, weights.poisson_ratio))


def volume_ratio(r: Array, rest: Array) -> Array:
    """Signed volumes of the cells over those at rest."""
    return np.asarray(np.linalg.det(mean_edges(r)) / np.linalg.det(mean_edges(rest)))


@dataclass
class BarrierEnergy:
    """kappa V (1 - J)^3/J of cells with J < 1.

    Attributes:
        rest: Rest positions, shape (*nodes, 3).
        strength: kappa.
    """

    rest: Array
    strength: float

    @property
    def weights(self) -> Array:
        return np.asarray(self.strength * np.abs(np.linalg.det(mean_edges(self.rest))))

    def energy(self, r: Array) -> Any:
        J = volume_ratio(r, self.rest)
        return np.sum(self.weights * np.where(J.real < 1, (1 - J) ** 3 / J, 0))

    def gradient(self, r: Array) -> Array:
        slopes = [self.energy(r + 1e-30j * p.reshape(r.shape)).imag * 1e30 for p in np.eye(r.size)]
        return np.array(slopes).reshape(r.shape)

    def projected_hessian(self, r: Array) -> Array:
        """The Gauss-Newton part."""
        J = volume_ratio(r, self.rest)
        G = np.array([volume_ratio(r + 1e-30j * p.reshape(r.shape), self.rest).imag for p in np.eye(r.size)]) * 1e30
        return np.asarray(np.einsum("pijk,ijk,qijk->pq", G, self.weights * np.where(J < 1, 2 / J**3 - 2, 0), G))


def stiffness_matrix(term: Term) -> csc_array:
    """The Hessian at the last linearised state, sparse: 81 products, each with every third node moved."""
    nodes, index = term.nodes, np.arange(int(np.prod(term.nodes))).reshape(term.nodes)
    rows, columns, entries = [], [], []
    for start in product(range(3), repeat=3):
        # The one node of this colour that is next to each node.
        near = [(np.arange(n) - first + 1) // 3 * 3 + first for n, first in zip(nodes, start, strict=True)]
        inside = np.meshgrid(*((at >= 0) & (at < n) for at, n in zip(near, nodes, strict=True)), indexing="ij")
        exists = np.logical_and.reduce(inside)
        moved = index[np.ix_(*(np.clip(at, 0, n - 1) for at, n in zip(near, nodes, strict=True)))]
        colour = tuple(slice(first, None, 3) for first in start)
        for axis in AXES:
            p = np.zeros((*nodes, 3))
            p[(*colour, axis)] = 1.0
            q = term.product(p)[exists]
            rows.append((3 * index[exists][:, None] + np.arange(3)).ravel())
            columns.append(np.repeat(3 * moved[exists] + axis, 3))
            entries.append(q.ravel())
    where = np.concatenate(rows), np.concatenate(columns)
    return csc_array((np.concatenate(entries), where), shape=(3 * index.size,) * 2)


def equilibrium(term: Term, load: Array, free: Array, start: Array) -> Array:
    """Where the forces of the term balance a load on the free coordinates: Newton with a line search.

    Args:
        term: The term.
        load: Forces [N], shape (*nodes, 3).
        free: Which coordinates may move, shape (*nodes, 3).
        start: Where to start [m], shape (*nodes, 3).
    """
    z, inside, step = start.copy(), np.flatnonzero(free), np.zeros(start.size)
    for _ in range(200):
        residual = (term.gradient(z) - load).ravel()[inside]
        step[inside] = -spsolve(stiffness_matrix(term)[inside][:, inside].tocsc(), residual)
        p, slope = step.reshape(z.shape), float(residual @ step[inside])
        if np.abs(p).max() < 1e-5 * spacing(start):
            return z + p
        now, length = term.energy(z) - np.sum(load * z), 1.0
        while term.energy(z + length * p) - np.sum(load * (z + length * p)) > now + 1e-4 * length * slope:
            length /= 2
        z = z + length * p
    raise AssertionError(f"still moving by {np.abs(p).max() / spacing(start):g} spacings an iteration")
