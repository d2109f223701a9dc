"""Surfaces that close at poles: even strains, thin-shell solutions, motion, and no trace of the pole in any of them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bodies import CLOTH, PRECISE, run
from physics.statics import orders, percent
from surfaces import POLAR, Surface, disk

from warpdeform.body import Body, Pin
from warpdeform.material import Material
from warpdeform.settings import Settings
from warpdeform.shape import sphere
from warpdeform.simulation import Simulation
from warpdeform.wind import Wind

Array = np.ndarray[Any, Any]

MEMBRANE = Material(areal_density=0.2, membrane_stiffness=1000.0, poisson_ratio=0.3)
STILL = Settings(
    integrator="implicit-euler", fps=1.0, newton_iterations=0, newton_tolerance=1e-9, cg_tolerance=1e-6,
    cg_iterations=5000, precision="float64", device="cpu", gravity=(0.0, 0.0, 0.0),
)  # fmt: skip


@pytest.mark.parametrize(
    "strain", [((1, 0), (0, 1)), ((1, 0), (0, 0)), ((0, 1), (1, 0))], ids=["even", "one way", "shear"]
)
def test_even_strain_of_a_flat_disk_leaves_no_force_at_its_pole(strain: tuple[tuple[float, float], ...]) -> None:
    # But for chords that are shorter than their arcs, by (pi/M)^2/6. With the pole left open, or with edges counted by
    # halves, the forces beside it are of the order of the stress itself.
    largest = []
    for around in (16, 32):
        shape = disk((around, 6))
        surface = Surface(shape, MEMBRANE)
        displacement = np.zeros_like(shape.positions)
        displacement[..., :2] = shape.positions[..., :2] @ np.array(strain, dtype=np.float64)
        surface.linearise(shape.positions)
        # Per length of the ring, over the stress.
        force = surface.product(displacement)[:, :-1] * around / (2 * np.pi * shape.spacing[1]) / 1000.0
        largest.append(np.abs(force).max())
    if strain == ((1, 0), (0, 1)):
        assert max(largest) < 1e-10
    else:
        assert largest[1] < 0.03
        assert orders(largest)[0] > 1.8


def test_even_bending_of_a_flat_disk_leaves_no_force_at_its_pole() -> None:
    shape, largest = None, []
    material = replace(MEMBRANE, bending_stiffness=1.0)
    for around in (16, 32):
        shape = disk((around, 8))
        surface = Surface(shape, material)
        surface.linearise(shape.positions)
        lifted = np.zeros_like(shape.positions)
        lifted[..., 2] = np.sum(shape.positions**2, axis=-1)
        largest.append(np.abs(surface.product(lifted)[:, :-2, 2]).max() * around)
    assert orders(largest)[0] > 1.9


def blown_up(nodes: tuple[int, int], thickness: float, stretch: float = 1.02) -> tuple[Array, Array]:
    """Stretch around and along the meridians of a sphere under the pressure that stretches it so, over that stretch."""
    E, nu, radius = 1e6, 0.3, 0.5
    strain = (stretch**2 - 1) / 2
    # N = E h strain/(1 - nu) over rest lengths, so stretch N = p stretch^2 radius / 2 over present ones.
    pressure = 2 * E * thickness * strain / ((1 - nu) * stretch * radius)
    material = Material(density=1000.0, youngs_modulus=E, poisson_ratio=nu, thickness=thickness)
    body = Body("balloon", sphere(nodes, radius), material, pressure=pressure)
    simulation = Simulation([body], settings=STILL)
    last = body.shape.positions
    for _ in range(20):
        simulation.step()
        now = simulation["balloon"].positions()
        moved, last = np.abs(now - last).max(), now
        if moved < 1e-9:
            break
    assert moved < 1e-9
    grid = body.shape.grid
    found = []
    for axis in (0, 1):
        rest, length = (np.linalg.norm(grid.differences(r, axis), axis=-1) for r in (body.shape.positions, now))
        found.append((length / rest - stretch) / (stretch - 1))
        assert np.ptp(found[-1], axis=0).max() < 1e-9
    return found[0][0], found[1][0]


@pytest.mark.parametrize("thickness", [1e-4, 1e-2], ids=["membrane", "shell"])
def test_sphere_under_pressure_stretches_evenly_poles_included(thickness: float) -> None:
    # Thin shell: p R / 2 is the stress resultant everywhere.
    poles, rest = [], []
    for count in (8, 16, 32):
        around, along = blown_up((2 * count, count), thickness)
        poles.append(max(np.abs(around[[0, 1, -2, -1]]).max(), np.abs(along[[0, -1]]).max()))
        rest.append(max(np.abs(around[2:-2]).max(), np.abs(along[1:-1]).max()))
        assert poles[-1] < 3 * rest[-1]
    print(f"\nsphere under pressure, poles: {percent(poles)}; rest: {percent(rest)}", end="")
    assert orders(poles).min() > 1.9
    assert orders(rest).min() > 1.8
    assert max(poles[-1], rest[-1]) < 2e-3


def test_clamped_disk_sags_as_the_textbook_says() -> None:
    # w = q R^4 / (64 D) in the middle of a clamped plate. Two rings are held; the slope is zero between them.
    errors = []
    for count in (8, 16):
        shape = disk((2 * count, count + 1), radius=1.0 + 0.5 / count)
        material = Material(density=1000.0, youngs_modulus=1e6, poisson_ratio=0.3, thickness=0.01)
        surface = Surface(shape, material)
        surface.linearise(shape.positions)
        free = np.zeros((*shape.nodes, 3), dtype=bool)
        free[:, :-2, 2] = True
        inside = np.flatnonzero(free)
        unit = np.zeros((shape.positions.size, len(inside)))
        unit[inside, np.arange(len(inside))] = 1.0
        columns = [surface.product(p.reshape(shape.positions.shape)).ravel()[inside] for p in unit.T]
        load = surface.force.stiffness.node_area.repeat(3)[inside]
        sag = np.linalg.solve(np.array(columns), load)[: count - 1]
        D = 1e6 * 0.01**3 / (12 * 0.91)
        # The sag at the first ring, carried on to the pole by the exact shape (1 - r^2)^2.
        radius = np.linalg.norm(shape.positions[0, 0])
        errors.append(sag[0] / (1 - radius**2) ** 2 * 64 * D - 1)
    print(f"\nclamped disk: {percent(errors)}", end="")
    assert orders(errors)[0] > 1.8
    assert abs(errors[1]) < 0.02


@pytest.mark.parametrize("preconditioner", ["block-jacobi", "multigrid"])
@pytest.mark.parametrize("kind", ["ball", "ball along u", "twisted ball"])
def test_lane_widths_agree_over_steps(kind: str, preconditioner: str) -> None:
    found = []
    for width in (1, 8):
        body = Body(kind, POLAR[kind]((8, 10)), CLOTH, pressure=5.0, pins=(Pin([[0, 0]]),), drag=0.2)
        settings = replace(PRECISE, preconditioner=preconditioner)
        simulation = Simulation([body], wind=Wind((2.0, 1.0, 0.0)), settings=settings, lane_width=width)
        found.append(run(simulation, 4))
    for narrow, wide in zip(*found, strict=True):
        np.testing.assert_allclose(wide, narrow, atol=1e-7 * np.abs(narrow).max())


def test_free_ball_keeps_its_momentum_and_its_shape() -> None:
    body = Body("ball", sphere((8, 7), 0.4), CLOTH, velocity=(1.0, -2.0, 0.5))
    simulation = Simulation([body], settings=replace(PRECISE, gravity=(0.0, 0.0, 0.0)))
    for _ in range(4):
        simulation.step()
    np.testing.assert_allclose(simulation["ball"].velocities(), np.broadcast_to([1.0, -2.0, 0.5], (8, 7, 3)), atol=1e-9)
    assert simulation["ball"].max_stretch() == pytest.approx(1.0, abs=1e-9)


def test_wind_meets_both_halves_of_a_ball_alike() -> None:
    # Along its axis, and across: the air's force c (n.v) n adds up to c v times a third of the area, whatever the way.
    forces = []
    for direction in ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0)):
        body = Body("ball", sphere((48, 24), 0.5), CLOTH, wind_coefficient=2.0)
        settings = Settings(precision="float64", gravity=(0.0, 0.0, 0.0), device="cpu", fps=1e5)
        simulation = Simulation([body], wind=Wind(direction), settings=settings)
        simulation.step()
        handle = simulation["ball"]
        push = np.sum(handle.model.node_mass[..., None] * handle.velocities(), axis=(0, 1)) * 1e5
        forces.append(push @ direction)
        assert np.abs(push - forces[-1] * np.array(direction)).max() < 1e-9
    assert forces == pytest.approx([2.0 * 4 * np.pi * 0.25 / 3] * 2, rel=5e-3)
