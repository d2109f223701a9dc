"""Kernels of the elastic solid with arbitrary coefficients against NumPy: variants, lane widths and precisions."""

import functools
import itertools
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp
from solids import PAIRS, DiscreteEnergy, around, bent, cell_numbers, crumpled, edge_squares, face_products
from surfaces import REALS, WIDTHS, noise

from warpdeform.grid import Layout
from warpdeform.kernels.solid import NUMBER_COMPONENTS, TENSION_COMPONENTS, solid
from warpdeform.kernels.solid_blocks import solid_blocks
from warpdeform.kernels.solid_gather import FLUX_COMPONENTS, solid_gather

Array = np.ndarray[Any, Any]

NODES = [(2, 2, 2), (3, 2, 5), (4, 3, 18)]
VARIANTS = [(True, False), (True, True), (False, True)]
NAMES = ["orthogonal, all cells alike", "orthogonal", "general"]
SPACE, PLANE = 0.8, 0.4
"""Ratios of the general variant."""
UPPER = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]


def symmetric(entries: Array) -> Array:
    """Matrices (..., 3, 3) from 11, 12, 13, 22, 23, 33."""
    return entries[..., [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(*entries.shape[:-1], 3, 3)


def modes(q: Array) -> tuple[Array, Array, Array, Array]:
    """Sum, slopes along either of the two other axes, cross mode; edges at 00, 01, 10, 11 of them."""
    sign = np.array([-1.0, 1.0])
    q = q.reshape(*q.shape[:-1], 2, 2)
    return (
        q.sum(axis=(-2, -1)),
        np.einsum("...ab,a->...", q, sign),
        np.einsum("...ab,b->...", q, sign),
        np.einsum("...ab,a,b->...", q, sign, sign),
    )


def law_of(K: Array, t: Array | None) -> Callable[[Array], Array]:
    """The energy that K stands for, of squared lengths and m_i.m_j (whose q are a half and twice of them)."""

    def law(change: Array) -> Array:
        q, faces = change[..., :12] / 2, 2 * change[..., 12:].reshape(*change.shape[:-1], 3, 2)
        q = q if t is None else q * t
        parts = [modes(q[..., 4 * axis : 4 * axis + 4]) for axis in range(3)]
        sums = np.stack([parts[axis][0] for axis in range(3)], axis=-1)
        n = np.ones(3) if t is None else K[..., 6:9]
        shears, differences = n * faces.sum(axis=-1), n * (faces[..., 1] - faces[..., 0])
        energy = np.zeros(change.shape[:-1], dtype=change.dtype)
        for axis in range(3):
            weight = K[..., 12 + axis] if t is None else K[..., 15]
            energy += weight * parts[axis][3] ** 2 / 2
        if t is None:
            energy += np.einsum("...i,...ij,...j->...", sums, symmetric(K[..., :6]), sums) / 2
            energy += np.sum(K[..., 15:18] * shears**2 + K[..., 18:21] * differences**2, axis=-1) / 2
        else:
            E = symmetric(np.stack([sums[..., 0], *np.moveaxis(shears[..., :2], -1, 0), sums[..., 1], shears[..., 2],
                                    sums[..., 2]], axis=-1))  # fmt: skip
            mixed = symmetric(K[..., :6]) @ E
            energy += SPACE / 2 * np.einsum("...ii->...", mixed) ** 2
            energy += np.einsum("...ij,...ji->...", mixed, mixed) / 2
        for pair, (i, j) in enumerate(PAIRS):
            # The other axis comes first or second among the two others of i, of j.
            k = 3 - i - j
            a, b = (parts[axis][1 + (k > 3 - axis - k)] for axis in (i, j))
            if t is None:
                energy += (K[..., 6 + i] * a**2 + K[..., 6 + j] * b**2) / 2 + K[..., 9 + pair] * a * b
                continue
            c = K[..., 9 + pair]
            one = np.ones_like(c)
            G = np.linalg.inv(np.stack([one, c, c, one], -1).reshape(*c.shape, 2, 2))
            d = differences[..., pair]
            mixed = G @ np.stack([a, d, d, b], -1).reshape(*d.shape, 2, 2)
            factor = K[..., 12 + pair] * (1 - c**2) ** 2
            energy += factor * PLANE / 2 * np.einsum("...ii->...", mixed) ** 2
            energy += factor / 2 * np.einsum("...ij,...ji->...", mixed, mixed)
        return np.asarray(energy)

    return law


@functools.cache
def problem(nodes: tuple[int, int, int], orthogonal: bool, each: bool) -> SimpleNamespace:
    """Random coefficients and states, as an energy and as the arrays that the kernels read, shape (*nodes, n)."""
    random = np.random.default_rng(7)
    rest = bent(nodes).positions
    cells = tuple(n - 1 for n in nodes)
    shape = cells if each else ()
    root = random.normal(size=(*shape, 3, 3))
    sums = (root @ root.swapaxes(-1, -2) + 0.1 * np.eye(3))[..., [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    positive = random.uniform(0.5, 1.5, (*shape, 12))
    if orthogonal:
        K = np.concatenate(
            [sums, positive[..., :3], random.uniform(-0.4, 0.4, (*shape, 3)), positive[..., 3:]], axis=-1
        )
        t = None
    else:
        K = np.concatenate(
            [sums, positive[..., :3], random.uniform(-0.7, 0.7, (*shape, 3)), positive[..., 3:7]], axis=-1
        )
        t = np.where(edge_mask(nodes), random.uniform(0.5, 1.5, (*nodes, 3)), 0.0)
    per_cell = None if t is None else cell_weights(t)
    return SimpleNamespace(
        nodes=nodes,
        cells=cells,
        energy=DiscreteEnergy(rest, law_of(np.broadcast_to(K, (*cells, K.shape[-1])), per_cell)),
        rest=rest,
        z=crumpled(rest),
        p=noise(rest, 1.0, 9),
        K=K,
        t=t,
    )


def edge_mask(nodes: tuple[int, int, int]) -> Array:
    """Whether an edge along each axis begins at a node."""
    inside = [np.arange(n) < n - 1 for n in nodes]
    return np.stack(np.meshgrid(*inside, indexing="ij"), axis=-1)


def cell_weights(t: Array) -> Array:
    """t of the twelve edges of the cells, in the order of `cell_numbers`."""
    along = [np.take(t[..., axis], range(t.shape[axis] - 1), axis=axis) for axis in range(3)]
    return np.concatenate(
        [around(a, axis).reshape(*(n - 1 for n in t.shape[:3]), 4) for axis, a in enumerate(along)], -1
    )


@functools.cache
def run(nodes: tuple[int, int, int], orthogonal: bool, each: bool, real: Any, width: int) -> dict[str, Array]:
    """Every output of every kernel, shape (*nodes, n); outputs that are overwritten start as not a number."""
    given, layout = problem(nodes, orthogonal, each), Layout(nodes, width)
    kernels, diagonal = solid(width, real, orthogonal, False), solid_blocks(width, real, orthogonal, False)
    nodes_of, arrays = solid_gather(width, real), dict[str, wp.array]()
    rows = np.s_[layout.first_row : layout.rows - layout.first_row]

    def upload(values: Array) -> wp.array:
        return wp.array(values, dtype=real, device="cpu")

    def poisoned(name: str, components: int) -> wp.array:
        values = np.zeros((components, layout.rows, layout.columns))
        values[:, rows, layout.halo : -layout.halo] = np.nan
        arrays[name] = upload(values)
        return arrays[name]

    def added(name: str, components: int) -> wp.array:
        arrays[name] = upload(layout.pack(np.zeros((*nodes, components))))
        return arrays[name]

    def launch(kernel: Any, *inputs: Any) -> None:
        dim = (layout.rows - 2 * layout.first_row, layout.groups)
        wp.launch(kernel, dim=dim, inputs=[layout.first_row, *inputs], device="cpu")

    def gather(flux: wp.array, out: wp.array) -> None:
        fluxes = nodes_of.gathering.Fluxes()
        fluxes.flux, fluxes.stride = flux, wp.array([layout.stride], dtype=wp.int32, device="cpu")
        launch(nodes_of.gather, fluxes, out)

    u = layout.stride
    rest, z, p = (upload(layout.pack(values)) for values in (given.rest, given.z, given.p))
    share = upload(layout.pack(np.ones(given.cells)))
    K = upload(layout.pack(given.K) if each else np.repeat(given.K[:, None, None], width, axis=-1))
    none = upload(np.zeros((1, 1, 1)))
    t = none if given.t is None else upload(layout.pack(given.t))
    law = (share, K, t, real(SPACE), real(PLANE), int(each))
    q0 = poisoned("q0", NUMBER_COMPONENTS)
    launch(kernels.measure, u, rest, q0)
    launch(kernels.measure, u, z, poisoned("q", NUMBER_COMPONENTS))
    tension, flux = poisoned("tension", TENSION_COMPONENTS), poisoned("flux", FLUX_COMPONENTS)
    launch(kernels.stress_cells, u, z, q0, *law, none, tension, none, flux)
    gather(flux, added("gradient", 3))
    launch(kernels.product_cells, u, z, *law, tension, none, p, poisoned("product_flux", FLUX_COMPONENTS))
    gather(arrays["product_flux"], added("product", 3))
    launch(diagonal.block_nodes, u, z, *law, tension, none, added("blocks", 6))
    partials = wp.zeros((layout.rows, layout.columns), dtype=wp.float64, device="cpu")
    launch(kernels.energy_cells, u, z, q0, *law, none, partials)
    for name, array in arrays.items():
        values = array.numpy()
        assert np.isfinite(values).all(), name
        if name in ("gradient", "product", "blocks"):
            again = layout.pack(layout.unpack(values))
            np.testing.assert_array_equal(values, again, err_msg=f"{name} beside the nodes")
    found = {name: layout.unpack(array.numpy()) for name, array in arrays.items()}
    found["energy"] = partials.numpy().sum(keepdims=True)
    return found


@pytest.mark.parametrize("nodes", NODES[:2], ids=str)
@pytest.mark.parametrize(("orthogonal", "each"), VARIANTS, ids=NAMES)
def test_kernels_are_the_derivatives_of_their_energy(orthogonal: bool, each: bool, nodes: tuple[int, int, int]) -> None:
    given, found = problem(nodes, orthogonal, each), run(nodes, orthogonal, each, wp.float64, 1)
    z, energy = given.z, given.energy
    assert found["energy"] == pytest.approx(energy.energy(z), rel=1e-12)
    gradient, hessian = energy.gradient(z), energy.projected_hessian(z)
    np.testing.assert_allclose(found["gradient"], gradient, atol=1e-13 * np.abs(gradient).max())
    product = (hessian @ given.p.ravel()).reshape(z.shape)
    np.testing.assert_allclose(found["product"], product, atol=1e-13 * np.abs(product).max())
    count = int(np.prod(nodes))
    diagonal = np.einsum("ikil->ikl", hessian.reshape(count, 3, count, 3)).reshape(*nodes, 3, 3)
    blocks = diagonal[..., [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    np.testing.assert_allclose(found["blocks"], blocks, atol=1e-13 * np.abs(blocks).max())


def test_numbers_are_those_of_edges_and_faces() -> None:
    nodes = NODES[1]
    given, q = problem(nodes, True, True), run(nodes, True, True, wp.float64, 1)["q"]
    for axis, squares in enumerate(edge_squares(given.z)):
        inside = tuple(slice(n) for n in squares.shape)
        np.testing.assert_allclose(q[(*inside, axis)], squares / 2, rtol=1e-13)
    for pair, products in enumerate(face_products(given.z)):
        inside = tuple(slice(n) for n in products.shape)
        np.testing.assert_allclose(q[(*inside, 3 + pair)], 2 * products, rtol=1e-13, atol=1e-15)
    assert cell_numbers(given.z).shape == (*given.cells, 18)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("nodes", NODES, ids=str)
@pytest.mark.parametrize(("orthogonal", "each"), VARIANTS, ids=NAMES)
def test_lane_widths_agree_to_the_bit_and_precisions_to_round_off(
    orthogonal: bool, each: bool, nodes: tuple[int, int, int], real: Any
) -> None:
    narrow, wide = (run(nodes, orthogonal, each, real, width) for width in WIDTHS[real])
    exact = run(nodes, orthogonal, each, wp.float64, 1)
    for name, values in narrow.items():
        if name == "energy":
            assert wide[name] == pytest.approx(values, rel=1e-13)
        else:
            np.testing.assert_array_equal(values, wide[name], err_msg=name)
        if name in ("gradient", "product", "blocks", "energy") and real is wp.float32:
            np.testing.assert_allclose(values, exact[name], atol=1e-4 * np.abs(exact[name]).max(), err_msg=name)


def test_variants_are_modules_of_their_own() -> None:
    modules = [solid(1, wp.float64, *variant).module.name for variant in itertools.product((True, False), repeat=2)]
    assert modules[:2] == ["warpdeform_solid_orthogonal_barrier_float64_1", "warpdeform_solid_orthogonal_float64_1"]
    modules += [
        solid_blocks(1, wp.float64, *variant).module.name for variant in itertools.product((True, False), repeat=2)
    ]
    assert len(set(modules)) == 8
