"""Solids that close along an axis: rings around u, v or w, with lane groups that they fill and that they do not."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from surfaces import REALS, WIDTHS

from warpdeform.forces.solid_elasticity import SolidElasticity
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.growth import Growth
from warpdeform.material import Material

Array = np.ndarray[Any, Any]

MATERIALS = {
    "barrier": Material(density=1000.0, youngs_modulus=1e5, poisson_ratio=0.3, inversion_barrier=5e4),
    "paper": Material(density=1000.0, eta=5e4),
}
RINGS = [(axis, around) for axis in range(3) for around in (5, 16)]


class Ring:
    """The elastic term of a thick ring, with NumPy arrays of shape (*nodes, ...) going in and coming out."""

    def __init__(
        self, axis: int, around: int, material: str, real: Any = wp.float64, lane_width: int = 1, size: float = 1.0,
        **options: Any,
    ) -> None:  # fmt: skip
        angle = 2 * np.pi * np.arange(around) / around
        rho, theta, z = np.meshgrid(np.linspace(0.5, 0.9, 4), angle, np.linspace(0.0, 0.3, 3), indexing="ij")
        order = {0: (1, 0, 2), 1: (0, 1, 2), 2: (0, 2, 1)}[axis]
        self.rest = size * np.stack([rho * np.cos(theta), rho * np.sin(theta), z], -1).transpose(*order, 3)
        spacing = np.array([0.4 / 3, 2 * np.pi / around, 0.15])[list(order)]
        nodes = self.rest.shape[:3]
        grid = ParameterGrid(nodes, tuple(spacing), tuple(k == axis for k in range(3)))
        self.real, self.nodes = real, nodes
        self.layout = Layout(nodes, lane_width, grid.periodic)
        self.term = SolidElasticity(grid, self.layout, self.rest, MATERIALS[material], real, "cpu", **options)

    def upload(self, values: Array) -> wp.array:
        return wp.array(self.layout.pack(values), dtype=self.real, device="cpu")

    def download(self, array: wp.array) -> Array:
        values = self.layout.unpack(array.numpy())
        np.testing.assert_array_equal(array.numpy(), self.layout.pack(values))  # nothing beside the nodes
        return values

    def energy(self, z: Array) -> float:
        partials = wp.zeros((self.layout.rows, self.layout.columns), dtype=wp.float64, device="cpu")
        self.term.add_energy(None, self.upload(z), partials)  # type: ignore[arg-type]
        return float(partials.numpy().sum())

    def gradient(self, z: Array) -> Array:
        self.position = self.upload(z)
        self.term.linearise(None, self.position)  # type: ignore[arg-type]
        out = self.upload(0 * z)
        self.term.add_gradient(None, self.position, out)  # type: ignore[arg-type]
        return self.download(out)

    def product(self, p: Array) -> Array:
        out = self.upload(0 * p)
        self.term.add_hessian_product(None, self.upload(p), out)  # type: ignore[arg-type]
        return self.layout.unpack(out.numpy())

    def blocks(self) -> Array:
        out = self.upload(np.zeros((*self.nodes, 6)))
        self.term.add_block_diagonal(None, out)  # type: ignore[arg-type]
        return self.download(out)

    def deformed(self) -> Array:
        return self.rest * [1, 1, 0.7] + 0.02 * np.random.default_rng(1).normal(size=self.rest.shape)


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize(("axis", "around"), RINGS)
def test_closed_solids_have_derivatives_of_their_energy(axis: int, around: int, material: str) -> None:
    ring, step = Ring(axis, around, material), 1e-6
    z, random = ring.deformed(), np.random.default_rng(2)
    p, q = (random.normal(size=z.shape) for _ in range(2))
    gradient = ring.gradient(z)
    slope = (ring.energy(z + step * p) - ring.energy(z - step * p)) / (2 * step)
    assert abs(np.sum(gradient * p) - slope) < 1e-7 * np.linalg.norm(gradient) * np.linalg.norm(p)
    assert np.abs(gradient.sum((0, 1, 2))).max() < 1e-15 * np.abs(gradient).sum()
    Hp, Hq = ring.product(p), ring.product(q)
    assert abs(np.sum(q * Hp) - np.sum(p * Hq)) < 1e-13 * np.linalg.norm(Hp) * np.linalg.norm(q)
    assert np.sum(p * Hp) > 0
    blocks = ring.blocks()[..., [0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(*ring.nodes, 3, 3)
    for node in ((0, 0, 0), tuple(n - 1 for n in ring.nodes), (1, 1, 1)):
        for c in range(3):
            unit = np.zeros_like(z)
            unit[(*node, c)] = 1.0
            assert np.abs(ring.product(unit)[node] - blocks[node][:, c]).max() < 1e-13 * np.abs(blocks).max()
    assert np.abs(ring.gradient(ring.rest)).max() < 1e-13 * np.abs(gradient).max()


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("axis", range(3))
def test_lane_widths_of_closed_solids_agree_to_the_bit(axis: int, real: Any, material: str) -> None:
    narrow, wide = (Ring(axis, 19, material, real, width) for width in WIDTHS[real])
    z, p = narrow.deformed(), np.random.default_rng(3).normal(size=narrow.rest.shape)
    np.testing.assert_array_equal(narrow.gradient(z), wide.gradient(z))
    np.testing.assert_array_equal(narrow.product(p), wide.product(p))
    np.testing.assert_array_equal(narrow.blocks(), wide.blocks())
    assert narrow.energy(z) == pytest.approx(wide.energy(z), rel=1e-13)


def test_force_on_a_turned_ring_turns_with_the_axis_of_the_grid() -> None:
    """Which axis of the grid closes does not matter."""
    forces = []
    for axis, order in ((0, (1, 0, 2)), (1, (0, 1, 2)), (2, (0, 2, 1))):
        ring = Ring(axis, 7, "paper")
        z = ring.rest * [1.1, 0.9, 1.0] + 0.1 * ring.rest[..., [1, 2, 0]] ** 2
        forces.append(ring.gradient(z).transpose(*order, 3))
    for force in forces[1:]:
        np.testing.assert_allclose(force, forces[0], atol=1e-12 * np.abs(forces[0]).max())


@pytest.mark.parametrize(("axis", "around"), RINGS)
@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("lane_width", [1, 8])
def test_rings_grow_into_larger_rings(axis: int, around: int, material: str, lane_width: int) -> None:
    small = Ring(axis, around, material, lane_width=lane_width, growth=Growth([0.0, 1.0], [1.0, 1.3]))
    small.term.prepare(1.0, 0.1, 0.1)
    large = Ring(axis, around, material, lane_width=lane_width, size=1.3)
    rng = np.random.default_rng(5)
    z, p = large.rest + rng.normal(0, 0.01, large.rest.shape), rng.normal(0, 1, large.rest.shape)
    assert small.energy(z) == pytest.approx(large.energy(z), rel=1e-11)
    for found, wanted in (
        (small.gradient(z), large.gradient(z)), (small.product(p), large.product(p)), (small.blocks(), large.blocks()),
    ):  # fmt: skip
        np.testing.assert_allclose(found, wanted, atol=1e-11 * np.abs(wanted).max())
