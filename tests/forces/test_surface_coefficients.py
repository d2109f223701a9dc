"""K, bending weights, areas and floors of a surface against the energy that design 1.3 prints."""

from typing import Any

import numpy as np
import pytest
from surfaces import CASES, GRIDS, MATERIALS, SHAPES, design_energy, mean_edges, membrane_numbers, parallelogram

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
    return surface_stiffness(ParameterGrid(shape.nodes, shape.spacing), shape.positions, material.surface())


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
        assert stiffness.bending is stiffness.twist is None
        assert not design.bending.any()
    else:
        inside = [np.isin(np.arange(n), (0, n - 1), invert=True) for n in nodes]
        in_u, in_v = np.meshgrid(*inside, indexing="ij")
        weights = design.bending[..., [0, 0, 1], [0, 1, 1]] * np.stack([in_u, in_u & in_v, in_v], axis=-1)
        np.testing.assert_allclose(stiffness.bending, weights, rtol=1e-12)
        np.testing.assert_allclose(stiffness.twist, np.broadcast_to(design.twist, stiffness.twist.shape), rtol=1e-12)
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
    assert stiffness_of(from_array(rest), MATERIALS["orthotropic"]).orthogonal


def test_bending_refuses_a_skewed_chart_and_names_the_angle() -> None:
    with pytest.raises(InputError, match=r"shape = 60.0: .*between the axes.*orthogonal axes, or a material without"):
        stiffness_of(parallelogram((4, 5), 30.0), MATERIALS["isotropic"])
    with pytest.raises(InputError, match="between the axes"):
        stiffness_of(parallelogram((4, 5), 30.0), MATERIALS["paper"])
    assert stiffness_of(parallelogram((4, 5), 5.0), MATERIALS["isotropic"]).bending is not None
    assert stiffness_of(parallelogram((4, 5), 60.0), MATERIALS["membrane"]).bending is None


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
