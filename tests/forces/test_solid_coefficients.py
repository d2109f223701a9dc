"""K, edge weights and volumes of a solid against the energy of design 1.3, and what is no rest shape."""

from typing import Any

import numpy as np
import pytest
from solids import (
    CASES,
    MATERIALS,
    PAIRS,
    SHAPES,
    Block,
    Term,
    bent,
    box,
    crumpled,
    design_energy,
    leaning,
    mean_edges,
    solid_map,
)
from surfaces import noise

from warpdeform.errors import InputError
from warpdeform.forces.solid_coefficients import SolidStiffness, solid_stiffness
from warpdeform.grid import ParameterGrid
from warpdeform.material import Material

Array = np.ndarray[Any, Any]


def stiffness_of(shape: Block, material: Material, like: SolidStiffness | None = None) -> SolidStiffness:
    return solid_stiffness(shape.grid, shape.positions, material.solid(), like)


@pytest.mark.parametrize(("shape", "material"), CASES)
def test_coefficients_give_the_energy_of_the_design(shape: str, material: str) -> None:
    rest = SHAPES[shape]((3, 4, 3))
    solid, design = Term(rest, MATERIALS[material]), design_energy(rest, MATERIALS[material])
    for seed in range(3):
        z = rest.positions + noise(rest.positions, 0.3, seed)
        assert solid.energy(z) == pytest.approx(design.energy(z), rel=1e-12)


@pytest.mark.parametrize(
    ("shape", "material", "orthogonal", "uniform"),
    [
        ("box", "soft", True, True),
        ("graded", "soft", True, False),
        ("leaning", "soft", False, False),
        ("cylinder", "soft", False, False),
        ("bent", "paper", True, True),
    ],
)
def test_fast_variants_are_taken_where_they_suffice(shape: str, material: str, orthogonal: bool, uniform: bool) -> None:
    stiffness = stiffness_of(SHAPES[shape]((4, 5, 3)), MATERIALS[material])
    assert (stiffness.orthogonal, stiffness.uniform) == (orthogonal, uniform)
    assert (stiffness.edges is None) is orthogonal


def test_round_off_of_the_rest_shape_does_not_cost_the_fast_kernels() -> None:
    rest = box((8, 9, 7))
    noisy = Block(np.float32(rest.positions).astype(np.float64), rest.spacing)
    assert stiffness_of(noisy, MATERIALS["soft"]).uniform


def test_box_written_as_a_chart_has_the_same_energy() -> None:
    rest, other = box((3, 4, 3)), stiffness_of(leaning((3, 3, 3)), MATERIALS["rubber"])
    plain = Term(rest, MATERIALS["rubber"])
    general = Term(rest, MATERIALS["rubber"], like=other)
    z = crumpled(rest.positions)
    assert not general.stiffness.orthogonal
    assert general.energy(z) == pytest.approx(plain.energy(z), rel=1e-12)
    np.testing.assert_allclose(general.gradient(z), plain.gradient(z), atol=1e-12 * np.abs(plain.gradient(z)).max())


def test_energy_of_a_box_is_the_printed_formula() -> None:
    """Design 1.3, with slopes and differences of shear that vary along one axis in plane stress."""
    E, nu = 1e5, 0.3
    rest = box((2, 2, 2), (0.5, 0.4, 0.3))
    z = crumpled(rest.positions)
    mu, lame = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    sides = np.array([0.5, 0.4, 0.3])
    axes = [np.diff(z, axis=axis) for axis in range(3)]
    strain = [np.squeeze((np.sum(e**2, -1) / side**2 - 1) / 2) for e, side in zip(axes, sides, strict=True)]
    mean = np.array([s.mean() for s in strain])
    density = lame / 2 * mean.sum() ** 2 + mu * np.sum(mean**2)
    for i, j in PAIRS:
        k = 3 - i - j
        product = np.sum(axes[i].mean(axis=j, keepdims=True) * axes[j].mean(axis=i, keepdims=True), axis=-1)
        shear = np.squeeze(product) / 2 / (sides[i] * sides[j])
        # In the strains along axes i and j axis k is the first index if k comes before the other one that is left.
        si, sj = (np.diff(strain[a], axis=sorted({0, 1, 2} - {a}).index(k)).mean() / 2 for a in (i, j))
        difference = (shear[1] - shear[0]) / 2
        density += 2 * mu * (shear.mean() ** 2 + difference**2 / 3)
        density += E / (2 * (1 - nu**2)) * (si**2 + sj**2 + 2 * nu * si * sj) / 3
    density += E / 2 * sum((s[1, 1] - s[1, 0] - s[0, 1] + s[0, 0]) ** 2 / 16 for s in strain) / 9
    assert Term(rest, MATERIALS["soft"]).energy(z) == pytest.approx(float(np.prod(sides) * density), rel=1e-12)


@pytest.mark.parametrize("shape", ["box", "cylinder", "bent"])
def test_volumes_are_those_of_the_mean_edges(shape: str) -> None:
    rest = SHAPES[shape]((3, 4, 5))
    stiffness = stiffness_of(rest, MATERIALS["soft"])
    m = mean_edges(rest.positions)
    volume = np.abs(np.einsum("...a,...a->...", m[..., 0, :], np.cross(m[..., 1, :], m[..., 2, :])))
    np.testing.assert_allclose(stiffness.cell_volume, volume, rtol=1e-12)
    assert stiffness.node_volume.sum() == pytest.approx(volume.sum(), rel=1e-12)
    assert stiffness.node_volume[0, 0, 0] == pytest.approx(volume[0, 0, 0] / 8)


def test_volume_of_a_thick_cylinder_converges_with_second_order() -> None:
    exact = 0.8 * 0.6 * (0.9**2 - 0.5**2) / 2
    errors = [
        stiffness_of(SHAPES["cylinder"]((n, n, 3)), MATERIALS["soft"]).cell_volume.sum() / exact - 1 for n in (5, 9, 17)
    ]
    assert np.log2(np.abs(np.divide(errors[:-1], errors[1:]))).min() > 1.9


def test_ring_that_closes_has_as_many_cells_as_nodes_around() -> None:
    count = 12
    angle = 2 * np.pi * np.arange(count) / count
    positions = np.array([[[(r * np.cos(a), r * np.sin(a), z) for z in (0, 0.3)] for a in angle] for r in (0.5, 0.8)])
    grid = ParameterGrid((2, count, 2), (0.3, 2 * np.pi / count, 0.3), (False, True, False))
    stiffness = solid_stiffness(grid, positions, MATERIALS["soft"].solid())
    assert stiffness.cell_volume.shape == (1, count, 1)
    assert np.ptp(stiffness.cell_volume) < 1e-12
    assert stiffness.edges is not None
    assert np.count_nonzero(stiffness.edges[..., 1]) == 4 * count
    assert np.ptp(stiffness.node_volume) < 1e-12


def collapsed(corner: tuple[float, float, float]) -> Array:
    positions = box((3, 2, 2)).positions.copy()
    positions[2, 1, 1] = corner
    return positions


@pytest.mark.parametrize(
    ("positions", "problem"),
    [
        (box((3, 2, 2)).positions * [1.0, 1.0, 0.0], r"\[0, 0, 0\]: has a cell without volume"),
        (box((3, 2, 2)).positions[[0, 2, 1]], r"\[1, 0, 0\]: has a cell that is turned inside out"),
        (collapsed((1.0, 0.0, 0.9)), r"\[2, 0, 1\]: has an edge along v without length"),
    ],
    ids=["flat", "folded", "pole"],
)
def test_what_is_no_rest_shape_is_named(positions: Array, problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        stiffness_of(Block(positions, (1.0, 1.0, 1.0)), MATERIALS["soft"])


def test_left_handed_shapes_are_as_good_as_right_handed_ones() -> None:
    rest = bent((3, 3, 3))
    mirrored = Block(rest.positions * [1.0, 1.0, -1.0], rest.spacing)
    one, other = (stiffness_of(shape, MATERIALS["soft"]) for shape in (rest, mirrored))
    np.testing.assert_allclose(one.cells, other.cells, rtol=1e-12, atol=1e-12 * np.abs(one.cells).max())


@pytest.mark.parametrize(("nu", "count"), [(0.3, 6), (0.49, 6)])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("nodes", [(2, 2, 2), (3, 3, 3)], ids=str)
def test_six_motions_cost_nothing_and_no_other(nodes: tuple[int, int, int], shape: str, nu: float, count: int) -> None:
    rest = SHAPES[shape](nodes)
    solid = Term(rest, Material(density=1000.0, youngs_modulus=1e5, poisson_ratio=nu))
    solid.linearise(rest.positions)
    eigenvalues = np.linalg.eigvalsh(solid.dense())
    assert np.abs(eigenvalues[:count]).max() < 1e-13 * eigenvalues[-1]
    assert eigenvalues[count] > 1e-3 * eigenvalues[-1] * (1 - 2 * nu)


def test_paper_weights_have_no_cross_term() -> None:
    rest = solid_map(lambda u, v, w: np.stack([u, v, w], -1), (2, 2, 2), ((0, 0.5), (0, 0.4), (0, 0.3)))
    solid = Term(rest, MATERIALS["paper"])
    alone = [solid.energy(rest.positions * scale) for scale in ([1.2, 1, 1], [1, 1.3, 1], [1, 1, 0.8])]
    assert solid.energy(rest.positions * [1.2, 1.3, 0.8]) == pytest.approx(sum(alone), rel=1e-12)
    assert alone[0] == pytest.approx(0.5 * 0.4 * 0.3 * 5e4 / 4 * (1.2**2 - 1) ** 2, rel=1e-12)
