"""The force of the air on curves and solids: closed forms, derivatives, rigid motions, what is not met."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from warpdeform.body import Body
from warpdeform.forces.wind_load import WindLoad
from warpdeform.material import Material
from warpdeform.section import Section
from warpdeform.settings import Settings
from warpdeform.shape import block, line, pipe, ring, root_line, strands
from warpdeform.simulation import Simulation
from warpdeform.wind import Wind

Array = NDArray[np.float64]

RUBBER = Material(density=1000.0, youngs_modulus=1e6, poisson_ratio=0.3)
SETTINGS = Settings(device="cpu", gravity=(0.0, 0.0, 0.0), precision="float64")
AIR, TAU, C = np.array([3.0, -2.0, 1.0]), 0.01, 1.7
BODIES = {
    "rope": Body(
        "rope", strands(line((7,), 0.9), root_line(3, 0.5)), RUBBER, section=Section.circular(0.01), wind_coefficient=C
    ),
    "ring": Body("ring", ring((12,), 0.4), RUBBER, section=Section.circular(0.01), wind_coefficient=C),
    "block": Body("block", block((3, 4, 11), (0.3, 0.5, 0.9)), RUBBER, wind_coefficient=C),
    "pipe": Body("pipe", pipe((24, 11, 3), 0.3, 0.9, 0.1), RUBBER, wind_coefficient=C),
}


class Blown:
    """A body in the wind, its force and its arrays."""

    def __init__(self, body: Body, air: Any = AIR, width: int | None = None, velocity: Any = (0.0, 0.0, 0.0)) -> None:
        body = replace(body, velocity=tuple(velocity))
        handle = Simulation([body], wind=Wind(air), settings=SETTINGS, lane_width=width)[body.name]
        self.handle, self.state = handle, handle.state
        (self.force,) = (term for term in handle.terms if isinstance(term, WindLoad))
        self.start = handle.positions()
        self.force.prepare(0.3, TAU, TAU)
        self.state.w.assign(self.upload(self.start))
        self.force.linearise(self.state, self.state.x)

    def upload(self, positions: Array) -> Any:
        return self.handle.model.upload(positions)

    def energy(self, z: Array) -> float:
        partials = self.state.partials
        partials.zero_()
        self.force.add_energy(self.state, self.upload(z), partials)
        return float(partials.numpy().sum())

    def gradient(self, z: Array) -> Array:
        out = self.handle.model.zeros(3)
        self.force.add_gradient(self.state, self.upload(z), out)
        return self.handle.model.download(out)

    def blocks(self) -> Array:
        out = self.handle.model.zeros(6)
        self.force.add_node_blocks(self.state, out)
        return self.handle.model.download(out)[..., [0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(*self.start.shape, 3)

    def push(self) -> Array:
        """Force on the whole body at rest [N]."""
        return -self.gradient(self.start).sum(axis=tuple(range(self.start.ndim - 1)))


def test_a_rope_is_pushed_across_its_length() -> None:
    """c times length times diameter times what of the wind goes across, on each strand."""
    across = AIR * [0.0, 1.0, 1.0]
    np.testing.assert_allclose(Blown(BODIES["rope"]).push(), C * 3 * 0.9 * 0.02 * across, rtol=1e-12, atol=1e-12)


def test_a_ring_in_a_plane_catches_half_of_the_wind_along_the_plane() -> None:
    length = 12 * 2 * 0.4 * np.sin(np.pi / 12)
    np.testing.assert_allclose(
        Blown(BODIES["ring"]).push(), C * length * 0.02 * AIR * [0.5, 0.5, 1.0], rtol=1e-12, atol=1e-12
    )


def test_a_block_is_pushed_at_both_of_its_sides() -> None:
    sides = 2 * np.array([0.5 * 0.9, 0.3 * 0.9, 0.3 * 0.5])
    np.testing.assert_allclose(Blown(BODIES["block"]).push(), C * sides * AIR, rtol=1e-12)


def test_a_pipe_is_pushed_within_and_without() -> None:
    """Around, half of the squared normals go along each axis; the ends are rings."""
    chord = 2 * np.sin(np.pi / 24)
    around, ends = 24 * chord * 2 * 0.3 * 0.9, 0.5 * 24 * np.sin(2 * np.pi / 24) * (0.35**2 - 0.25**2)
    expected = C * AIR * [around / 2, around / 2, 2 * ends]
    np.testing.assert_allclose(Blown(BODIES["pipe"]).push(), expected, rtol=3e-3)


@pytest.mark.parametrize("name", BODIES)
def test_gradient_and_blocks_are_derivatives(name: str) -> None:
    blown = Blown(BODIES[name])
    random = np.random.default_rng(3)
    z = blown.start + random.normal(0, 0.01, blown.start.shape)
    d = random.normal(0, 0.01, blown.start.shape)
    slope = (blown.energy(z + d) - blown.energy(z - d)) / 2
    assert slope == pytest.approx(np.sum(blown.gradient(z) * d), rel=1e-9)
    change = (blown.gradient(z + d) - blown.gradient(z - d)) / 2
    blocks = blown.blocks()
    np.testing.assert_allclose(change, np.einsum("...ab,...b", blocks, d), atol=1e-10 * np.abs(change).max())
    np.testing.assert_array_equal(blocks, np.swapaxes(blocks, -1, -2))
    assert np.linalg.eigvalsh(blocks).min() > -1e-12 * np.abs(blocks).max()


@pytest.mark.parametrize("name", BODIES)
def test_turned_bodies_are_pushed_as_the_wind_is_turned(name: str) -> None:
    turn = Rotation.from_rotvec([0.4, -0.9, 0.3])
    turned = replace(BODIES[name], rotation=tuple(turn.as_quat()), position=(1.0, 2.0, 3.0))
    expected = turn.apply(Blown(BODIES[name]).push())
    np.testing.assert_allclose(Blown(turned, air=turn.apply(AIR)).push(), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", BODIES)
def test_lane_widths_agree_to_the_bit(name: str) -> None:
    narrow, wide = (Blown(BODIES[name], width=width) for width in (1, 8))
    np.testing.assert_array_equal(narrow.gradient(narrow.start), wide.gradient(wide.start))
    np.testing.assert_array_equal(narrow.blocks(), wide.blocks())


@pytest.mark.parametrize("name", BODIES)
def test_what_moves_with_the_air_feels_none(name: str) -> None:
    blown = Blown(BODIES[name])
    gradient = blown.gradient(blown.start + TAU * AIR)
    assert np.abs(gradient).max() < 1e-12 * np.abs(blown.gradient(blown.start)).max()


def test_a_curve_without_a_section_meets_no_wind() -> None:
    thread = Material(linear_density=0.01, axial_stiffness=100.0)
    simulation = Simulation([Body("thread", line((5,)), thread)], wind=Wind(AIR), settings=SETTINGS)
    assert not any(isinstance(term, WindLoad) for term in simulation["thread"].terms)
