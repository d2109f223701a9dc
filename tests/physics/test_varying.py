"""Bodies whose material varies: springs in a row, beams of two parts, a crease, and masses."""

from typing import Any

import numpy as np
import pytest
from physics.statics import orders, percent
from surfaces import Surface

from warpdeform.body import Body, Pin, Spring
from warpdeform.material import Material
from warpdeform.settings import Settings
from warpdeform.shape import block, line, sheet
from warpdeform.simulation import Simulation
from warpdeform.varying import Varying

Array = np.ndarray[Any, Any]
WEIGHTLESS = Settings(
    gravity=(0.0, 0.0, 0.0), integrator="implicit-euler", precision="float64", newton_iterations=0, device="cpu"
)


def deflection(surface: Surface, load: Array, axis: int, held: int = 2) -> Array:
    """Displacement along an axis under a load, the first rows of nodes held, linearised about rest."""
    surface.linearise(surface.rest)
    free = np.zeros(surface.rest.shape, dtype=bool)
    free[held:, :, axis] = True
    inside, unit = np.flatnonzero(free), np.eye(free.size)
    matrix = np.array([surface.product(unit[k].reshape(free.shape)).ravel()[inside] for k in inside])
    found = np.zeros(free.size)
    found[inside] = np.linalg.solve(matrix, load.ravel()[inside])
    return found.reshape(free.shape)[..., axis]


def test_parts_of_a_strip_stretch_as_springs_in_a_row() -> None:
    # Ten cells: seven of one stiffness, then three of another.
    stiffness = np.where(np.arange(10) < 7, 1000.0, 50.0)[:, None] * np.ones((1, 2))
    surface = Surface(
        sheet((11, 3), (1.0, 0.2)), Material(areal_density=1.0, membrane_stiffness=stiffness, poisson_ratio=0.0)
    )
    load = np.zeros((11, 3, 3))
    load[-1, :, 0] = [0.25, 0.5, 0.25]
    stretched = deflection(surface, load, axis=0, held=1)
    exact = np.concatenate([[0.0], np.cumsum(0.1 / stiffness[:, 0] / 0.2)])
    np.testing.assert_allclose(stretched, exact[:, None] * np.ones(3), atol=1e-12)


def test_a_cantilever_of_two_thicknesses_bends_as_two_beams() -> None:
    # Clamped between its first two rows: E I w'' = P (L - x), with one I up to a node and another beyond it. The
    # node itself bends as half of each: there the mean of 1/I counts.
    E, width, thick, thin, errors = 1e6, 0.1, 0.02, 0.01, []
    for cells in (20, 40):
        h, between = 1.0 / (cells - 0.5), (2 / (thick**-3 + thin**-3)) ** (1 / 3)
        along = np.sign(np.arange(cells + 1) - cells // 2)
        thickness = np.choose(along + 1, [thick, between, thin])[:, None] * np.ones(3)
        material = Material(density=1.0, youngs_modulus=E, poisson_ratio=0.0, thickness=thickness)
        surface = Surface(sheet((cells + 1, 3), (1.0 + h / 2, width)), material)
        load = np.zeros((cells + 1, 3, 3))
        load[-1, :, 2] = [0.25, 0.5, 0.25]
        found = deflection(surface, load, axis=2)[-1].mean()
        i1, i2, beyond = width * thick**3 / 12, width * thin**3 / 12, 1 - (cells / 2 - 0.5) * h
        errors.append(found * E / ((1 - beyond**3) / 3 / i1 + beyond**3 / 3 / i2) - 1)
    print(f"\ncantilever of two thicknesses: {percent(errors)}", end="")
    assert abs(errors[1]) < 0.002
    assert orders(errors)[0] > 1.8


def test_a_crease_one_node_wide_is_a_hinge() -> None:
    # Bending of the nodes on the crease: its spring constant per width is D / h.
    D, cells, soft = 1.0, 20, 1e-3
    h = 1.0 / cells
    stiffness = np.full((cells + 1, 3), D)
    stiffness[10] = soft * D
    material = Material(areal_density=1.0, membrane_stiffness=1e6, poisson_ratio=0.0, bending_stiffness=stiffness)
    creased = Surface(sheet((cells + 1, 3), (1.0, 0.2)), material)
    load = np.zeros((cells + 1, 3, 3))
    load[-1, :, 2] = [0.25, 0.5, 0.25]
    z = deflection(creased, load, axis=2)
    turn = (z[11] - z[10] - (z[10] - z[9])) / h
    moment = 1.0 * 0.5 / 0.2
    np.testing.assert_allclose(turn[1], moment * h / (soft * D), rtol=0.01)
    # Beside it the strip hardly bends.
    assert np.abs(np.diff(z, 2, axis=0)[np.arange(19) != 9]).max() < 0.01 * np.abs(turn * h).max()


def test_mass_is_where_the_material_is_heavy() -> None:
    material = Material(
        density=1000.0,
        youngs_modulus=1e6,
        poisson_ratio=0.3,
        thickness=lambda u, v: 1e-3 * (1 + u),
    )
    settings = Settings(device="cpu", preconditioner="multigrid", precision="float64", cg_tolerance=1e-8)
    simulation = Simulation([Body("hem", sheet((17, 9), (2.0, 1.0)), material)], settings=settings)
    mass = simulation["hem"].model.node_mass
    assert mass.sum() == pytest.approx(1000.0 * 1e-3 * 1.5 * 2.0, rel=1e-12)
    assert (np.diff(mass[1:-1, 4]) > 0).all()
    simulation.step()
    simulation.advance_frame()
    # In free fall nothing but gravity counts.
    np.testing.assert_allclose(np.ptp(simulation["hem"].velocities(), axis=(0, 1)), 0.0, atol=1e-5)


def test_a_bar_of_two_halves_stretches_as_springs_in_series() -> None:
    """A curve and a solid, the half at the pinned end ten times as stiff: F L/2 (1/k1 + 1/k2), F small."""
    along = np.where(np.arange(8) < 4, 10.0, 1.0)
    force = 0.01
    rod = Body(
        "rod",
        line((9,)),
        Material(linear_density=1.0, axial_stiffness=Varying(50.0 * along)),
        pins=(Pin("end:0"),),
        springs=(Spring([[8, 0]], force, point=(2.0, 0.0, 0.0)),),
        drag=20.0,
    )
    bar = Body(
        "bar",
        block((9, 2, 2), (1.0, 0.1, 0.1)),
        Material(density=100.0, youngs_modulus=Varying(np.broadcast_to(5e3 * along[:, None, None], (8, 1, 1))),
                 poisson_ratio=0.0),
        pins=(Pin("face:u,0"),),
        springs=(Spring("face:u,1", force / 4, point=(2.0, 0.05, 0.05)),),
        drag=20.0,
    )  # fmt: skip
    for body in (rod, bar):
        simulation = Simulation([body], settings=WEIGHTLESS)
        for _ in range(240):
            simulation.step()
        moved = float(np.mean(simulation[body.name].positions()[-1, ..., 0])) - 1.0
        assert moved == pytest.approx(force * 0.5 * (1.0 / 500.0 + 1.0 / 50.0), rel=2e-3)
    assert bar.density == 100.0


def test_mass_follows_a_density_that_varies() -> None:
    heavy = Varying(lambda u, *_: 100.0 * (1.0 + u))
    clay = Material(density=heavy, youngs_modulus=1e5, poisson_ratio=0.3)
    brick = Body("brick", block((5, 3, 4), (0.4, 0.2, 0.3)), clay)
    rope = Body("rope", line((5,), 0.4), Material(linear_density=heavy, axial_stiffness=1.0))
    for body, measure in ((brick, 0.4 * 0.2 * 0.3), (rope, 0.4)):
        mass = Simulation([body], settings=WEIGHTLESS)[body.name].model.node_mass
        assert mass.sum() == pytest.approx(150.0 * measure)
        assert mass[-1].sum() == pytest.approx(15.0 / 9.0 * mass[0].sum())
