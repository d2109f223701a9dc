"""What steps ask of a surface beside Newton's: the force alone, a bound on its Hessian, the mean strains of a step."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import warp as wp
from surfaces import CLOSED, MATERIALS, REALS, SHAPES, STATES, WIDTHS, Surface, crumpled, noise, stretched

from warpdeform.material import Material
from warpdeform.shape import sheet

Array = np.ndarray[Any, Any]

EVERY_SHAPE = SHAPES | CLOSED
CASES = [
    ("flat", "membrane"), ("flat", "isotropic"), ("fan", "paper"), ("arc", "orthotropic"), ("fan", "membrane"),
    ("tube", "isotropic"), ("torus", "membrane"), ("parallelogram", "membrane"),
]  # fmt: skip
COUPLED = [("parallelogram", "isotropic"), ("screw", "shell")]


def force_alone(surface: Surface, z: Array) -> Array:
    """The gradient by `write_force`, everything that it should write poisoned before."""
    term, out = surface.force, surface.upload(np.zeros_like(z))
    for array in (term.flux, term.flexure, term.scatter):
        array.numpy()[:, 1 : 1 + len(z), surface.layout.halo : surface.layout.halo + z.shape[1]] = np.nan
    term.write_force(surface, surface.upload(z))
    fluxes = term.force_fluxes.of_rows(0, surface.layout.lane_dim[0])
    wp.launch(term._words.gather, dim=surface.layout.lane_dim, inputs=[fluxes, out], device="cpu")
    return surface.download(out)


@pytest.mark.parametrize(("shape", "material"), CASES)
@pytest.mark.parametrize("state", STATES.values(), ids=STATES)
def test_force_alone_is_the_gradient(shape: str, material: str, state: Callable[[Array], Array]) -> None:
    rest = EVERY_SHAPE[shape]((5, 11))
    z = state(rest.positions)
    found = []
    for width in WIDTHS[wp.float64]:
        surface = Surface(rest, MATERIALS[material], lane_width=width)
        gradient = surface.gradient(z)
        found.append(force_alone(surface, z))
        np.testing.assert_allclose(found[-1], gradient, atol=1e-13 * np.abs(gradient).max())
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize(("shape", "material"), CASES[:2])
def test_float32_force_alone_is_that_of_float64(shape: str, material: str) -> None:
    rest = EVERY_SHAPE[shape]((5, 19))
    z = stretched(rest.positions)
    exact = Surface(rest, MATERIALS[material]).gradient(z)
    narrow, wide = (
        force_alone(Surface(rest, MATERIALS[material], wp.float32, lane_width=width), z) for width in WIDTHS[wp.float32]
    )
    np.testing.assert_array_equal(narrow, wide)
    np.testing.assert_allclose(narrow, exact, atol=2e-5 * np.abs(exact).max())


@pytest.mark.parametrize(("shape", "material"), COUPLED)
def test_coupled_bending_has_no_force_alone(shape: str, material: str) -> None:
    assert Surface(EVERY_SHAPE[shape]((5, 7)), MATERIALS[material]).force.force_gathering is None


def majorant(surface: Surface, z: Array) -> Array:
    """The blocks that bound the Hessian at z, shape (nu, nv, 3, 3)."""
    surface.linearise(z)
    blocks = surface.upload(np.zeros((*surface.nodes, 6)))
    surface.force.add_majorant(surface, blocks)
    xx, yy, zz, xy, xz, yz = np.moveaxis(surface.download(blocks), -1, 0)
    return np.stack([np.stack(row, -1) for row in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))], -2)


def excess(surface: Surface, z: Array) -> float:
    """Largest eigenvalue of the Hessian in the measure of its bound: below 1 if it is one."""
    bound = majorant(surface, z)
    columns = [surface.product(p.reshape(z.shape)).ravel() for p in np.eye(z.size)]
    root = np.zeros((z.size, z.size))
    for k, block in enumerate(bound.reshape(-1, 3, 3)):
        values, vectors = np.linalg.eigh(block)
        root[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = vectors / np.sqrt(values)
    return float(np.linalg.eigvalsh(root.T @ np.array(columns) @ root).max())


@pytest.mark.parametrize(("shape", "material"), CASES + COUPLED)
@pytest.mark.parametrize("state", STATES.values(), ids=STATES)
def test_majorant_bounds_the_hessian(shape: str, material: str, state: Callable[[Array], Array]) -> None:
    rest = EVERY_SHAPE[shape]((5, 8))
    surface = Surface(rest, MATERIALS[material])
    assert 0.05 < excess(surface, state(rest.positions)) < 1.0 + 1e-12


@pytest.mark.parametrize("real", REALS)
def test_majorants_agree_across_widths(real: Any) -> None:
    rest = CLOSED["tube"]((5, 11))
    z = crumpled(rest.positions)
    narrow, wide = (
        majorant(Surface(rest, MATERIALS["isotropic"], real, lane_width=width), z) for width in WIDTHS[real]
    )
    np.testing.assert_array_equal(narrow, wide)


@pytest.mark.parametrize("bending", [0.0, 1e-5])
def test_majorant_of_cloth_is_near(bending: float) -> None:
    # Of a square cell the stiffest strain is the even one: 1 + nu times the one along an axis, which the mesh can have.
    material = Material(
        areal_density=0.2, membrane_stiffness=1000.0, poisson_ratio=0.3, bending_stiffness=bending or None
    )
    rest = sheet((13, 13))
    surface = Surface(rest, material)
    assert excess(surface, rest.positions) > 1.0 / 1.33
    assert excess(surface, rest.positions + noise(rest.positions, 0.05)) > 0.4


@pytest.mark.parametrize(("shape", "material"), [case for case in CASES if "membrane" in case[1]])
@pytest.mark.parametrize("width", [1, 8])
def test_mean_strains_do_exactly_the_work_that_energy_changes_by(shape: str, material: str, width: int) -> None:
    rest = EVERY_SHAPE[shape]((5, 11))
    surface = Surface(rest, MATERIALS[material], lane_width=width)
    assert surface.force.quadratic
    start = crumpled(rest.positions)
    end = start + noise(rest.positions, 0.5, 3)
    out = surface.upload(np.zeros_like(start))
    surface.force.linearise_mean(surface, surface.upload(0.5 * (start + end)), surface.upload(start))
    surface.force.add_gradient(surface, surface.upload(start), out)
    work, change = np.sum(surface.download(out) * (end - start)), surface.energy(end) - surface.energy(start)
    assert work == pytest.approx(change, rel=1e-12)
    assert abs(np.sum(surface.gradient(0.5 * (start + end)) * (end - start)) / change - 1.0) > 1e-3


def test_bending_is_not_quadratic() -> None:
    assert not Surface(sheet((5, 7)), MATERIALS["isotropic"]).force.quadratic
