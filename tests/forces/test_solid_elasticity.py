"""The elastic energy of a solid against design 1.3 in NumPy, finite differences, symmetries and worked examples."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import warp as wp
from solids import (
    AXES,
    CASES,
    GRIDS,
    MATERIALS,
    SHAPES,
    STATES,
    Block,
    Nodes,
    Term,
    bent,
    box,
    crumpled,
    design_energy,
    solid_map,
    squashed,
    stiffness_matrix,
)
from surfaces import REALS, WIDTHS, noise, spacing, turned

from warpdeform.kernels.solid_gather import FLUX_COMPONENTS
from warpdeform.tensors import Metric, metric_of

Array = np.ndarray[Any, Any]

SMALL = (3, 2, 4)
WITH_GRIDS = [
    (nodes, *case) for nodes in GRIDS for case in (("box", "soft"), ("bent", "rubber"), ("cylinder", "paper"))
]


def largest(a: Array) -> float:
    return float(np.abs(a).max())


@pytest.mark.parametrize(("shape", "material"), CASES)
@pytest.mark.parametrize("state", STATES.values(), ids=STATES)
def test_energy_gradient_hessian_and_blocks_are_those_of_the_design(
    shape: str, material: str, state: Callable[[Array], Array]
) -> None:
    rest = SHAPES[shape](SMALL)
    solid, design = Term(rest, MATERIALS[material]), design_energy(rest, MATERIALS[material])
    z = state(rest.positions)
    assert solid.energy(z) == pytest.approx(design.energy(z), rel=1e-13)
    gradient, hessian = design.gradient(z), design.projected_hessian(z)
    assert largest(solid.gradient(z) - gradient) < 1e-13 * largest(gradient)
    H = solid.dense()
    assert largest(H - hessian) < 1e-13 * largest(hessian)
    assert largest(H - H.T) < 1e-13 * largest(H)
    diagonal = np.einsum("ikil->ikl", H.reshape(24, 3, 24, 3)).reshape(*SMALL, 3, 3)
    assert largest(solid.blocks() - diagonal) < 1e-13 * largest(diagonal)
    assert np.linalg.eigvalsh(H).min() > -1e-13 * largest(H)


@pytest.mark.parametrize(("nodes", "shape", "material"), WITH_GRIDS)
@pytest.mark.parametrize("state", STATES.values(), ids=STATES)
def test_grids_of_any_size(nodes: Nodes, shape: str, material: str, state: Callable[[Array], Array]) -> None:
    rest = SHAPES[shape](nodes)
    solid, design = Term(rest, MATERIALS[material]), design_energy(rest, MATERIALS[material])
    z = state(rest.positions)
    gradient = solid.gradient(z)
    assert solid.energy(z) == pytest.approx(design.energy(z), rel=1e-12)
    directions = [noise(rest.positions, 1.0, seed) for seed in range(3)]
    products = [solid.product(p) for p in directions]
    for p, Hp in zip(directions, products, strict=True):
        scale = np.linalg.norm(gradient) * np.linalg.norm(p)
        assert abs(np.sum(gradient * p) - design.slope(z, p)) < 1e-13 * scale
        step = 1e-6
        slope = (solid.energy(z + step * p) - solid.energy(z - step * p)) / (2 * step)
        assert abs(np.sum(gradient * p) - slope) < 1e-7 * scale
        assert np.sum(p * Hp) > 0
    for p, Hp in zip(directions, products, strict=True):
        for q, Hq in zip(directions, products, strict=True):
            assert abs(np.sum(p * Hq) - np.sum(q * Hp)) < 1e-13 * np.linalg.norm(p) * np.linalg.norm(Hq)


@pytest.mark.parametrize(("shape", "material"), CASES)
def test_hessian_product_is_the_difference_of_the_gradient_at_rest(shape: str, material: str) -> None:
    rest = SHAPES[shape](SMALL)
    solid, step = Term(rest, MATERIALS[material]), 1e-5
    p = noise(rest.positions, 1.0)
    change = solid.gradient(rest.positions + step * p) - solid.gradient(rest.positions - step * p)
    solid.linearise(rest.positions)
    assert largest(solid.product(p) - change / (2 * step)) < 1e-6 * largest(solid.product(p))


def test_hessian_of_an_even_tension_is_exact() -> None:
    rest = box((4, 3, 5))
    solid, step = Term(rest, MATERIALS["soft"]), 1e-5
    z, p = rest.positions * [1.3, 1.1, 1.2], noise(rest.positions, 1.0)
    change = solid.gradient(z + step * p) - solid.gradient(z - step * p)
    solid.linearise(z)
    assert largest(solid.product(p) - change / (2 * step)) < 1e-8 * largest(solid.product(p))


def test_compression_is_left_out_of_the_hessian_and_kept_in_the_gradient() -> None:
    rest = box((9, 2, 2), (1.0, 0.05, 0.05))
    solid, step = Term(rest, MATERIALS["soft"]), 1e-5
    z = 0.8 * rest.positions
    p = np.zeros_like(z)
    p[..., 2] = np.sin(np.pi * rest.positions[..., 0])
    exact = (solid.gradient(z + step * p) - solid.gradient(z - step * p)) / (2 * step)
    solid.linearise(z)
    assert np.sum(p * exact) < 0  # the column buckles
    assert np.sum(p * solid.product(p)) > 0


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize(("shape", "material"), CASES)
def test_rigid_motions_give_no_force(shape: str, material: str, real: Any) -> None:
    rest = SHAPES[shape]((4, 3, 5))
    solid = Term(rest, MATERIALS[material], real)
    step = 1e-3 * spacing(rest.positions)
    scale = largest(solid.gradient(rest.positions + step * noise(rest.positions, 1.0))) / step
    epsilon = np.finfo(wp.dtype_to_numpy(real)).eps
    for angle in (0.0, 0.4, 2.5):
        z = turned(rest.positions, (1.0, -2.0, 0.5), angle) + np.array([0.3, -0.2, 0.5])
        assert largest(solid.gradient(z)) < 8 * epsilon * scale
        assert solid.energy(z) < 64 * epsilon**2 * scale


def test_rest_shapes_are_force_free_to_the_bit() -> None:
    for real in REALS:
        rest = bent((4, 3, 5))
        assert not Term(rest, MATERIALS["rubber"], real).gradient(rest.positions).any()


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("state", STATES.values(), ids=STATES)
@pytest.mark.parametrize(("shape", "material"), CASES)
def test_no_net_force_and_torque(shape: str, material: str, state: Callable[[Array], Array], real: Any) -> None:
    rest = SHAPES[shape]((4, 3, 5))
    solid = Term(rest, MATERIALS[material], real)
    z = state(rest.positions)
    force = solid.gradient(z).astype(np.float64)
    epsilon = np.finfo(wp.dtype_to_numpy(real)).eps
    assert largest(force.sum(AXES)) < 4 * epsilon * np.abs(force).sum()
    torque = np.cross(z, force)
    assert largest(torque.sum(AXES)) < 8 * epsilon * np.abs(force).sum() * np.linalg.norm(np.ptp(z, axis=AXES))
    solid.linearise(z)
    product = solid.product(noise(rest.positions, 1.0)).astype(np.float64)
    assert largest(product.sum(AXES)) < 4 * epsilon * np.abs(product).sum()


@pytest.mark.parametrize("real", REALS)
def test_lane_widths_agree_to_the_bit(real: Any) -> None:
    rest = bent((3, 4, 21))
    narrow, wide = (Term(rest, MATERIALS["rubber"], real, width) for width in WIDTHS[real])
    z, p = squashed(rest.positions), noise(rest.positions, 1.0, 4)
    np.testing.assert_array_equal(narrow.gradient(z), wide.gradient(z))
    np.testing.assert_array_equal(narrow.product(p), wide.product(p))
    np.testing.assert_array_equal(narrow.blocks(), wide.blocks())
    assert narrow.energy(z) == pytest.approx(wide.energy(z), rel=1e-13)


def turned_axes(rest: Block, order: tuple[int, int, int]) -> Block:
    spacings = rest.spacing
    return Block(rest.positions.transpose(*order, 3), (spacings[order[0]], spacings[order[1]], spacings[order[2]]))


@pytest.mark.parametrize("state", STATES.values(), ids=STATES)
@pytest.mark.parametrize("shape", ["box", "cylinder", "bent"])
def test_names_and_directions_of_the_axes_do_not_matter(shape: str, state: Callable[[Array], Array]) -> None:
    rest, of = SHAPES[shape]((4, 3, 5)), MATERIALS["soft"]
    z, flip = state(rest.positions), np.array([-1.0, 1.0, 1.0])
    gradient = Term(rest, of).gradient(z)
    tolerance = 1e-13 * largest(gradient)
    mirrored = Term(Block(rest.positions * flip, rest.spacing), of).gradient(z * flip)
    assert largest(mirrored * flip - gradient) < tolerance
    for axis in AXES:
        backwards = Term(Block(np.flip(rest.positions, axis), rest.spacing), of).gradient(np.flip(z, axis))
        assert largest(np.flip(backwards, axis) - gradient) < tolerance
    for order in ((1, 2, 0), (0, 2, 1)):
        other = Term(turned_axes(rest, order), of).gradient(z.transpose(*order, 3))
        assert largest(other - gradient.transpose(*order, 3)) < tolerance


@pytest.mark.parametrize("material", ["soft", "paper"])
@pytest.mark.parametrize("real", REALS)
def test_cells_without_volume_stay_finite(material: str, real: Any) -> None:
    rest = bent((4, 3, 5))
    solid = Term(rest, MATERIALS[material], real)
    gathered, flat = rest.positions.copy(), rest.positions * [1.0, 1.0, 0.0]
    gathered[1:3, 1:, 2:4] = gathered[1, 2, 2]
    for z in (gathered, flat, 0 * rest.positions):
        assert np.isfinite(solid.energy(z))
        assert np.isfinite(solid.gradient(z)).all()
        assert np.isfinite(solid.product(noise(rest.positions, 1.0))).all()
        assert np.isfinite(solid.blocks()).all()


def test_gradients_and_products_add_to_what_is_there() -> None:
    rest = bent(SMALL)
    solid = Term(rest, MATERIALS["soft"])
    z, before = crumpled(rest.positions), noise(rest.positions, 1.0, 5)
    alone = solid.gradient(z)
    out = solid.upload(before)
    solid.force.add_gradient(None, solid.position, out)
    np.testing.assert_allclose(solid.download(out), before + alone, rtol=1e-15, atol=1e-13 * largest(alone))
    product = solid.product(before)
    out = solid.upload(before)
    solid.force.add_hessian_product(None, solid.upload(before), out)
    np.testing.assert_allclose(solid.download(out), before + product, rtol=1e-15, atol=1e-13 * largest(product))


def test_sparse_matrix_of_the_tests_is_the_dense_one() -> None:
    for nodes in ((2, 3, 5), (4, 2, 3)):
        rest = bent(nodes)
        solid = Term(rest, MATERIALS["soft"])
        solid.linearise(crumpled(rest.positions))
        np.testing.assert_array_equal(stiffness_matrix(solid).toarray(), solid.dense())


@pytest.mark.parametrize(("shape", "material"), [("box", "soft"), ("bent", "soft")])
def test_named_kernels_are_those_that_are_launched(shape: str, material: str, monkeypatch: pytest.MonkeyPatch) -> None:
    solid = Term(SHAPES[shape](SMALL), MATERIALS[material])
    launched: set[str] = set()
    launch = solid.force._launch

    def recorded(kernel: wp.Kernel, *arguments: Any) -> None:
        launched.add(f"{kernel.module.name.removeprefix('warpdeform_')}.{kernel.func.__name__}")
        launch(kernel, *arguments)

    monkeypatch.setattr(solid.force, "_launch", recorded)
    z = crumpled(solid.rest)
    solid.energy(z)
    solid.gradient(z)
    solid.product(z)
    solid.blocks()
    partials = wp.zeros((solid.layout.rows, solid.layout.columns), dtype=wp.float64, device="cpu")
    solid.force.forbid_start(None, solid.upload(solid.rest), solid.upload(z), partials)  # type: ignore[arg-type]
    named = solid.force.kernels
    assert len(set(named)) == len(named) == len(launched)
    for room, kernel in (name.split(".") for name in named):
        assert any(name.startswith(room) and name.endswith(f".{kernel}") for name in launched)


def test_memory_is_bounded_by_what_the_variants_need() -> None:
    plain, general = (Term(SHAPES[shape]((9, 9, 16)), MATERIALS["soft"], lane_width=8) for shape in ("box", "bent"))
    place = 8 * plain.layout.rows * plain.layout.columns
    assert plain.force.bytes() < (2 * 6 + FLUX_COMPONENTS + 1.1) * place
    assert general.force.bytes() - plain.force.bytes() < (16 + 3) * place
    assert plain.force.sample_nodes == 8
    assert plain.force.elastic
    assert plain.force.energy_kind == "elastic"


def measured(rest: Block) -> Metric:
    """G from the numbers that the energy measures, which are those of the metric that handles give."""
    solid = Term(rest, MATERIALS["soft"])
    q: wp.array = wp.zeros_like(solid.force.q0)
    solid.force.measure(solid.upload(rest.positions), q)
    numbers, metric = solid.download(q), metric_of(rest.grid, rest.positions)
    for n, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))):
        G = getattr(metric, f"G{i + 1}{j + 1}")
        inside = tuple(slice(count) for count in G.shape)
        half = 2.0 if i == j else 0.5
        found = half * numbers[(*inside, n)] / (rest.spacing[i] * rest.spacing[j])
        np.testing.assert_allclose(found, G, rtol=1e-12, atol=1e-12)
    return metric


def test_metric_of_the_unit_cube_is_the_identity() -> None:
    metric = measured(solid_map(lambda x, y, z: np.stack([x, y, z], -1), (4, 5, 3), ((0, 1),) * 3))
    for name in ("G11", "G22", "G33"):
        np.testing.assert_allclose(getattr(metric, name), 1.0, rtol=1e-14)
    for name in ("G12", "G13", "G23"):
        np.testing.assert_allclose(getattr(metric, name), 0.0, atol=1e-14)
    assert (metric.G11.shape, metric.G23.shape) == ((3, 5, 3), (4, 4, 2))


def test_metric_of_a_thick_cylinder_is_that_of_cylindrical_coordinates() -> None:
    """G = diag(1, rho^2, 1); chords make G22 smaller by the order of the scheme, two."""
    errors = []
    for n in (5, 9, 17):
        metric, rho = measured(SHAPES["cylinder"]((4, n, 3))), np.linspace(0.5, 0.9, 4)
        for name in ("G11", "G33"):
            np.testing.assert_allclose(getattr(metric, name), 1.0, rtol=1e-12)
        for name in ("G12", "G13", "G23"):
            np.testing.assert_allclose(getattr(metric, name), 0.0, atol=1e-12)
        relative = metric.G22 / rho[:, None, None] ** 2 - 1
        assert np.ptp(relative) < 1e-12
        errors.append(float(relative.mean()))
    assert np.log2(np.divide(errors[:-1], errors[1:])).min() > 1.98


def test_metric_of_a_leaning_block_has_its_products() -> None:
    lean = np.array([[1.0, 0.0, 0.0], [0.4, 0.8, 0.0], [-0.3, 0.5, 0.9]])
    rest = SHAPES["leaning"]((3, 4, 5))
    metric, G = measured(rest), lean @ lean.T
    for name in ("G11", "G22", "G33", "G12", "G13", "G23"):
        i, j = (int(k) - 1 for k in name[1:])
        np.testing.assert_allclose(getattr(metric, name), G[i, j], rtol=1e-12)
