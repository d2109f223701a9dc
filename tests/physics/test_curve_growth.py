"""Strands that grow, curl and twist, in motion."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bodies import PRECISE, REAL_TIME, assert_same_bits, run
from physics.statics import elastic_forces

from warpdeform import launching
from warpdeform.body import Body, Pin
from warpdeform.growth import Growth
from warpdeform.material import Material
from warpdeform.section import Section
from warpdeform.settings import Settings
from warpdeform.shape import line, ring, strands
from warpdeform.shape.curves import root_line
from warpdeform.simulation import Simulation

Array = np.ndarray[Any, Any]

STILL = Settings(
    integrator="implicit-euler", fps=1.0, newton_iterations=0, newton_tolerance=1e-9, cg_tolerance=1e-6,
    cg_iterations=5000, precision="float64", device="cpu", gravity=(0.0, 0.0, 0.0),
)  # fmt: skip
WIRE = Material(linear_density=0.05, axial_stiffness=200.0, bending_stiffness=0.02)
RUBBER = Material(density=1000.0, youngs_modulus=1e6, poisson_ratio=0.3)
END = Pin([[0, 0], [1, 0]])
"""Where and in which direction the strand begins."""


def settled(body: Body, steps: int, **settings: Any) -> Simulation:
    simulation = Simulation([body], settings=replace(STILL, **settings))
    for _ in range(steps):
        simulation.step()
    return simulation


def test_a_free_strand_that_grew_by_two_is_twice_as_long_and_at_rest() -> None:
    body = Body("hair", line((17,)), WIRE, growth=Growth([0.0, 4.0], [1.0, 2.0]))
    simulation = settled(body, 10)
    hair = simulation["hair"]
    found = hair.positions() - hair.positions().mean(axis=0)
    rest = body.shape.positions
    np.testing.assert_allclose(found, 2.0 * (rest - rest.mean(axis=0)), atol=1e-7)
    assert hair.max_stretch() == pytest.approx(1.0, abs=1e-7)
    assert simulation.record().energy.elastic < 1e-12
    assert np.abs(elastic_forces(hair)).max() < 1e-5


def test_a_ring_grows_into_a_larger_ring() -> None:
    body = Body("band", ring((24,), 0.3), RUBBER, section=Section.circular(0.01), growth=Growth([0.0, 3.0], [1.0, 1.5]))
    band = settled(body, 8)["band"]
    radius = np.linalg.norm(band.positions() - band.positions().mean(axis=0), axis=-1)
    assert radius.mean() == pytest.approx(0.45, rel=1e-6)
    assert np.ptp(radius) < 1e-6
    assert np.abs(elastic_forces(band)).max() < 1e-4


@pytest.mark.parametrize("about", [0, 1])
def test_a_straight_strand_curls_into_an_arc_of_the_radius_that_it_is_given(about: int) -> None:
    radius, curvature = 0.4, [0.0, 0.0]
    curvature[about] = 1 / radius
    growth = Growth([0.0, 40.0], curvature=[[0.0, 0.0], curvature])
    director = (0.0, 0.0, 1.0)
    section = Section.rectangular(0.02, 0.01)
    body = Body("wire", line((41,)), RUBBER, section=section, director=director, pins=(END,), growth=growth)
    simulation = settled(body, 20, newton_tolerance=1e-10, fps=0.1)
    wire = simulation["wire"].positions()[:, 0]
    # Director 1 is z and the strand runs along x: about director 1 it stays in the plane of x and y, about 2, -y, not.
    plane = [0, 1] if about == 0 else [0, 2]
    assert np.ptp(np.delete(wire, plane, axis=1), axis=0).max() < 1e-8
    middles = 0.5 * (wire[1:] + wire[:-1])[:, plane]
    centre = np.linalg.lstsq(
        np.column_stack([2 * middles, np.ones(len(middles))]), np.sum(middles**2, axis=1), rcond=None
    )[0]
    found = np.linalg.norm(middles - centre[:2], axis=1)
    print(f"\ncurl about director {about + 1}: radius {found.mean():.6f} m, wanted {radius} m", end="")
    np.testing.assert_allclose(found, radius, rtol=1e-5)
    assert np.abs(elastic_forces(simulation["wire"])[2:]).max() < 1e-5


def test_the_free_end_of_a_strand_with_natural_twist_turns_by_it() -> None:
    twist = 3.0
    growth = Growth([0.0, 4.0], [1.0, 1.2], [[0.0, 0.0, 0.0], [0.0, 0.0, twist]])
    section, director = Section.rectangular(0.02, 0.01), (0.0, 0.0, 1.0)
    body = Body("wire", line((21,)), RUBBER, section=section, director=director, pins=(END,), growth=growth)
    simulation = settled(body, 10)
    # The held segment keeps its length; between the middles of the first and the last one lies the rest.
    segment = 1.2 / 20
    frames = simulation["wire"].elasticity.frames
    directors = frames._layout.unpack(frames._director.numpy())[:20, 0]
    np.testing.assert_allclose(np.diff(simulation["wire"].positions()[1:, 0, 0]), segment, rtol=1e-6)
    turned = np.unwrap(np.arctan2(-directors[:, 1], directors[:, 2]))
    print(f"\ntwist of {twist} rad/m: the end turned by {turned[-1] - turned[0]:.6f} rad", end="")
    np.testing.assert_allclose(np.diff(turned), twist * segment, rtol=1e-5)


def test_many_strands_grow_each_by_its_share() -> None:
    shape = strands(line((9,)), root_line(5, 0.4))
    growth = Growth([0.0, 3.0], [1.0, 1.5], where=lambda u, strand: strand)
    body = Body("hair", shape, WIRE, growth=growth)
    positions = settled(body, 8)["hair"].positions()
    np.testing.assert_allclose(np.ptp(positions[..., 0], axis=0), 1 + 0.5 * np.linspace(0, 1, 5), atol=1e-6)


@pytest.mark.parametrize("settings", [{"threads": 1}, {"threads": 2}, {"captured": False}], ids=str)
def test_nothing_of_it_is_frozen_in_graphs(settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launching, "SHARED_FROM", 0)
    growth = Growth([0.02, 0.1], [1.0, 0.8], [[0.0, 0.0, 0.0], [3.0, 1.0, 2.0]])

    def made(growth: Growth | None, **options: Any) -> Simulation:
        captured = options.pop("captured", True)
        body = Body("hair", line((11,)), WIRE, pins=(END,), growth=growth)
        return Simulation([body], settings=replace(REAL_TIME, **options), captured=captured)

    simulation = made(growth, **settings)
    found = run(simulation, 8)
    assert_same_bits(found, run(made(growth, threads=1), 8))
    simulation.reset()
    assert_same_bits(run(simulation, 8), found)
    assert np.abs(run(made(None), 8)[0] - found[0]).max() > 0.01


@pytest.mark.parametrize("integrator", ["verlet", "tr-bdf2"])
def test_other_methods_see_it_too(integrator: str) -> None:
    growth = Growth([0.0, 0.5], [1.0, 1.2])
    body = Body("hair", line((5,)), replace(WIRE, axial_stiffness=20.0), growth=growth, drag=5.0)
    simulation = Simulation([body], settings=replace(PRECISE, integrator=integrator, gravity=(0.0, 0.0, 0.0)))
    for _ in range(120):
        simulation.advance_frame()
    assert np.ptp(simulation["hair"].positions()[:, 0, 0]) == pytest.approx(1.2, rel=1e-3)
