"""Solids at rest: uniaxial and shear response, patches, beams and plates, the heavy elastica (design 1.6, 7.4)."""

from collections.abc import Callable
from itertools import product

import numpy as np
import pytest
from physics.statics import listed, orders, percent
from physics.test_cantilever import master_curve
from scipy.sparse.linalg import spsolve
from solids import Array, Block, Nodes, Term, box, equilibrium, leaning, mean_edges, stiffness_matrix

from warpdeform.material import Material

E = 1e6


def rubber(nu: float) -> Material:
    return Material(density=1000.0, youngs_modulus=E, poisson_ratio=nu)


def nominal_stress(F: Array, nu: float) -> Array:
    """First Piola-Kirchhoff stress of St. Venant-Kirchhoff's law."""
    mu, lame = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    strain = (F.T @ F - np.eye(3)) / 2
    return np.asarray(F @ (lame * np.trace(strain) * np.eye(3) + 2 * mu * strain))


def nodal_forces(rest: Block, stress: Array) -> Array:
    """What an even nominal stress does at the nodes of a block of equal parallelepipeds; nothing at inner ones."""
    m = mean_edges(rest.positions)[0, 0, 0]
    dual, volume = np.linalg.inv(m).T, abs(np.linalg.det(m))
    forces = np.zeros_like(rest.positions)
    for corner in product((0, 1), repeat=3):
        at = tuple(slice(c, n - 1 + c) for c, n in zip(corner, rest.nodes, strict=True))
        forces[at] += volume / 4 * stress @ ((2 * np.array(corner) - 1) @ dual)
    return forces


def spread(nodes: tuple[int, int]) -> Array:
    """Shares of a load across a section, which add up to 1."""
    weights = [np.where(np.isin(np.arange(n), (0, n - 1)), 0.5, 1.0) for n in nodes]
    return np.asarray(np.outer(*weights) / np.outer(*weights).sum())


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
@pytest.mark.parametrize("stretch", [0.7, 0.95, 1.3, 1.6])
def test_pulled_block_answers_as_the_law_says(stretch: float, nu: float) -> None:
    """P/E = lam (lam^2 - 1)/2 while the sides are free, at lam_t^2 = 1 - nu (lam^2 - 1) (design 1.6)."""
    lateral = 1 - nu * (stretch**2 - 1)
    rest = box((4, 3, 5), (1.0, 0.6, 0.8))
    force = Term(rest, rubber(nu)).gradient(rest.positions * [stretch, np.sqrt(lateral), np.sqrt(lateral)])
    pull = force[-1, ..., 0].sum() / (0.6 * 0.8)
    assert pull / E == pytest.approx(stretch * (stretch**2 - 1) / 2, rel=1e-9)
    assert np.abs(force[1:-1]).max() < 1e-9 * E
    assert np.abs(force[..., 1:]).max() < 1e-9 * E


def test_pressed_block_softens_from_a_stretch_of_one_over_root_three() -> None:
    rest = box((2, 2, 2), (1.0, 1.0, 1.0))
    solid = Term(rest, rubber(0.0))
    stress = [solid.gradient(rest.positions * [s, 1, 1])[-1, ..., 0].sum() / E for s in (0.5, 3**-0.5, 0.65)]
    assert stress[1] == pytest.approx(-(3**-1.5), rel=1e-12)
    assert min(stress) == stress[1]


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
@pytest.mark.parametrize("make", [box, leaning])
@pytest.mark.parametrize(
    "F",
    [
        np.array([[1.0, 0.4, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        np.array([[1.2, 0.3, -0.1], [0.1, 0.8, 0.2], [0.0, 0.3, 1.1]]),
    ],
    ids=["simple shear", "anything"],
)
def test_even_deformation_has_an_even_stress(make: Callable[[Nodes], Block], nu: float, F: Array) -> None:
    rest = make((4, 3, 5))
    force, expected = Term(rest, rubber(nu)).gradient(rest.positions @ F.T), nodal_forces(rest, nominal_stress(F, nu))
    assert np.abs(force - expected).max() < 1e-12 * np.abs(expected).max()
    assert np.abs(expected[1:-1, 1:-1, 1:-1]).max() < 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
@pytest.mark.parametrize("thick", [1, 3])
@pytest.mark.parametrize("degrees", [0.0, 45.0])
def test_plates_bend_and_twist_exactly_on_any_chart(degrees: float, thick: int, nu: float) -> None:
    """Energy of Kirchhoff's displacements of even curvature, one cell thick or more."""
    height = 0.05
    rest = box((5, 4, thick + 1), (1.0, 0.8, height))
    rest = Block(rest.positions + np.tan(np.radians(degrees)) * rest.positions[..., [1]] * [1, 0, 0], rest.spacing)
    x, y, z = np.moveaxis(rest.positions - [0, 0, height / 2], -1, 0)
    solid = Term(rest, rubber(nu))
    solid.linearise(rest.positions)
    for kx, ky, kxy in ((1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.3, -0.6, 0.8)):
        across = -nu / (1 - nu) * (kx + ky) * z**2 / 2
        bent = -(kx * x**2 + ky * y**2 + 2 * kxy * x * y) / 2
        p = np.stack([z * (kx * x + kxy * y), z * (ky * y + kxy * x), bent + across], axis=-1)
        rigidity = E * height**3 / (12 * (1 - nu**2))
        exact = 0.8 * rigidity / 2 * (kx**2 + ky**2 + 2 * nu * kx * ky + 2 * (1 - nu) * kxy**2)
        assert np.sum(p * solid.product(p)) / 2 == pytest.approx(exact, rel=1e-10)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
@pytest.mark.parametrize("section", [1, 2])
@pytest.mark.parametrize("lean", [0.0, 1.0])
def test_beams_bend_exactly_on_any_chart(lean: float, section: int, nu: float) -> None:
    """Energy of even bending with its anticlastic curvature: no shear and no volumetric locking."""
    rest = box((6, section + 1, section + 1), (1.0, 0.1, 0.1))
    rest = Block(rest.positions + lean * rest.positions[..., [1]] * [1, 0, 0], rest.spacing)
    x, y, z = np.moveaxis(rest.positions - [0, 0.05, 0.05], -1, 0)
    p = np.stack([x * z, -nu * y * z, -(x**2) / 2 - nu * (z**2 - y**2) / 2], axis=-1)
    solid = Term(rest, rubber(nu))
    solid.linearise(rest.positions)
    assert np.sum(p * solid.product(p)) / 2 == pytest.approx(E * 0.1**4 / 12 / 2, rel=1e-10)


def tip_over_timoshenko(cells: Nodes, nu: float, slenderness: float = 10.0) -> float:
    """Deflection under a small load across the end, over Timoshenko's with the shear factor of a square section.

    The clamp holds its section along the beam; across it, the reaction is spread as the load is, so that sections may
    contract as they do in the beam.
    """
    rest = box((cells[0] + 1, cells[1] + 1, cells[2] + 1), (slenderness, 1.0, 1.0))
    solid = Term(rest, rubber(nu))
    solid.linearise(rest.positions)
    free = np.ones((*rest.nodes, 3), dtype=bool)
    free[0, ..., 0] = False
    free[0, 0, [0, -1], 1] = free[0, 0, 0, 2] = False  # the rigid motions that are left
    load = np.zeros((*rest.nodes, 3))
    load[-1, ..., 2] = spread((rest.nodes[1], rest.nodes[2]))
    load[0, ..., 2] = -load[-1, ..., 2]
    inside, moved = np.flatnonzero(free), np.zeros(load.size)
    moved[inside] = spsolve(stiffness_matrix(solid)[inside][:, inside].tocsc(), load.ravel()[inside])
    deflection = np.sum(moved.reshape(load.shape) * load)
    shear = E / (2 * (1 + nu)) * 10 * (1 + nu) / (12 + 11 * nu)
    return float(deflection / (slenderness**3 / (3 * E / 12) + slenderness / shear))


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_cantilever_block_bends_as_timoshenko_says(nu: float) -> None:
    ratios = [tip_over_timoshenko(cells, nu) for cells in ((10, 1, 1), (20, 2, 2), (40, 4, 4))]
    print(f"\nblock cantilever nu {nu:g}, sections of 1, 2, 4 cells: errors of the tip", end=" ")
    print(percent(np.array(ratios) - 1, 2), end="")
    assert np.abs(np.array(ratios) - 1).max() < 0.006


def hang(cells: int, gamma: float, thickness: float = 0.02) -> Array:
    """Width W and height H of a heavy block of unit length, two by two cells thick, nu = 0, pinned at one end."""
    rest = box((cells + 1, 3, 3), (1.0, thickness, thickness))
    solid = Term(rest, rubber(0.0))
    load = np.zeros_like(rest.positions)
    weight = gamma * E * thickness**4 / 12
    load[..., 2] = -weight * solid.stiffness.node_volume / thickness**2
    free = np.ones((*rest.nodes, 3), dtype=bool)
    free[0] = False
    end = equilibrium(solid, load, free, rest.positions)[-1].mean((0, 1))
    return np.array([end[0], thickness / 2 - end[2]])


@pytest.mark.parametrize("gamma", [0.1, 1.0, 5.0, 20.0, 100.0])
def test_heavy_block_follows_the_elastica(gamma: float) -> None:
    width, height = hang(20, gamma)
    error = height / width / master_curve()[gamma]["H_over_W"] - 1
    print(f"\nblock cantilever Gamma {gamma:g}, 20 cells: H/W {height / width:.5f}, error {percent(error, 2)}", end="")
    assert abs(error) < 0.05


def test_heavy_block_converges_with_second_order() -> None:
    gamma, cells = 50.0, (10, 20, 40)
    ratios = np.array([h / w for w, h in (hang(count, gamma) for count in cells)])
    errors = ratios / master_curve()[gamma]["H_over_W"] - 1
    order = orders(np.diff(ratios))
    print(f"\nblock cantilever Gamma {gamma:g}, cells {cells}: errors {percent(errors, 2)}", end="")
    print(f"; order from the differences {listed(order)}", end="")
    assert order.min() > 1.8
    assert abs(errors[-1]) < 0.02
