"""Solids that have grown: what they have become is what a solid of that shape has from the start."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from solids import MATERIALS, SHAPES, Block, Term, box, crumpled, graded, leaning, noise
from surfaces import REALS, WIDTHS, turned

from warpdeform.grid import Layout
from warpdeform.growth import Growth
from warpdeform.kernels.solid_growth import REST_ENTRIES, solid_growth
from warpdeform.linear.transfer import Transfer
from warpdeform.material import Material
from warpdeform.varying import Varying

Array = np.ndarray[Any, Any]

NODES = (3, 4, 5)
SWELLS = Growth([0, 1], [[1, 1, 1], [1.4, 0.7, 1.1]], where=lambda u, v, w: u * (1 - v) * w)


def grown(
    rest: Block, material: str | Material, growth: Growth, real: Any = wp.float64, width: int = 1, time: float = 1.0
) -> Term:
    made_of = MATERIALS[material] if isinstance(material, str) else material
    term = Term(rest, made_of, real, width, growth=growth)
    term.force.prepare(time, 0.1, 0.1)
    return term


def assert_alike(one: Term, other: Term, z: Array, tolerance: float = 1e-12) -> None:
    """The same energy, forces, products and blocks at some positions."""
    p = noise(z, 1.0, 9)
    found = [(term.energy(z), term.gradient(z), term.product(p), term.blocks()) for term in (one, other)]
    for name, a, b in zip(("energy", "gradient", "product", "blocks"), *found, strict=True):
        np.testing.assert_allclose(a, b, atol=tolerance * np.abs(b).max(), rtol=tolerance, err_msg=name)


@pytest.mark.parametrize("width", [1, 8])
@pytest.mark.parametrize("material", ["soft", "paper", "barrier"])
@pytest.mark.parametrize("shape", SHAPES)
def test_what_has_grown_evenly_is_a_larger_body_of_that_shape(shape: str, material: str, width: int) -> None:
    rest = SHAPES[shape](NODES)
    large = Block(1.3 * rest.positions, rest.spacing)
    small = grown(rest, material, Growth([0.0, 1.0], [1.0, 1.3]), width=width)
    whole = Term(large, MATERIALS[material], lane_width=width)
    assert_alike(small, whole, crumpled(large.positions))
    assert small.energy(large.positions) < 1e-18


@pytest.mark.parametrize("material", ["soft", "paper", "barrier"])
@pytest.mark.parametrize("make", [box, graded], ids=["box", "graded"])
def test_what_has_grown_along_its_axes_is_a_body_of_those_lengths(make: Any, material: str) -> None:
    scales, rest = (1.3, 0.8, 1.1), make(NODES)
    whole = Term(Block(rest.positions * scales, rest.spacing), MATERIALS[material])
    assert_alike(grown(rest, material, Growth([0.0, 1.0], [[1.0] * 3, scales])), whole, crumpled(whole.rest))


@pytest.mark.parametrize("material", ["soft", "barrier"])
def test_cells_that_lean_keep_their_angles(material: str) -> None:
    # Stretched in their own axes, not across them.
    rest, scales = leaning(NODES), (1.3, 0.8, 1.1)
    origin = rest.positions[0, 0, 0]
    steps = [rest.positions[tuple(np.eye(3, dtype=int)[axis])] - origin for axis in range(3)]
    index = np.stack(np.meshgrid(*(range(n) for n in NODES), indexing="ij"), axis=-1)
    positions = origin + (index * scales) @ np.array(steps)
    whole = Term(Block(positions, rest.spacing), MATERIALS[material])
    assert_alike(grown(rest, material, Growth([0.0, 1.0], [[1.0] * 3, scales])), whole, crumpled(positions))


@pytest.mark.parametrize("width", [1, 8])
@pytest.mark.parametrize("make", [box, leaning], ids=["box", "leaning"])
def test_what_has_grown_more_and_more_along_an_axis_is_a_body_of_those_lengths(make: Any, width: int) -> None:
    # Each layer across u by a factor of its own.
    rest = make((5, 3, 4))
    layers = 1 + 0.6 * (np.arange(4) + 0.5) / 4
    steps = np.diff(rest.positions, axis=0) * layers[:, None, None, None]
    first = rest.positions[:1]
    positions = first + np.concatenate([0 * first, np.cumsum(steps, axis=0)])
    growth = Growth([0.0, 1.0], [[1.0] * 3, [1.6, 1.0, 1.0]], where=lambda u, v, w: u)
    small = grown(rest, "barrier", growth, width=width)
    assert not small.stiffness.uniform
    assert_alike(
        small, Term(Block(positions, rest.spacing), MATERIALS["barrier"], lane_width=width), crumpled(positions)
    )
    np.testing.assert_allclose(small.force.growth.edge_scales()[0][:, 0, 0], layers, rtol=1e-14)


def test_back_at_the_first_keyframe_it_is_what_it_was_to_the_bit() -> None:
    rest = SHAPES["bent"](NODES)
    plain, changed = Term(rest, MATERIALS["soft"]), grown(rest, "soft", SWELLS)
    z = crumpled(rest.positions)
    assert changed.energy(z) != plain.energy(z)
    changed.force.prepare(0.0, 0.1, 0.1)
    assert changed.energy(z) == plain.energy(z)
    np.testing.assert_array_equal(changed.gradient(z), plain.gradient(z))


@pytest.mark.parametrize("width", [1, 8])
@pytest.mark.parametrize(
    ("shape", "material"), [("box", "soft"), ("bent", "barrier"), ("cylinder", "rubber"), ("bent", "paper")]
)
def test_growth_here_and_there_keeps_energy_and_forces_together(shape: str, material: str, width: int) -> None:
    rest = SHAPES[shape]((3, 3, 4))
    term = grown(rest, material, SWELLS, width=width)
    z, step = crumpled(rest.positions), 1e-6
    gradient = term.gradient(z)
    for seed in range(2):
        p = noise(rest.positions, 1.0, seed)
        slope = (term.energy(z + step * p) - term.energy(z - step * p)) / (2 * step)
        assert np.sum(gradient * p) == pytest.approx(slope, rel=1e-6)
    H = term.dense()
    assert np.abs(H - H.T).max() < 1e-13 * np.abs(H).max()
    assert np.linalg.eigvalsh(H).min() > -1e-13 * np.abs(H).max()
    blocks = np.einsum("ikil->ikl", H.reshape(*2 * (z.size // 3, 3))).reshape(*rest.nodes, 3, 3)
    np.testing.assert_allclose(term.blocks(), blocks, atol=1e-13 * np.abs(blocks).max())
    assert np.abs(gradient.sum((0, 1, 2))).max() < 1e-13 * np.abs(gradient).sum()
    moved = turned(z, (1, 2, 3), 0.7) + 0.3
    assert term.energy(moved) == pytest.approx(term.energy(z), rel=1e-11)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize(("shape", "material"), [("box", "soft"), ("bent", "barrier")])
def test_lane_widths_agree_to_the_bit_and_precisions_to_round_off(shape: str, material: str, real: Any) -> None:
    rest = SHAPES[shape]((3, 4, 17))
    z, p = crumpled(rest.positions), noise(rest.positions, 1.0, 9)
    found = []
    for width in WIDTHS[real]:
        term = grown(rest, material, SWELLS, real, width)
        found.append((term.gradient(z), term.product(p), term.blocks()))
    exact = grown(rest, material, SWELLS)
    for narrow, wide, reference in zip(*found, (exact.gradient(z), exact.product(p), exact.blocks()), strict=True):
        np.testing.assert_array_equal(narrow, wide)
        np.testing.assert_allclose(narrow, reference, atol=5e-5 * np.abs(reference).max())


@pytest.mark.parametrize("orthogonal", [True, False])
def test_every_place_of_what_grows_is_written(orthogonal: bool) -> None:
    layout = Layout((3, 4, 2), 1)
    words = solid_growth(1, wp.float64, orthogonal)
    rest = wp.array([1.2, 0.9, 1.1], dtype=wp.float64, device="cpu")
    assert rest.shape == (REST_ENTRIES,)

    def filled(components: int, value: float) -> wp.array:
        return wp.full((components, layout.rows, layout.columns), value, dtype=wp.float64, device="cpu")

    for name, components, shares in (
        ("grow_strains", 6, 6), ("grow_edges", 3, 6), ("grow_law", 21 if orthogonal else 16, 1), ("grow_volume", 3, 1),
    ):  # fmt: skip
        out = filled(components, np.nan)
        inputs = [rest, filled(shares, 0.5), filled(components, 2.0), out]
        wp.launch(getattr(words, name), dim=(layout.rows, layout.columns), inputs=inputs, device="cpu")
        assert np.isfinite(out.numpy()).all(), name


@pytest.mark.parametrize("varies", [False, True])
def test_coarser_grids_grow_along(varies: bool) -> None:
    rest = box((9, 8, 7))
    layout = Layout(rest.nodes, 1)
    where = Varying(lambda u, v, w: 1.0 + 0 * u) if varies else None
    growth = Growth([0.0, 1.0], [[1.0] * 3, [1.5, 1.0, 1.0]], where=where)
    force = Term(rest, MATERIALS["barrier"], growth=growth).force
    coarse_grid = rest.grid.coarser((0.1, 0.1, 0.1))
    assert coarse_grid is not None
    coarse = force.coarser(Transfer(rest.grid, layout, coarse_grid, wp.float64, wp.get_device("cpu")))
    assert coarse.stiffness.uniform is not varies

    def lengths() -> Array:
        return coarse._layout.unpack(coarse.q0.numpy(), coarse_grid.cells)[..., :3]

    before = coarse.K.numpy().copy(), coarse.volume.numpy().copy(), lengths()
    factors = np.array([1.5**-3, 1.5**-1, 1.5])[:, None, None]
    for _ in range(2):  # launched, then replayed
        force.prepare(1.0, 0.1, 0.1)
        np.testing.assert_allclose(coarse.K.numpy()[[0, 1, 5]], factors * before[0][[0, 1, 5]])
        np.testing.assert_allclose(coarse.volume.numpy()[0], 1.5 * before[1][0])
        np.testing.assert_allclose(lengths(), before[2] * [1.5**2, 1.0, 1.0])
        force.prepare(0.0, 0.1, 0.1)
        np.testing.assert_array_equal(coarse.K.numpy(), before[0])


def test_what_does_not_grow_keeps_and_launches_nothing_for_it() -> None:
    rest = box(NODES)
    plain, growing = Term(rest, MATERIALS["soft"]).force, grown(rest, "soft", Growth([0])).force
    assert plain.growth is None
    assert not any("growth" in kernel for kernel in plain.kernels)
    assert {k for k in growing.kernels if "growth" in k} == {"solid_growth.grow_strains", "solid_growth.grow_law"}
    assert growing.bytes() > plain.bytes()
    assert growing.most_steps < plain.most_steps
