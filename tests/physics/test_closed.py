"""Closed surfaces in motion: the seam is nowhere, and nothing beside the body is counted."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bodies import CLOTH, PRECISE, run
from surfaces import CLOSED

from warpdeform.body import Body, Pin, Spring
from warpdeform.obstacle import Obstacle
from warpdeform.settings import Settings
from warpdeform.shape import torus
from warpdeform.simulation import Simulation
from warpdeform.track import Track
from warpdeform.wind import Wind

Array = np.ndarray[Any, Any]


def scene(kind: str, nodes: tuple[int, int], lane_width: int, **settings: Any) -> Simulation:
    """A closed body with every kind of load; a pin is led, so that pins work."""
    led = Track.line((0.0, 0.0, 0.0), (0.1, 0.0, 0.3), 0.0, 0.5)
    body = Body(
        kind, CLOSED[kind](nodes), CLOTH, drag=0.3, velocity=(0.0, 0.5, -1.0),
        pins=(Pin([[0, 0]], led),), springs=(Spring([[1, 2]], 3.0),),
    )  # fmt: skip
    floor = Obstacle("plane", track=Track.fixed((0.0, 0.0, -0.25)), friction=0.4)
    wind = Wind((2.0, 1.0, 0.0), gust=0.4)
    return Simulation(
        [body], obstacles=[floor], wind=wind, settings=replace(PRECISE, **settings), lane_width=lane_width
    )


@pytest.mark.parametrize("preconditioner", ["block-jacobi", "multigrid"])
@pytest.mark.parametrize(("kind", "nodes"), [("tube", (7, 11)), ("tube along u", (5, 11)), ("torus", (9, 10))])
def test_lane_widths_agree_over_steps(kind: str, nodes: tuple[int, int], preconditioner: str) -> None:
    found = []
    for width in (1, 8):
        simulation = scene(kind, nodes, width, preconditioner=preconditioner)
        arrays, energy = run(simulation, 5), simulation.record().energy
        found.append((*arrays, np.array([energy.kinetic, energy.elastic, energy.field, energy.work_in])))
    for narrow, wide in zip(*found, strict=True):
        np.testing.assert_allclose(wide, narrow, atol=1e-7 * np.abs(narrow).max())


def test_free_torus_keeps_its_momentum_and_its_shape() -> None:
    settings = replace(PRECISE, gravity=(0.0, 0.0, 0.0))
    body = Body("torus", torus((11, 9), 0.5, 0.2), CLOTH, velocity=(1.0, -2.0, 0.5))
    simulation = Simulation([body], settings=settings)
    for _ in range(4):
        simulation.step()
    handle = simulation["torus"]
    np.testing.assert_allclose(handle.velocities(), np.broadcast_to([1.0, -2.0, 0.5], (11, 9, 3)), atol=1e-9)
    assert handle.max_stretch() == pytest.approx(1.0, abs=1e-9)
    assert simulation.record().energy.elastic == pytest.approx(0.0, abs=1e-12)
    assert simulation.record().energy.work_in == pytest.approx(0.0, abs=1e-12)


def test_wind_meets_all_of_a_closed_body_alike() -> None:
    # A torus in wind along its axis: by symmetry no force across, the same on every meridian.
    shape = torus((12, 11), 0.5, 0.2)
    settings = Settings(precision="float64", gravity=(0.0, 0.0, 0.0), device="cpu")
    simulation = Simulation([Body("torus", shape, CLOTH)], wind=Wind((0.0, 0.0, 5.0)), settings=settings)
    simulation.step()
    velocity = simulation["torus"].velocities()
    angle = 2 * np.pi * np.arange(12) / 12
    radial = velocity[..., 0] * np.cos(angle)[:, None] + velocity[..., 1] * np.sin(angle)[:, None]
    across = velocity[..., 1] * np.cos(angle)[:, None] - velocity[..., 0] * np.sin(angle)[:, None]
    assert velocity[..., 2].min() > 0.001
    np.testing.assert_allclose(radial, np.broadcast_to(radial[:1], radial.shape), atol=1e-6)
    np.testing.assert_allclose(across, 0.0, atol=1e-6)


def test_mass_of_closed_surfaces_is_that_of_their_area() -> None:
    simulation = Simulation([Body("torus", torus((64, 48), 0.5, 0.2), CLOTH)], settings=Settings(device="cpu"))
    mass = simulation["torus"].model.node_mass.sum()
    assert mass == pytest.approx(0.2 * 4 * np.pi**2 * 0.5 * 0.2, rel=3e-3)
