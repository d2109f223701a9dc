"""Kernels of the elastic surface with arbitrary coefficients against NumPy: every variant, lane width and precision."""

import functools
import itertools
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp
from surface_energy import DiscreteEnergy, bending_numbers, existing, membrane_numbers, node_weights
from surfaces import GRIDS, REALS, WIDTHS, bump, crumpled, noise

from warpdeform.forces.surface_bending import difference_weights
from warpdeform.grid import Layout
from warpdeform.kernels.surface import (
    FLEXURE_COMPONENTS,
    SCATTER_COMPONENTS,
    TENSION_COMPONENTS,
    TWIST_COMPONENTS,
    surface,
)
from warpdeform.kernels.surface_blocks import surface_blocks
from warpdeform.kernels.surface_coupling import CHANGE_COMPONENTS, COUPLING_KERNELS, surface_coupling
from warpdeform.launching import RowStruct

Array = np.ndarray[Any, Any]

VARIANTS = list(itertools.product((True, False), ("none", "plain", "coupled")))
NAMES = [("orthogonal" if orthogonal else "general") + f"-bending-{bending}" for orthogonal, bending in VARIANTS]
Q_FROM_NUMBERS = (
    np.array([[1, 1, 1, 1, 0], [1, 1, -1, -1, 0], [0, 0, 0, 0, 4], [-1, 1, -1, 1, 0], [-1, 1, 1, -1, 0]]) / 2
)
"""q = (s, t, c, u, v) from the squared lengths of the two u-edges and the two v-edges, and m1.m2."""


@functools.cache
def problem(nodes: tuple[int, int], orthogonal: bool, bending: str) -> SimpleNamespace:
    """Random coefficients and states, as an energy and as the arrays that the kernels read, shape (nu, nv, n)."""
    random = np.random.default_rng(7)
    rest = bump(nodes).positions
    cells = (nodes[0] - 1, nodes[1] - 1)

    def definite(*shape: int) -> Array:
        root = random.normal(size=(*shape, shape[-1]))
        return root @ root.swapaxes(-1, -2) + 0.1 * np.eye(shape[-1])

    K = definite(*cells, 5)
    if orthogonal:
        K[..., 4, 4] = K[..., 3, 3]
        kept = np.zeros((5, 5))
        kept[:2, :2], kept[2, 2], kept[3:, 3:] = 1, 1, 1
        K *= kept
        entries = [K[..., a, b] for a, b in ((0, 0), (0, 1), (1, 1), (2, 2), (3, 3), (3, 4))]
    else:
        entries = [K[..., a, b] for a in range(5) for b in range(a, 5)]

    def membrane(change: Array) -> Array:
        q = change @ Q_FROM_NUMBERS.T
        return np.asarray(np.einsum("...a,...ab,...b->...", q, K, q) / 2)

    KB, K12, C = np.zeros((*nodes, 2, 2)), np.zeros(cells), np.zeros((*cells, 4, 3, 3))
    if bending == "plain":
        inside = [np.isin(np.arange(n), (0, n - 1), invert=True) for n in nodes]
        exists = np.stack(np.meshgrid(*inside, indexing="ij"), axis=-1)
        KB = 0.01 * definite(*nodes, 2) * exists[..., :, None] * exists[..., None, :]
        K12 = 0.01 * random.uniform(0.5, 1.5, cells)
    if bending == "coupled":
        exists = existing(nodes)
        C = 0.01 * definite(*cells, 4, 3) * exists[..., :, None] * exists[..., None, :]
    energy = DiscreteEnergy(rest, membrane, KB, K12, C)
    KB, K12 = KB + node_weights(C, nodes), K12 + C[..., 2, 2].sum(axis=-1)
    b, b12 = bending_numbers(rest)

    return SimpleNamespace(
        nodes=nodes, energy=energy, z=crumpled(rest), p=noise(rest, 1.0, 9),
        K=np.stack(entries, axis=-1), q0=membrane_numbers(rest) @ Q_FROM_NUMBERS.T,
        KB=KB[..., [0, 0, 1], [0, 1, 1]], K12=K12, b0=b, b120=b12,
        KC=np.concatenate([C[..., 0, 2], C[..., 1, 2]], axis=-1),
    )  # fmt: skip


@functools.cache
def run(nodes: tuple[int, int], orthogonal: bool, bending: str, real: Any, width: int) -> dict[str, Array]:
    """Every output of every kernel, shape (nu, nv, n); outputs that are overwritten start as not a number."""
    given, layout = problem(nodes, orthogonal, bending), Layout(nodes, width)
    bends, coupled = bending != "none", bending == "coupled"
    kernels, diagonal = surface(width, real, orthogonal, bends), surface_blocks(width, real, orthogonal, bends)
    coupling = surface_coupling(width, real)
    arrays: dict[str, wp.array] = {}

    def upload(values: Array) -> wp.array:
        return wp.array(values, dtype=real, device="cpu")

    def poisoned(name: str, components: int) -> wp.array:
        values = np.zeros((components, layout.rows, layout.columns))
        values[:, 1:-1, layout.halo : -layout.halo] = np.nan
        arrays[name] = upload(values)
        return arrays[name]

    def added(name: str, components: int) -> wp.array:
        arrays[name] = upload(layout.pack(np.zeros((*nodes, components))))
        return arrays[name]

    def fluxes(flux: wp.array, flexure: wp.array, scatter: wp.array) -> Any:
        members = {"flux": flux, "flexure": flexure, "scatter": scatter}
        return RowStruct(kernels.gathering.Fluxes, members).of_rows(0, layout.rows)

    def launch(name: str, *inputs: Any, of: Any = kernels) -> None:
        wp.launch(getattr(of, name), dim=layout.lane_dim, inputs=inputs, device="cpu")

    names = ("z", "p", "K", "q0", "KB", "K12", "KC")
    z, p, K, q0, KB, K12, KC = (upload(layout.pack(getattr(given, name))) for name in names)
    b0 = upload(np.concatenate([layout.pack(given.b0), layout.pack(given.b120)]))
    alphas = [upload(alpha) for alpha in difference_weights(layout)]
    floor = real(1e-20)
    launch("measure_membrane", z, poisoned("q", 5))
    tension, twist = poisoned("tension", TENSION_COMPONENTS), added("twist", TWIST_COMPONENTS)
    flexure, scatter = added("flexure", FLEXURE_COMPONENTS), added("scatter", SCATTER_COMPONENTS)
    if bends:
        twist, flexure = poisoned("twist", TWIST_COMPONENTS), poisoned("flexure", FLEXURE_COMPONENTS)
        scatter = poisoned("scatter", SCATTER_COMPONENTS)
        launch("measure_bending", z, *alphas, floor, poisoned("b", 3))
    launch("stress_cells", z, K, q0, K12, b0, floor, tension, twist, poisoned("flux", 9))
    if bends:
        launch("stress_nodes", z, KB, b0, *alphas, floor, flexure, scatter)
    if coupled:
        launch("change", z, b0, *alphas, floor, floor, poisoned("change", CHANGE_COMPONENTS), of=coupling)
        scatter, bent = poisoned("scatter", SCATTER_COMPONENTS), (*alphas, flexure, twist)
        launch("couple", KB, KC, *bent, arrays["change"], arrays["flux"], scatter, of=coupling)
    launch("gather", fluxes(arrays["flux"], flexure, scatter), added("gradient", 3))
    launch("block_cells", z, K, tension, K12, twist, added("blocks", 6), of=diagonal)
    launch("product_cells", z, K, tension, K12, twist, p, poisoned("product_flux", 9))
    moments = scatter
    if bends:
        launch("block_nodes", KB, *alphas, flexure, arrays["blocks"], of=diagonal)
        moments = poisoned("product_scatter", SCATTER_COMPONENTS)
    if coupled:
        launch("block_coupling", KC, *bent, arrays["blocks"], of=coupling)
        launch("change_along", *bent, p, poisoned("product_change", CHANGE_COMPONENTS), of=coupling)
        launch("couple", KB, KC, *bent, arrays["product_change"], arrays["product_flux"], moments, of=coupling)
    elif bends:
        launch("product_nodes", KB, *alphas, flexure, p, moments)
    launch("gather", fluxes(arrays["product_flux"], flexure, moments), added("product", 3))
    partials = wp.zeros((layout.rows, layout.columns), dtype=wp.float64, device="cpu")
    launch("energy_cells", z, K, q0, K12, b0, floor, partials)
    if bends:
        launch("energy_nodes", z, KB, b0, *alphas, floor, partials)
    if coupled:
        launch("energy_coupling", KC, arrays["change"], partials, of=coupling)
    results = {name: np.moveaxis(array.numpy(), 0, -1) for name, array in arrays.items()}
    for name, values in results.items():
        assert np.isfinite(values).all(), name
        if name in ("gradient", "product", "blocks"):
            outside = np.ones((layout.rows, layout.columns), dtype=bool)
            outside[1:-1, layout.halo : layout.halo + nodes[1]] = False
            assert not values[outside].any(), name
    inside = np.s_[1:-1, layout.halo : layout.halo + nodes[1]]
    found = {name: values[inside].copy() for name, values in results.items()}
    found["energy"] = partials.numpy().sum(keepdims=True)
    return found


@pytest.mark.parametrize("nodes", [(2, 2), (2, 5), (3, 3), (4, 5)], ids=str)
@pytest.mark.parametrize(("orthogonal", "bending"), VARIANTS, ids=NAMES)
def test_kernels_are_the_derivatives_of_their_energy(orthogonal: bool, bending: str, nodes: tuple[int, int]) -> None:
    given, found = problem(nodes, orthogonal, bending), run(nodes, orthogonal, bending, wp.float64, 1)
    z, energy = given.z, given.energy
    np.testing.assert_allclose(found["q"][:-1, :-1], membrane_numbers(z) @ Q_FROM_NUMBERS.T, atol=1e-13)
    if bending != "none":
        b, b12 = bending_numbers(z)
        np.testing.assert_allclose(found["b"][1:-1, :, 0], b[1:-1, :, 0], atol=1e-13)
        np.testing.assert_allclose(found["b"][:, 1:-1, 1], b[:, 1:-1, 1], atol=1e-13)
        np.testing.assert_allclose(found["b"][:-1, :-1, 2], b12, atol=1e-13)
    assert found["energy"] == pytest.approx(energy.energy(z), rel=1e-12)
    gradient, hessian = energy.gradient(z), energy.projected_hessian(z)
    np.testing.assert_allclose(found["gradient"], gradient, atol=1e-13 * np.abs(gradient).max())
    product = (hessian @ given.p.ravel()).reshape(z.shape)
    np.testing.assert_allclose(found["product"], product, atol=1e-13 * np.abs(product).max())
    count = nodes[0] * nodes[1]
    diagonal = np.einsum("ikil->ikl", hessian.reshape(count, 3, count, 3)).reshape(*nodes, 3, 3)
    blocks = diagonal[..., [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    np.testing.assert_allclose(found["blocks"], blocks, atol=1e-13 * np.abs(blocks).max())


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("nodes", GRIDS, ids=str)
@pytest.mark.parametrize(("orthogonal", "bending"), VARIANTS, ids=NAMES)
def test_lane_widths_agree_to_the_bit_and_precisions_to_round_off(
    orthogonal: bool, bending: str, nodes: tuple[int, int], real: Any
) -> None:
    narrow, wide = (run(nodes, orthogonal, bending, real, width) for width in WIDTHS[real])
    exact = run(nodes, orthogonal, bending, wp.float64, 1)
    for name, values in narrow.items():
        if name == "energy":
            assert wide[name] == pytest.approx(values, rel=1e-13)
        else:
            np.testing.assert_array_equal(values, wide[name], err_msg=name)
        if name in ("gradient", "product", "blocks", "energy") and real is wp.float32:
            np.testing.assert_allclose(values, exact[name], atol=1e-4 * np.abs(exact[name]).max(), err_msg=name)


def test_variant_without_bending_compiles_no_curvature() -> None:
    flat, bending = surface(1, wp.float64, True, False).module, surface(1, wp.float64, True, True).module
    assert "bending" not in flat.name
    assert "bending" in bending.name
    assert flat is not bending


def test_coupling_is_a_module_of_its_own_and_names_its_kernels() -> None:
    coupling = surface_coupling(1, wp.float64)
    assert {name for name, kernel in vars(coupling).items() if isinstance(kernel, wp.Kernel)} == set(COUPLING_KERNELS)
    assert coupling.module is not surface(1, wp.float64, False, True).module
