"""Surfaces for tests: shapes, materials, deformed states, and the discrete energy of design 1.3 written in NumPy.

The oracle knows nothing of the kernels: no diagonals, no K, no fluxes. Its energy is the formula of the design, one
sample at a time; derivatives of it are taken by complex steps, which are exact to round-off.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.surface_elasticity import SurfaceElasticity
from warpdeform.grid import Layout
from warpdeform.material import Material, PaperWeights
from warpdeform.shape import RestShape, arc, from_map, sheet, torus, tube

Array = NDArray[Any]

WIDTHS = {wp.float64: (1, 8), wp.float32: (1, 16)}
"""Lane widths of each precision: CUDA's and the CPU's."""
REALS = [wp.float64, wp.float32]
GRIDS = [(2, 2), (2, 5), (3, 3), (17, 33), (16, 16), (5, 40)]

# Bending is far too stiff for cloth, so that an error in it cannot hide behind the membrane.
MATERIALS = {
    "membrane": Material(areal_density=0.2, membrane_stiffness=1000.0, poisson_ratio=0.3),
    "isotropic": Material(density=1000.0, youngs_modulus=1e6, poisson_ratio=0.3, thickness=0.2),
    "orthotropic": Material(
        density=800.0, youngs_modulus=(1.5e6, 0.6e6), poisson_ratio=0.35, shear_modulus=0.3e6, thickness=0.2,
        bending_multipliers=(2.0, 0.5),
    ),
    "shell": Material(
        areal_density=0.2, membrane_stiffness=(900.0, 500.0), shear_stiffness=150.0, poisson_ratio=0.2,
        bending_stiffness=20.0,
    ),
    "paper": Material(areal_density=0.2, eta=(500.0, 300.0, 200.0), xi=(20.0, 10.0, 5.0)),
    "paper-membrane": Material(areal_density=0.2, eta=500.0),
}  # fmt: skip


def fan(nodes: tuple[int, int]) -> RestShape:
    """Part of a flat annulus: right angles, but opposite edges of different lengths."""
    return from_map(
        lambda u, v: np.stack([(0.5 + u) * np.cos(v), (0.5 + u) * np.sin(v), 0 * u], -1), nodes, ((0, 0.8), (0, 1.1))
    )


def bump(nodes: tuple[int, int]) -> RestShape:
    """A shallow hill, curved both ways, its axes a few degrees off a right angle."""
    return from_map(
        lambda u, v: np.stack([u, v, 0.12 * np.sin(2 * u + 0.5) * np.cos(2 * v)], -1), nodes, ((0, 1), (0, 0.7))
    )


def parallelogram(nodes: tuple[int, int], degrees: float = 45.0) -> RestShape:
    """A flat sheet whose v axis leans over by so many degrees."""
    lean = np.tan(np.radians(degrees))
    return from_map(lambda u, v: np.stack([u + lean * v, v, 0 * u], -1), nodes, ((0, 1), (0, 0.7)))


def transposed(rest: RestShape) -> RestShape:
    """The shape with its axes exchanged."""
    swap = slice(None, None, -1)
    return RestShape(rest.positions.transpose(1, 0, 2), rest.spacing[swap], rest.periodic[swap])


def screw(nodes: tuple[int, int]) -> RestShape:
    """A tube whose v axis winds around it: closed along u, skewed, so that b12 couples to b11 and b22."""
    return from_map(
        lambda u, v: np.stack([0.4 * np.cos(u + v), (0.3 + 0.1 * v) * np.sin(u + v), v], -1),
        nodes, ((0, 2 * np.pi), (0, 0.7)), (True, False),
    )  # fmt: skip


def knot(nodes: tuple[int, int]) -> RestShape:
    """A torus whose u axis winds around its tube: closed both ways and skewed."""

    def wound(u: Array, v: Array) -> Array:
        out = 0.8 + 0.2 * np.cos(u + v)
        return np.stack([out * np.cos(u), out * np.sin(u), 0.2 * np.sin(u + v)], -1)

    return from_map(wound, nodes, ((0, 2 * np.pi), (0, 2 * np.pi)), (True, True))


SHAPES: dict[str, Callable[[tuple[int, int]], RestShape]] = {
    "flat": lambda nodes: sheet(nodes, (1.0, 0.7)),
    "arc": lambda nodes: arc(nodes, radius=0.5, angle=100.0, length=0.7),
    "fan": fan,
    "bump": bump,
    "parallelogram": parallelogram,
}
CASES = [(shape, material) for shape in SHAPES for material in MATERIALS]
"""Every shape with every material; bump and parallelogram couple b12 to b11 and b22."""
CLOSED: dict[str, Callable[[tuple[int, int]], RestShape]] = {
    "tube": lambda nodes: tube(nodes, radius=0.3, length=0.7),
    "tube along u": lambda nodes: transposed(tube(nodes[::-1], radius=0.3, length=0.7)),
    "torus": lambda nodes: torus(nodes, radius=0.5, tube_radius=0.2),
    "screw": screw,
    "knot": knot,
}
"""Shapes with periodic axes."""
CLOSED_CASES = [
    *((shape, material) for shape in CLOSED for material in ("membrane", "isotropic")),
    ("tube", "orthotropic"), ("tube along u", "paper"), ("torus", "shell"), ("screw", "shell"), ("knot", "paper"),
]  # fmt: skip
"""Closed shapes with materials; screw and knot couple b12 to b11 and b22."""
CORNERS = ((0, 0), (1, 0), (0, 1), (1, 1))
"""Offsets (di, dj) of a cell's corners 00, 10, 01, 11."""


def spacing(rest: Array) -> float:
    """Mean length of the edges."""
    return float(np.mean([np.linalg.norm(np.diff(rest, axis=axis), axis=-1).mean() for axis in (0, 1)]))


def noise(rest: Array, size: float, seed: int = 1) -> Array:
    return np.random.default_rng(seed).normal(0.0, size * spacing(rest), rest.shape)


def turned(points: Array, axis: tuple[float, float, float], angle: float) -> Array:
    """Points rotated about an axis through the origin."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(points @ (np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K).T)


def crumpled(rest: Array) -> Array:
    """Every node displaced by a fifth of the spacing."""
    return rest + noise(rest, 0.2)


def stretched(rest: Array) -> Array:
    """Longer by 40 % one way, shorter by 20 % the other, sheared, turned, and not quite even."""
    F = np.array([[1.4, 0.25, 0.0], [0.1, 0.8, 0.0], [0.2, 0.0, 1.1]])
    return turned(rest @ F.T, (1, 2, 3), 0.7) + noise(rest, 0.03)


def folded(rest: Array) -> Array:
    """Folded by 150 degrees along a line across the sheet, and not quite even."""
    z = rest - rest.mean((0, 1))
    right = z[..., :1] + 0.3 * z[..., 1:2] > 0
    return np.where(right, turned(z, (-0.3, 1.0, 0.0), -np.radians(150.0)), z) + noise(rest, 0.05)


STATES: dict[str, Callable[[Array], Array]] = {"crumpled": crumpled, "stretched": stretched, "folded": folded}


class Surface:
    """The elastic term of one surface, with NumPy arrays of shape (nu, nv, ...) going in and coming out."""

    def __init__(self, rest: RestShape, material: Material, real: Any = wp.float64, lane_width: int = 1) -> None:
        self.real, self.nodes, self.rest = real, rest.nodes, rest.positions
        self.layout = Layout(rest.nodes, lane_width, rest.periodic, rest.poles)
        self.force = SurfaceElasticity(rest.grid, self.layout, rest.positions, material, real, "cpu")

    def upload(self, values: Array) -> wp.array:
        return wp.array(self.layout.pack(values), dtype=self.real, device="cpu")

    def download(self, array: wp.array) -> Array:
        return np.moveaxis(array.numpy()[:, 1:-1, self.layout.halo :][..., : self.nodes[1]], 0, -1).copy()

    def energy(self, z: Array) -> float:
        partials = wp.zeros((self.layout.rows, self.layout.columns), dtype=wp.float64, device="cpu")
        self.force.add_energy(None, self.upload(z), partials)
        return float(partials.numpy().sum())

    def linearise(self, z: Array) -> None:
        self._position = self.upload(z)
        self.force.linearise(None, self._position)

    def gradient(self, z: Array) -> Array:
        self.linearise(z)
        out = self.upload(np.zeros_like(z))
        self.force.add_gradient(None, self._position, out)
        return self.download(out)

    def product(self, p: Array) -> Array:
        """Hessian at the last linearised state times p."""
        out = self.upload(np.zeros_like(p))
        self.force.add_hessian_product(None, self.upload(p), out)
        return self.download(out)

    def blocks(self) -> Array:
        """Diagonal blocks at the last linearised state, shape (nu, nv, 3, 3)."""
        out = self.upload(np.zeros((*self.nodes, 6)))
        self.force.add_block_diagonal(None, out)
        return self.download(out)[..., [0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(*self.nodes, 3, 3)


def dot(a: Array, b: Array) -> Array:
    return np.asarray(np.sum(a * b, axis=-1))


def unit(a: Array) -> Array:
    return np.asarray(a / np.sqrt(dot(a, a))[..., None])


OPEN = (False, False)


def closed(r: Array, periodic: tuple[bool, ...]) -> Array:
    """Positions with the first ones again behind the last along periodic axes: every cell has its corners."""
    return np.pad(r, [(0, int(p)) for p in periodic] + [(0, 0)], mode="wrap")


def tangents(r: Array, periodic: tuple[bool, ...] = OPEN) -> list[Array]:
    """Undivided central differences at the nodes, one-sided at borders."""
    return [
        (np.roll(r, -1, axis=axis) - np.roll(r, 1, axis=axis)) / 2 if wraps else np.gradient(r, axis=axis)
        for axis, wraps in enumerate(periodic)
    ]


def between(nodes: tuple[int, int], periodic: tuple[bool, ...] = OPEN) -> list[Array]:
    """Whether the nodes have both neighbours, along u and along v, shape (nu, nv) each."""
    inside = [wraps | np.isin(np.arange(n), (0, n - 1), invert=True) for n, wraps in zip(nodes, periodic, strict=True)]
    return np.meshgrid(*inside, indexing="ij")


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


def bending_numbers(r: Array, periodic: tuple[bool, ...] = OPEN) -> tuple[Array, Array]:
    """Undivided B11, B22 at the nodes, zero where a neighbour is missing, and B12 at the cells."""
    n, inside = unit(np.cross(*tangents(r, periodic))), between(r.shape[:2], periodic)
    second = [np.roll(r, -1, axis=axis) - 2 * r + np.roll(r, 1, axis=axis) for axis in (0, 1)]
    b = np.stack([np.where(has, dot(n, s), 0.0) for has, s in zip(inside, second, strict=True)], axis=-1)
    c = closed(r, periodic)
    return b, dot(unit(np.cross(*mean_edges(c))), c[:-1, :-1] - c[1:, :-1] - c[:-1, 1:] + c[1:, 1:])


def corner_numbers(b: Array, b12: Array) -> Array:
    """(b11, b22, b12) as the corners 00, 10, 01, 11 of the cells see them, shape (*cells, 4, 3)."""
    at_corners = np.stack([b[at_corner(b12.shape, b.shape[:2], corner)] for corner in CORNERS], axis=2)
    return np.concatenate([at_corners, np.broadcast_to(b12[..., None, None], (*b12.shape, 4, 1))], axis=-1)


def existing(nodes: tuple[int, int], periodic: tuple[bool, ...] = OPEN) -> Array:
    """Whether the corners of the cells have b11, b22, b12, shape (*cells, 4, 3)."""
    cells = [n if wraps else n - 1 for n, wraps in zip(nodes, periodic, strict=True)]
    return corner_numbers(np.stack(between(nodes, periodic), axis=-1), np.ones(cells, dtype=bool))


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
        periodic: Axes that close.
    """

    rest: Array
    membrane: Callable[[Array], Array]
    bending: Array
    twist: Array
    corners: Array = field(default_factory=lambda: np.zeros((3, 3)))
    periodic: tuple[bool, ...] = OPEN

    def numbers(self, r: Array) -> Array:
        return membrane_numbers(closed(r, self.periodic))

    def bends(self, r: Array) -> tuple[Array, Array]:
        return bending_numbers(r, self.periodic)

    def energy(self, r: Array) -> Any:
        (b, c), (b0, c0) = self.bends(r), self.bends(self.rest)
        density = self.membrane(self.numbers(r) - self.numbers(self.rest)) + self.twist * (c - c0) ** 2 / 2
        mixed = corner_numbers(b - b0, c - c0)
        mixed = np.einsum("...a,...ab,...b->...", mixed, self.corners, mixed)
        return density.sum() + (np.einsum("...a,...ab,...b->...", b - b0, self.bending, b - b0).sum() + mixed.sum()) / 2

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
        return np.asarray(H + np.einsum("pijca,ijcab,qijcb->pq", M, self.corners + np.zeros((*M.shape[1:], 3)), M))

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


def design_energy(shape: RestShape, material: Material) -> DiscreteEnergy:
    """Design 1.3 for a material, orthogonal and skewed charts alike."""
    rest, weights, periodic = shape.positions, material.surface(), shape.periodic
    if isinstance(weights, PaperWeights):
        return _paper_energy(shape, weights)
    around = closed(rest, periodic)
    n1, n2 = mean_edges(around)
    g11, g12, g22 = dot(n1, n1), dot(n1, n2), dot(n2, n2)
    area = np.sqrt(g11 * g22 - g12**2)
    lengths = membrane_numbers(around)[..., :4]
    # Mean edges in the orthonormal frame that begins with m1: m_i = F_ia e_a.
    F = np.stack([np.sqrt(g11), 0 * g11, g12 / np.sqrt(g11), area / np.sqrt(g11)], -1).reshape(*g11.shape, 2, 2)
    inverse = np.linalg.inv(F)

    def membrane(change: Array) -> Array:
        a0, a1, b0, b1 = np.moveaxis(change[..., :4] / lengths / 2, -1, 0)
        am, bm, ad, bd, c = (a0 + a1) / 2, (b0 + b1) / 2, (a1 - a0) / 2, (b1 - b0) / 2, change[..., 4] / 2
        covariant = np.stack([g11 * am, c, c, g22 * bm], -1).reshape(*c.shape, 2, 2)
        E = np.einsum("...ai,...ij,...bj->...ab", inverse, covariant, inverse)
        voigt = np.stack([E[..., 0, 0], E[..., 1, 1], 2 * E[..., 0, 1]], -1)
        modes = (weights.membrane_modes[0] * ad**2 + weights.membrane_modes[1] * bd**2) / 6
        return np.asarray(area * (np.einsum("...a,ab,...b->...", voigt, weights.membrane, voigt) / 2 + modes))

    if not weights.bending.any():
        return DiscreteEnergy(rest, membrane, np.zeros((2, 2)), np.zeros(()), periodic=periodic)
    if np.abs(g12).max() > 1e-9 * g11.max():
        corners = _corner_weights(F, area, weights.bending, existing(shape.nodes, periodic))
        return DiscreteEnergy(rest, membrane, np.zeros((2, 2)), np.zeros(()), corners, periodic)
    nodes = np.zeros((*shape.nodes, 2, 2))
    share = np.zeros(shape.nodes)
    for corner in CORNERS:
        share[at_corner(area.shape, shape.nodes, corner)] += area / 4
    t1, t2 = tangents(rest, periodic)
    D, alone = weights.bending[:2, :2], 1 / np.diag(np.linalg.inv(weights.bending[:2, :2]))
    along_u, along_v = between(shape.nodes, periodic)
    nodes[along_u & along_v] = D
    nodes[along_u & ~along_v, 0, 0], nodes[~along_u & along_v, 1, 1] = alone
    G = np.stack([dot(t1, t1), dot(t2, t2)], -1)
    nodes *= share[..., None, None] / (G[..., :, None] * G[..., None, :])
    # D (1 - nu) B12^2 is 2 D33 B12^2, where D33 belongs to the doubled k12.
    twist = 4 * weights.bending[2, 2] * area / (g11 * g22)
    return DiscreteEnergy(rest, membrane, nodes, twist, periodic=periodic)


def _corner_weights(F: Array, area: Array, bending: Array, exists: Array) -> Array:
    """Skewed charts: a quarter of each cell's area times C, with the entries that a corner lacks condensed out."""
    units = np.array([[[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 1], [1, 0]]])
    inverse = np.linalg.inv(F)
    k = np.einsum("...ai,nij,...bj->...nab", inverse, units, inverse)
    voigt = np.stack([k[..., 0, 0], k[..., 1, 1], 2 * k[..., 0, 1]], -1)
    C = area[..., None, None] / 4 * np.einsum("...na,ab,...mb->...nm", voigt, bending, voigt)
    weights = np.zeros((*exists.shape, 3))
    for i, j, corner in np.ndindex(exists.shape[:3]):
        kept, lost = np.flatnonzero(exists[i, j, corner]), np.flatnonzero(~exists[i, j, corner])
        full = C[i, j]
        across = full[np.ix_(kept, lost)]
        rest = full[np.ix_(kept, kept)] - across @ np.linalg.pinv(full[np.ix_(lost, lost)]) @ across.T
        weights[i, j, corner][np.ix_(kept, kept)] = rest
    return weights


def _paper_energy(shape: RestShape, weights: PaperWeights) -> DiscreteEnergy:
    """The paper's sum of eta_ij/4 (G - G0)^2 + xi_ij/2 (B - B0)^2, G11 and G22 on edges, B11 and B22 at nodes."""
    h1, h2 = shape.spacing
    eta, xi = weights.eta, weights.xi

    def membrane(change: Array) -> Array:
        on_edges = (
            eta[0] * np.sum(change[..., :2] ** 2, -1) / h1**4 + eta[1] * np.sum(change[..., 2:4] ** 2, -1) / h2**4
        )
        return np.asarray(h1 * h2 / 4 * (on_edges / 2 + 2 * eta[2] * (change[..., 4] / (h1 * h2)) ** 2))

    halves = [np.where(has, 1.0, 0.5) for has in between(shape.nodes, shape.periodic)]
    share = h1 * h2 * halves[0] * halves[1]
    bending = share[..., None, None] * np.diag([xi[0] / h1**4, xi[1] / h2**4])
    twist = np.array(2 * xi[2] / (h1 * h2))
    return DiscreteEnergy(shape.positions, membrane, bending, twist, periodic=shape.periodic)
