"""Solids that grow and bend, in motion."""

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
from warpdeform.settings import Settings
from warpdeform.shape import block
from warpdeform.simulation import Simulation

Array = np.ndarray[Any, Any]

STILL = Settings(
    integrator="implicit-euler", fps=1.0, newton_iterations=0, newton_tolerance=1e-9, cg_tolerance=1e-6,
    cg_iterations=5000, precision="float64", device="cpu", gravity=(0.0, 0.0, 0.0),
)  # fmt: skip
JELLY = Material(density=1000.0, youngs_modulus=1e5, poisson_ratio=0.3)
FIRM = replace(JELLY, inversion_barrier=5e4)


def settled(body: Body, steps: int, **settings: Any) -> Simulation:
    simulation = Simulation([body], settings=replace(STILL, **settings))
    for _ in range(steps):
        simulation.step()
    return simulation


@pytest.mark.parametrize("preconditioner", ["block-jacobi", "multigrid"])
@pytest.mark.parametrize("material", [JELLY, FIRM], ids=["jelly", "firm"])
def test_a_block_that_grew_along_one_axis_is_longer_and_at_rest(material: Material, preconditioner: str) -> None:
    growth = Growth([0.0, 3.0], [[1.0, 1.0, 1.0], [1.0, 1.2, 1.0]])
    body = Body("jelly", block((6, 7, 5), (0.3, 0.4, 0.2)), material, growth=growth)
    simulation = settled(body, 8, preconditioner=preconditioner)
    jelly = simulation["jelly"]
    middle = (0, 1, 2)
    found = jelly.positions() - jelly.positions().mean(axis=middle)
    rest = body.shape.positions - body.shape.positions.mean(axis=middle)
    np.testing.assert_allclose(found, rest * [1.0, 1.2, 1.0], atol=1e-7)
    assert jelly.max_stretch() == pytest.approx(1.0, abs=1e-7)
    assert simulation.record().energy.elastic < 1e-9
    assert np.abs(elastic_forces(jelly)).max() < 1e-4


def test_a_beam_that_grows_on_one_side_bends_as_a_bimetal_does() -> None:
    # Strain 0 below and e above: curvature e over the thickness, whatever the material.
    strain, thickness = 0.02, 0.1
    growth = Growth([0.0, 40.0], [[1.0, 1.0, 1.0], [1.0 + strain, 1.0, 1.0]], where=lambda u, v, w: w)
    body = Body("strip", block((33, 2, 3), (1.0, 0.1, thickness)), replace(JELLY, poisson_ratio=0.0), growth=growth)
    strip = settled(body, 12, fps=0.1, newton_tolerance=1e-10)["strip"].positions()
    along = strip[:, 0, 1][:, [0, 2]]
    centre = np.linalg.lstsq(np.column_stack([2 * along, np.ones(len(along))]), np.sum(along**2, axis=1), rcond=None)[0]
    found = np.linalg.norm(along - centre[:2], axis=1)
    wanted = thickness * (1 + strain / 2) / strain
    print(f"\nbend of a beam grown on one side: radius {found.mean():.4f} m, wanted {wanted:.4f} m", end="")
    np.testing.assert_allclose(found, wanted, rtol=1e-4)
    assert centre[1] < along[:, 1].min()


@pytest.mark.parametrize("settings", [{"threads": 1}, {"threads": 2}, {"captured": False}], ids=str)
def test_nothing_of_it_is_frozen_in_graphs(settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launching, "SHARED_FROM", 0)
    growth = Growth([0.02, 0.1], [[1.0, 1.0, 1.0], [0.8, 1.1, 1.0]])

    def made(growth: Growth | None, **options: Any) -> Simulation:
        captured = options.pop("captured", True)
        body = Body("jelly", block((6, 5, 5)), JELLY, pins=(Pin("face:w,0"),), growth=growth)
        solver = replace(REAL_TIME, preconditioner="multigrid", **options)
        return Simulation([body], settings=solver, captured=captured)

    simulation = made(growth, **settings)
    found = run(simulation, 6)
    assert_same_bits(found, run(made(growth, threads=1), 6))
    simulation.reset()
    assert_same_bits(run(simulation, 6), found)
    assert np.abs(run(made(None), 6)[0] - found[0]).max() > 0.01


@pytest.mark.parametrize("integrator", ["verlet", "energy-momentum"])
def test_other_methods_see_it_too(integrator: str) -> None:
    growth = Growth([0.0, 0.3], [[1.0, 1.0, 1.0], [1.0, 1.0, 1.2]])
    body = Body(
        "jelly", block((4, 4, 4), (0.3, 0.3, 0.3)), replace(JELLY, youngs_modulus=2e4), growth=growth, drag=20.0
    )
    simulation = Simulation([body], settings=replace(PRECISE, integrator=integrator, gravity=(0.0, 0.0, 0.0)))
    for _ in range(90):
        simulation.advance_frame()
    size = np.ptp(simulation["jelly"].positions(), axis=(0, 1, 2))
    np.testing.assert_allclose(size, [0.3, 0.3, 0.36], rtol=1e-3)
