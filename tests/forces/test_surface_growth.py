"""Surfaces that have grown: what they have become is what a surface of that shape has from the start."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from surfaces import CLOSED, MATERIALS, POLAR, REALS, SHAPES, WIDTHS, Surface, crumpled, noise, spacing, turned

from warpdeform.forces.surface_elasticity import SurfaceElasticity
from warpdeform.grid import Layout
from warpdeform.growth import Growth
from warpdeform.kernels.surface_growth import surface_growth
from warpdeform.linear.transfer import Transfer
from warpdeform.material import Material
from warpdeform.shape import RestShape, from_array, sheet, tube

Array = np.ndarray[Any, Any]
ALL = SHAPES | CLOSED | POLAR


def grown(
    rest: RestShape, material: Material, growth: Growth, real: Any = wp.float64, width: int = 1, time: float = 1.0
) -> Surface:
    surface = Surface(rest, material, real, width)
    surface.force = SurfaceElasticity(rest.grid, surface.layout, rest.positions, material, real, "cpu", growth=growth)
    surface.force.prepare(time, 0.1, 0.1)
    return surface


def assert_alike(one: Surface, other: Surface, z: Array, tolerance: float = 1e-13) -> None:
    """The same energy, forces, products and blocks at some positions."""
    p = noise(z, 1.0, 9)
    found = [(surface.energy(z), surface.gradient(z), surface.product(p), surface.blocks()) for surface in (one, other)]
    for name, a, b in zip(("energy", "gradient", "product", "blocks"), *found, strict=True):
        np.testing.assert_allclose(a, b, atol=tolerance * np.abs(b).max(), rtol=tolerance, err_msg=name)


@pytest.mark.parametrize("width", [1, 8])
@pytest.mark.parametrize("material", ["membrane", "orthotropic", "paper", "varying"])
@pytest.mark.parametrize("shape", ALL)
def test_what_has_grown_evenly_is_a_larger_body_of_that_shape(shape: str, material: str, width: int) -> None:
    rest = ALL[shape]((6, 11))
    growth = Growth([0.0, 1.0], [1.0, 1.3])
    large = from_array(1.3 * rest.positions, rest.spacing, rest.periodic, poles=rest.poles)
    small, whole = (
        grown(rest, MATERIALS[material], growth, width=width),
        Surface(large, MATERIALS[material], lane_width=width),
    )
    assert_alike(small, whole, crumpled(large.positions))


@pytest.mark.parametrize(
    ("make", "scales"),
    [
        (lambda a, b: sheet((6, 5), (a, 0.7 * b)), (1.3, 0.8)),
        (lambda a, b: tube((8, 5), 0.3 * a, 0.7 * b), (0.8, 1.5)),
    ],
    ids=["sheet", "tube"],
)
@pytest.mark.parametrize("material", ["isotropic", "orthotropic", "membrane"])
def test_what_has_grown_along_its_axes_is_a_body_of_those_lengths(
    make: Any, scales: tuple[float, float], material: str
) -> None:
    growth = Growth([0.0, 1.0], [[1.0, 1.0], list(scales)])
    small, whole = grown(make(1.0, 1.0), MATERIALS[material], growth), Surface(make(*scales), MATERIALS[material])
    assert_alike(small, whole, crumpled(whole.rest))


@pytest.mark.parametrize("material", ["isotropic", "paper", "varying"])
def test_a_skewed_sheet_keeps_its_angle(material: str) -> None:
    # Along u and v by 1.3 and 0.8, whatever their angle: stretched in its own axes, not across them.
    a, b = 1.3, 0.8
    rest = SHAPES["parallelogram"]((5, 6))
    origin = rest.positions[0, 0]
    u, v = rest.positions[1, 0] - origin, rest.positions[0, 1] - origin
    i, j = np.meshgrid(range(5), range(6), indexing="ij")
    positions = origin + i[..., None] * a * u + j[..., None] * b * v
    growth = Growth([0.0, 1.0], [[1.0, 1.0], [a, b]])
    whole = Surface(from_array(positions, rest.spacing), MATERIALS[material])
    assert_alike(grown(rest, MATERIALS[material], growth), whole, crumpled(positions), 1e-12)


def test_back_at_the_first_keyframe_it_is_what_it_was_to_the_bit() -> None:
    rest = SHAPES["bump"]((5, 6))
    plain, changed = (
        Surface(rest, MATERIALS["isotropic"]),
        grown(rest, MATERIALS["isotropic"], Growth([0, 1], [1, 1.3])),
    )
    z = crumpled(rest.positions)
    assert changed.energy(z) != plain.energy(z)
    changed.force.prepare(0.0, 0.1, 0.1)
    assert changed.energy(z) == plain.energy(z)
    np.testing.assert_array_equal(changed.gradient(z), plain.gradient(z))


@pytest.mark.parametrize(
    ("shape", "material"), [("bump", "isotropic"), ("tube", "shell"), ("ball", "isotropic"), ("flat", "paper")]
)
def test_growth_here_and_there_keeps_energy_and_forces_together(shape: str, material: str) -> None:
    rest = ALL[shape]((6, 7))
    growth = Growth([0, 1], [[1, 1], [1.4, 0.7]], [[0, 0, 0], [2.0, -1.0, 0.5]], where=lambda u, v: u * (1 - v))
    surface = grown(rest, MATERIALS[material], growth)
    z, step = crumpled(rest.positions), 1e-6
    gradient = surface.gradient(z)
    for seed in range(2):
        p = noise(rest.positions, 1.0, seed)
        slope = (surface.energy(z + step * p) - surface.energy(z - step * p)) / (2 * step)
        assert np.sum(gradient * p) == pytest.approx(slope, rel=1e-6)
    H = np.array([surface.product(e.reshape(z.shape)).ravel() for e in np.eye(z.size)])
    assert np.abs(H - H.T).max() < 1e-13 * np.abs(H).max()
    assert np.linalg.eigvalsh(H).min() > -1e-13 * np.abs(H).max()
    blocks = np.einsum("ikil->ikl", H.reshape(*2 * (z.size // 3, 3))).reshape(*rest.nodes, 3, 3)
    np.testing.assert_allclose(surface.blocks(), blocks, atol=1e-13 * np.abs(blocks).max())
    assert np.abs(gradient.sum((0, 1))).max() < 1e-13 * np.abs(gradient).sum()
    moved = turned(z, (1, 2, 3), 0.7) + 0.3
    assert surface.energy(moved) == pytest.approx(surface.energy(z), rel=1e-11)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("shape", ["flat", "bump", "torus", "ball"])
def test_lane_widths_agree_to_the_bit_and_precisions_to_round_off(shape: str, real: Any) -> None:
    rest = ALL[shape]((6, 11))
    growth = Growth([0, 1], [[1, 1], [1.4, 0.7]], [[0, 0], [2.0, -1.0]], where=lambda u, v: u)
    z, p = crumpled(rest.positions), noise(rest.positions, 1.0, 9)
    found = []
    for width in WIDTHS[real]:
        surface = grown(rest, MATERIALS["isotropic"], growth, real, width)
        found.append((surface.gradient(z), surface.product(p), surface.blocks()))
    exact = grown(rest, MATERIALS["isotropic"], growth)
    for narrow, wide, reference in zip(*found, (exact.gradient(z), exact.product(p), exact.blocks()), strict=True):
        np.testing.assert_array_equal(narrow, wide)
        np.testing.assert_allclose(narrow, reference, atol=2e-5 * np.abs(reference).max())


@pytest.mark.parametrize("orthogonal", [True, False])
def test_every_place_of_what_grows_is_written(orthogonal: bool) -> None:
    layout = Layout((3, 4), 1)
    shape = (layout.rows, layout.columns)
    words = surface_growth(1, wp.float64, orthogonal)
    rest = wp.array([1.2, 0.9, 1.0, 2.0, 3.0], dtype=wp.float64, device="cpu")

    def filled(components: int, value: float) -> wp.array:
        return wp.full((components, *shape), value, dtype=wp.float64, device="cpu")

    share, count = filled(1, 0.5), 6 if orthogonal else 15
    for name, components, more in (
        ("grow_membrane", count, ()), ("grow_strains", 5, ()), ("grow_bending", 3, ()), ("grow_twist", 1, ()),
        ("grow_coupling", 8, (share,)), ("grow_curvature", 3, (share, filled(3, 0.1))),
    ):  # fmt: skip
        out, dim = filled(components, np.nan), (shape[0], shape[1])
        if name == "grow_coupling":
            dim = (shape[0] - 1, shape[1] - 1)
        wp.launch(
            getattr(words, name), dim=dim, inputs=[rest, share, *more, filled(components, 2.0), out], device="cpu"
        )
        assert np.isfinite(out.numpy()[:, : dim[0], : dim[1]]).all(), name


def test_natural_curvature_is_that_of_a_body_bent_so() -> None:
    # A flat strip that wants to be a tube's part: the tube is at rest, whatever Poisson's ratio.
    radius, cells = 0.5, 12
    chord = 0.05
    angle = 2 * np.arcsin(chord / 2 / radius)
    flat = sheet((cells + 1, 4), (cells * chord, 0.2))
    around, across = np.meshgrid(angle * np.arange(cells + 1), np.linspace(0, 0.2, 4), indexing="ij")
    bent = np.stack([radius * np.sin(around), across, radius * (1 - np.cos(around))], axis=-1)
    growth = Growth([0.0, 1.0], curvature=[[0.0, 0.0], [1 / radius, 0.0]])
    surface = grown(flat, MATERIALS["isotropic"], growth)
    unbent = Surface(flat, MATERIALS["isotropic"])
    # Nodes next to a border have normals from one side, which lean.
    assert surface.energy(bent) < 1e-3 * unbent.energy(bent)
    scale = np.abs(unbent.gradient(bent)).max()
    assert np.abs(surface.gradient(bent)[3:-3]).max() < 1e-12 * scale
    # Across as well, and twisted.
    twist = grown(flat, MATERIALS["isotropic"], Growth([0.0], curvature=[[0.0, 0.0, 1.0]]), time=0.0)
    saddle = flat.positions.copy()
    saddle[..., 2] = 1e-3 * flat.positions[..., 0] * flat.positions[..., 1]
    unsaddled = Surface(flat, MATERIALS["isotropic"])
    downhill = twist.energy(saddle) - twist.energy(flat.positions) - unsaddled.energy(saddle)
    assert downhill < 0


def test_coarser_grids_grow_along() -> None:
    rest = ALL["tube"]((12, 9))
    layout = Layout(rest.nodes, 1, rest.periodic)
    force = SurfaceElasticity(
        rest.grid, layout, rest.positions, MATERIALS["isotropic"], wp.float64, "cpu", growth=Growth([0, 1], [1, 1.5])
    )
    lengths = (spacing(rest.positions),) * 2
    coarse_grid = rest.grid.coarser(lengths)
    assert coarse_grid is not None
    coarse = force.coarser(Transfer(rest.grid, layout, coarse_grid, wp.float64, wp.get_device("cpu")))
    before = coarse.K.numpy().copy(), coarse.KB.numpy().copy()
    force.prepare(1.0, 0.1, 0.1)
    np.testing.assert_allclose(coarse.K.numpy(), before[0] / 1.5**2, rtol=1e-13)
    np.testing.assert_allclose(coarse.KB.numpy(), before[1] / 1.5**2, rtol=1e-13)


def test_what_does_not_grow_keeps_and_launches_nothing_for_it() -> None:
    rest = sheet((9, 9))
    plain, growing = (Surface(rest, MATERIALS["membrane"]).force, grown(rest, MATERIALS["membrane"], Growth([0])).force)
    assert plain.growth is None
    assert not any("growth" in kernel for kernel in plain.kernels)
    assert {"surface_growth.grow_membrane", "surface_growth.grow_strains"} <= set(growing.kernels)
    assert not any("bending" in kernel or "curvature" in kernel for kernel in growing.kernels)
    assert growing.bytes() > plain.bytes()
