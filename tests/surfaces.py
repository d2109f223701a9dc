"""Surfaces for tests: shapes, materials, deformed states, and the elastic term with NumPy going in and coming out."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.surface_elasticity import SurfaceElasticity
from warpdeform.grid import Layout
from warpdeform.material import Material
from warpdeform.shape import RestShape, arc, from_map, sheet, sphere, torus, tube

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
    "varying": Material(
        density=1000.0, youngs_modulus=(lambda u, v: 1e6 * (1 + u), lambda u, v: 1e6 * (2 - v)), poisson_ratio=0.3,
        shear_modulus=4e5, thickness=lambda u, v: 0.1 + 0.2 * u * v, bending_multipliers=lambda u, v: 0.1 + (u > v),
    ),
    "varying paper": Material(
        areal_density=0.2, eta=(lambda u, v: 300 + 200 * u, 300.0, 200.0), xi=lambda u, v: 5 + 9 * v
    ),
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
    positions, periodic = rest.positions.transpose(1, 0, 2), rest.periodic[swap]
    return RestShape(positions, rest.spacing[swap], periodic, poles=rest.poles)


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


def ball(nodes: tuple[int, int]) -> RestShape:
    """A sphere with an even number of meridians, at least six."""
    return sphere((max(6, nodes[0] + nodes[0] % 2), nodes[1]), 0.4)


def twisted_ball(nodes: tuple[int, int]) -> RestShape:
    """An egg whose meridians wind around it: skewed at its poles, so that b12 couples to b11 and b22."""
    n, m = nodes[1], max(6, nodes[0] + nodes[0] % 2)

    def wound(u: Array, v: Array) -> Array:
        return np.stack([0.4 * np.sin(v) * np.cos(u + v), 0.4 * np.sin(v) * np.sin(u + v), -0.6 * np.cos(v)], -1)

    first = np.pi / (2 * n)
    return from_map(wound, (m, n), ((0, 2 * np.pi), (first, np.pi - first)), (True, False), (True, True))


def disk(nodes: tuple[int, int], radius: float = 1.0) -> RestShape:
    """A flat disk, v from its middle to its rim: one pole, one border."""
    step = radius / (nodes[1] - 0.5)
    m = max(6, nodes[0] + nodes[0] % 2)
    return from_map(
        lambda u, v: np.stack([v * np.cos(u), v * np.sin(u), 0 * u], -1),
        (m, nodes[1]), ((0, 2 * np.pi), (step / 2, radius)), (True, False), (True, False),
    )  # fmt: skip


SHAPES: dict[str, Callable[[tuple[int, int]], RestShape]] = {
    "flat": lambda nodes: sheet(nodes, (1.0, 0.7)),
    "arc": lambda nodes: arc(nodes, radius=0.5, angle=100.0, length=0.7),
    "fan": fan,
    "bump": bump,
    "parallelogram": parallelogram,
}
CASES = [(shape, material) for shape in SHAPES for material in list(MATERIALS)[:6]]
CASES += [("flat", "varying"), ("fan", "varying paper"), ("bump", "varying")]
"""Every shape with every even material, some with varying ones; bump and parallelogram couple b12 to b11 and b22."""
CLOSED: dict[str, Callable[[tuple[int, int]], RestShape]] = {
    "tube": lambda nodes: tube(nodes, radius=0.3, length=0.7),
    "tube along u": lambda nodes: transposed(tube(nodes[::-1], radius=0.3, length=0.7)),
    "torus": lambda nodes: torus(nodes, radius=0.5, tube_radius=0.2),
    "screw": screw,
    "knot": knot,
}
"""Shapes with periodic axes."""
POLAR: dict[str, Callable[[tuple[int, int]], RestShape]] = {
    "ball": ball,
    "ball along u": lambda nodes: transposed(ball(nodes[::-1])),
    "twisted ball": twisted_ball,
    "twisted ball along u": lambda nodes: transposed(twisted_ball(nodes[::-1])),
    "disk": disk,
}
"""Shapes with poles; the number of nodes around them is made even."""
CLOSED_CASES = [
    *((shape, material) for shape in CLOSED for material in ("membrane", "isotropic")),
    ("tube", "orthotropic"), ("tube along u", "paper"), ("torus", "shell"), ("screw", "shell"), ("knot", "paper"),
    ("tube", "varying"), ("screw", "varying"),
]  # fmt: skip
"""Closed shapes with materials; screw and knot couple b12 to b11 and b22."""
POLAR_CASES = [
    ("ball", "membrane"), ("ball", "isotropic"), ("ball along u", "orthotropic"), ("ball", "paper"),
    ("ball along u", "paper"), ("twisted ball", "isotropic"), ("twisted ball along u", "shell"), ("disk", "shell"),
    ("ball along u", "varying"), ("ball", "varying paper"), ("twisted ball", "varying"),
]  # fmt: skip
"""Shapes with poles and materials; twisted ones couple b12 to b11 and b22."""


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
