"""K, bending weights, areas and floors of a surface against the energy that design 1.3 prints."""

import functools
from typing import Any

import numpy as np
import pytest
from surface_energy import design_energy, existing, mean_edges, membrane_numbers, node_weights
from surfaces import CASES, GRIDS, MATERIALS, SHAPES, parallelogram

from warpdeform.errors import InputError
from warpdeform.forces.surface_coefficients import SurfaceStiffness, surface_stiffness
from warpdeform.grid import ParameterGrid
from warpdeform.material import Material
from warpdeform.shape import RestShape, from_array, sheet

Array = np.ndarray[Any, Any]

NUMBERS_FROM_Q = (
    np.array([[1, 1, 0, -1, -1], [1, 1, 0, 1, 1], [1, -1, 0, -1, 1], [1, -1, 0, 1, -1], [0, 0, 1, 0, 0]]) / 2
)
"""Squared lengths of the two u-edges and the two v-edges, and m1.m2, from q = (s, t, c, u, v)."""


def stiffness_of(shape: RestShape, material: Material) -> SurfaceStiffness:
    at_cells, at_nodes = material.surface(shape.grid), material.surface(shape.grid, at="nodes")
    return surface_stiffness(shape.grid, shape.positions, at_cells, at_nodes=at_nodes)


def full(stiffness: SurfaceStiffness) -> Array:
    """K with all its entries, shape (nu - 1, nv - 1, 5, 5)."""
    k = np.moveaxis(stiffness.membrane, -1, 0)
    K = np.zeros((*stiffness.cell_area.shape, 5, 5))
    if stiffness.orthogonal:
        K[..., 0, 0], K[..., 0, 1], K[..., 1, 1], K[..., 2, 2], K[..., 3, 3], K[..., 3, 4] = k
        K[..., 4, 4] = K[..., 3, 3]
    else:
        for entry, (a, b) in zip(k, np.argwhere(np.triu(np.ones((5, 5)))), strict=True):
            K[..., a, b] = entry
    return K + np.triu(K, 1).swapaxes(-1, -2)


@pytest.mark.parametrize("nodes", GRIDS, ids=str)
@pytest.mark.parametrize(("shape", "material"), CASES)
def test_coefficients_give_the_energy_of_the_design(shape: str, material: str, nodes: tuple[int, int]) -> None:
    rest = SHAPES[shape](nodes)
    design, stiffness = design_energy(rest, MATERIALS[material]), stiffness_of(rest, MATERIALS[material])
    K = full(stiffness)
    scale = float(np.mean(membrane_numbers(rest.positions)[..., :4]))
    q = scale * np.random.default_rng(2).normal(size=(*K.shape[:2], 5))
    expected = design.membrane(q @ NUMBERS_FROM_Q.T)
    np.testing.assert_allclose(np.einsum("...a,...ab,...b->...", q, K, q) / 2, expected, rtol=1e-12)
    assert np.linalg.eigvalsh(K).min() > 0
    if stiffness.bending is None or stiffness.twist is None:
        assert stiffness.bending is stiffness.twist is stiffness.coupling is None
        assert not design.bending.any()
        assert not design.corners.any()
    elif stiffness.coupling is None:
        assert not design.corners.any()
        inside = [np.isin(np.arange(n), (0, n - 1), invert=True) for n in nodes]
        in_u, in_v = np.meshgrid(*inside, indexing="ij")
        weights = design.bending[..., [0, 0, 1], [0, 1, 1]] * np.stack([in_u, in_u & in_v, in_v], axis=-1)
        np.testing.assert_allclose(stiffness.bending, weights, rtol=1e-12)
        np.testing.assert_allclose(stiffness.twist, np.broadcast_to(design.twist, stiffness.twist.shape), rtol=1e-12)
    else:
        scale = np.abs(design.corners).max()
        nodal, mixed = node_weights(design.corners, rest.nodes), design.corners[..., :2, 2].swapaxes(-1, -2)
        assert_close = functools.partial(np.testing.assert_allclose, rtol=1e-12, atol=1e-12 * scale)
        assert_close(stiffness.bending, nodal[..., [0, 0, 1], [0, 1, 1]])
        assert_close(stiffness.twist, design.corners[..., 2, 2].sum(axis=-1))
        assert_close(stiffness.coupling, mixed.reshape(stiffness.coupling.shape))
    area = np.linalg.norm(np.cross(*mean_edges(rest.positions)), axis=-1)
    np.testing.assert_allclose(stiffness.cell_area, area, rtol=1e-12)
    assert stiffness.node_area.sum() == pytest.approx(area.sum(), rel=1e-12)
    assert 0 < stiffness.cell_floor < 1e-5 * np.min(area**2)
    assert 0 < stiffness.node_floor < 1e-5 * np.max(area**2)


@pytest.mark.parametrize(
    ("shape", "material", "orthogonal"),
    [
        ("flat", "orthotropic", True),
        ("arc", "isotropic", True),
        ("fan", "isotropic", False),
        ("fan", "paper", True),
        ("parallelogram", "membrane", False),
    ],
)
def test_six_entries_only_where_six_suffice(shape: str, material: str, orthogonal: bool) -> None:
    assert stiffness_of(SHAPES[shape]((6, 9)), MATERIALS[material]).orthogonal is orthogonal


def test_round_off_of_the_rest_shape_does_not_cost_the_fast_kernels() -> None:
    rest = sheet((50, 70), (1.0, 1.3)).positions + 1e-15 * np.random.default_rng(0).normal(size=(50, 70, 3))
    stiffness = stiffness_of(from_array(rest), MATERIALS["orthotropic"])
    assert stiffness.orthogonal
    assert stiffness.coupling is None


@pytest.mark.parametrize(
    ("shape", "material", "coupled"),
    [
        ("flat", "orthotropic", False),
        ("arc", "isotropic", False),
        ("fan", "isotropic", False),
        ("bump", "isotropic", True),
        ("parallelogram", "shell", True),
        ("parallelogram", "paper", False),
        ("parallelogram", "membrane", False),
    ],
)
def test_skew_couples_curvatures_and_the_papers_weights_do_not(shape: str, material: str, coupled: bool) -> None:
    assert (stiffness_of(SHAPES[shape]((6, 9)), MATERIALS[material]).coupling is not None) is coupled


@pytest.mark.parametrize("degrees", [-70.0, 5.0, 45.0])
def test_coupled_bending_is_the_printed_formula(degrees: float) -> None:
    nu, E, h = 0.3, 1e6, 0.2
    rest = parallelogram((5, 6), degrees)
    D = E * h**3 / (12 * (1 - nu**2))
    m1, m2 = (m[0, 0] for m in mean_edges(rest.positions))
    G = np.array([[m1 @ m1, m1 @ m2], [m1 @ m2, m2 @ m2]])
    raised = [np.linalg.solve(G, T) for T in ([[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 1], [1, 0]])]
    C = [[D * (nu * np.trace(a) * np.trace(b) + (1 - nu) * np.trace(a @ b)) for b in raised] for a in raised]
    C = np.sqrt(np.linalg.det(G)) / 4 * np.array(C)
    stiffness = stiffness_of(rest, MATERIALS["isotropic"])
    assert stiffness.bending is not None
    assert stiffness.twist is not None
    assert stiffness.coupling is not None
    np.testing.assert_allclose(stiffness.bending[2, 2], 4 * C[[0, 0, 1], [0, 1, 1]], rtol=1e-11)
    np.testing.assert_allclose(stiffness.twist[1, 1], 4 * C[2, 2], rtol=1e-11)
    np.testing.assert_allclose(stiffness.coupling[1, 1], [C[0, 2]] * 4 + [C[1, 2]] * 4, rtol=1e-11)


@pytest.mark.parametrize("multipliers", [(1.0, 0.0), (0.0, 1.0), (2.0, 0.5)])
@pytest.mark.parametrize("nodes", [(3, 3), (4, 5)], ids=str)
def test_every_corner_of_a_skewed_chart_stores_energy_or_none(
    nodes: tuple[int, int], multipliers: tuple[float, float]
) -> None:
    material = Material(
        density=800.0, youngs_modulus=1e6, poisson_ratio=0.3, thickness=0.1, bending_multipliers=multipliers
    )
    rest = parallelogram(nodes, 50.0)
    stiffness, design = stiffness_of(rest, material), design_energy(rest, material)
    assert stiffness.bending is not None
    assert stiffness.coupling is not None
    scale = np.abs(design.corners).max()
    assert np.linalg.eigvalsh(design.corners).min() > -1e-12 * scale
    nodal = node_weights(design.corners, rest.nodes)
    np.testing.assert_allclose(stiffness.bending, nodal[..., [0, 0, 1], [0, 1, 1]], atol=1e-12 * scale)
    np.testing.assert_allclose(stiffness.twist, design.corners[..., 2, 2].sum(axis=-1), atol=1e-12 * scale)
    exists = existing(nodes)
    assert not stiffness.coupling.reshape(*exists.shape[:2], 2, 4).swapaxes(-1, -2)[~exists[..., :2]].any()


@pytest.mark.parametrize("corner", [(4.0, 0.0, 0.0), (1.0, 0.0, 0.0)], ids=["in one line", "bow tie"])
def test_cell_without_area_is_named(corner: tuple[float, float, float]) -> None:
    rest = np.array([[(0, 0, 0), (1, 0, 0)], [(2, 0, 0), corner]], dtype=np.float64)
    with pytest.raises(InputError, match=r"\[0, 0\]: has a cell without area"):
        surface_stiffness(ParameterGrid((2, 2), (1.0, 1.0)), rest, MATERIALS["membrane"].surface())


def test_material_that_bends_one_way_only() -> None:
    material = Material(
        density=800.0, youngs_modulus=1e6, poisson_ratio=0.3, thickness=0.01, bending_multipliers=(1.0, 0.0)
    )
    stiffness = stiffness_of(sheet((5, 6)), material)
    assert stiffness.bending is not None
    assert stiffness.twist is not None
    assert np.isfinite(stiffness.bending).all()
    assert stiffness.bending[1:-1, :, 0].min() > 0
    assert not stiffness.bending[..., 1:].any()
    assert not stiffness.twist.any()
