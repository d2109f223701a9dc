"""Curves that have grown: what they have become is what a curve of that shape has from the start."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from curves import CASES, CLOSED, FLAT, ROD, RUBBER, SHAPES, STRING, Curve, crumpled, line, noise
from surfaces import REALS, WIDTHS, turned

from warpdeform.grid import Layout
from warpdeform.growth import Growth
from warpdeform.kernels.curve_growth import REST_ENTRIES, curve_growth

Array = np.ndarray[Any, Any]

CURLS = Growth([0, 1], [1, 1.4], [[0, 0, 0], [2.0, -1.0, 3.0]], where=lambda u, strand: u * (1 - 0.3 * strand))


def grown(
    name: str, nodes: tuple[int, int], growth: Growth, real: Any = wp.float64, width: int = 1, time: float = 1.0
) -> Curve:
    """A case whose rest shape has changed."""
    case = CASES[name]
    rest, closed = SHAPES[case.shape](*nodes), name in CLOSED
    curve = Curve(rest, case.material, real, width, closed=closed, growth=growth, **case.options)
    curve.force.prepare(time, 0.1, 0.1)
    return curve


def assert_alike(one: Curve, other: Curve, z: Array, tolerance: float = 1e-12) -> None:
    """The same energy, forces, products and blocks at some positions."""
    p = noise(z, 1.0, 9)
    found = [(curve.energy(z), curve.gradient(z), curve.product(p), curve.blocks()) for curve in (one, other)]
    for name, a, b in zip(("energy", "gradient", "product", "blocks"), *found, strict=True):
        np.testing.assert_allclose(a, b, atol=tolerance * np.abs(b).max(), rtol=tolerance, err_msg=name)


@pytest.mark.parametrize("width", [1, 8])
@pytest.mark.parametrize("name", CASES)
def test_what_has_grown_evenly_is_a_larger_body_of_that_shape(name: str, width: int) -> None:
    case, closed = CASES[name], name in CLOSED
    large = 1.3 * SHAPES[case.shape](7, 3)
    whole = Curve(large, case.material, lane_width=width, closed=closed, **case.options)
    small = grown(name, (7, 3), Growth([0.0, 1.0], [1.0, 1.3]), width=width)
    assert_alike(small, whole, crumpled(large))
    assert small.energy(large) < 1e-20


@pytest.mark.parametrize("name", ["string", "rod", "uneven rod", "paper", "ribbon", "helix", "helical ribbon"])
def test_what_has_grown_here_and_there_is_a_body_of_those_lengths(name: str) -> None:
    # Every segment by a factor of its own, with the angles between them kept.
    case = CASES[name]
    rest = SHAPES[case.shape](8, 2)
    where = np.random.default_rng(3).uniform(0.0, 1.0, (7, 2))
    edges = (1 + 0.6 * where)[..., None] * np.diff(rest, axis=0)
    long = rest[:1] + np.concatenate([0 * rest[:1], np.cumsum(edges, axis=0)])
    whole = Curve(long, case.material, **case.options)
    small = grown(name, (8, 2), Growth([0.0, 1.0], [1.0, 1.6], where=where))
    assert_alike(small, whole, crumpled(long))
    np.testing.assert_allclose(small.force.growth.edge_scales()[0], 1 + 0.6 * where, rtol=1e-14)


@pytest.mark.parametrize("width", [1, 8])
@pytest.mark.parametrize("name", ["rod", "uneven rod", "paper", "ribbon", "helical ribbon", "ring"])
def test_energy_and_forces_of_what_grows_and_curls_go_together(name: str, width: int) -> None:
    curve = grown(name, (7, 3), CURLS, width=width)
    assert curve.force.frames is not None
    z, step = crumpled(curve.rest), 1e-6
    gradient = curve.gradient(z)
    for seed in range(2):
        p = noise(curve.rest, 1.0, seed)
        slope = (curve.energy(z + step * p) - curve.energy(z - step * p)) / (2 * step)
        curve.linearise(z)
        assert np.sum(gradient * p) == pytest.approx(slope, rel=2e-6)
    H = curve.hessian()
    assert np.abs(H - H.T).max() < 1e-13 * np.abs(H).max()
    assert np.linalg.eigvalsh(H).min() > -1e-13 * np.abs(H).max()
    assert np.abs(gradient.sum(axis=0)).max() < 1e-13 * np.abs(gradient).sum()
    assert np.abs(np.cross(z, gradient).sum(axis=0)).max() < 1e-6 * np.abs(gradient).sum()


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("name", ["string", "rod", "ribbon", "ring"])
def test_lane_widths_agree_to_the_bit_and_precisions_to_round_off(name: str, real: Any) -> None:
    growth = Growth([0, 1], [1, 1.4], where=lambda u, strand: u) if name == "string" else CURLS
    rest = SHAPES[CASES[name].shape](6, 11)
    z, p = crumpled(rest), noise(rest, 1.0, 9)
    found = []
    for width in WIDTHS[real]:
        curve = grown(name, (6, 11), growth, real, width)
        found.append((curve.gradient(z), curve.product(p), curve.blocks()))
    exact = grown(name, (6, 11), growth)
    for narrow, wide, reference in zip(*found, (exact.gradient(z), exact.product(p), exact.blocks()), strict=True):
        np.testing.assert_array_equal(narrow, wide)
        np.testing.assert_allclose(narrow, reference, atol=1e-4 * np.abs(reference).max())


def test_back_at_the_first_keyframe_it_is_what_it_was_to_the_bit() -> None:
    plain, changed = Curve.of("helical ribbon", (7, 3)), grown("helical ribbon", (7, 3), CURLS)
    z = crumpled(plain.rest)
    assert changed.energy(z) != plain.energy(z)
    changed.force.prepare(0.0, 0.1, 0.1)
    changed.force.reset()
    assert changed.energy(z) == plain.energy(z)
    np.testing.assert_array_equal(changed.gradient(z), plain.gradient(z))


def test_frames_begin_as_the_shape_has_them_whatever_has_grown() -> None:
    # With a natural twist of more than a turn a node the frames would count on from the wrong turn.
    growth = Growth([0.0, 1.0], curvature=[[0.0, 0.0, 0.0], [0.0, 0.0, 80.0]])
    curve = grown("ribbon", (7, 2), growth)
    twisted = curve.energy(curve.rest)
    curve.force.reset()
    assert curve.energy(curve.rest) == pytest.approx(twisted, rel=1e-12)


@pytest.mark.parametrize(("about", "director"), [(0, (0.0, -1.0, 0.0)), (1, (0.0, 0.0, 1.0))])
@pytest.mark.parametrize("scale", [1.0, 1.5])
def test_a_curvature_needs_no_force_around_a_circle_of_its_radius(
    about: int, director: tuple[float, ...], scale: float
) -> None:
    # From x towards z is about -y: director 1 itself, or director 2 = x cross director 1.
    radius, count = 0.5, 12
    turn = 2 * np.pi / 30
    chord, phase = 2 * radius * np.tan(turn / 2), turn * np.arange(count)
    arc = radius / np.cos(turn / 2) * np.stack([np.sin(phase), 0 * phase, 1 - np.cos(phase)], axis=-1)[:, None]
    straight = chord / scale * np.arange(count)[:, None, None] * np.eye(3)[0]
    curvature = np.zeros(3)
    curvature[about] = 1 / radius
    growth = Growth([0.0, 1.0], [1.0, scale], [[0.0] * 3, curvature])
    curve = Curve(straight, RUBBER, section=FLAT, director=director, growth=growth)
    before, force = curve.energy(arc), np.abs(curve.gradient(arc)).max()
    curve.force.prepare(1.0, 0.1, 0.1)
    # What keeps folded nodes finite is a millionth of the curvature.
    assert curve.energy(arc) < 1e-11 * before
    assert np.abs(curve.gradient(arc)).max() < 1e-5 * force


def test_a_round_straight_strand_has_frames_only_if_it_curls() -> None:
    rest = line(5, 2)
    longer = Curve(rest, ROD, growth=Growth([0.0, 1.0], [1.0, 2.0], [[0.0, 0.0], [0.0, 0.0]]))
    assert longer.force.frames is None
    assert not any("frame" in kernel or "curvature" in kernel for kernel in longer.force.kernels)
    assert Curve(rest, ROD, growth=Growth([0.0], curvature=[[1.0, 0.0]])).force.frames is not None


def test_what_does_not_grow_keeps_and_launches_nothing_for_it() -> None:
    rest = line(5, 2)
    plain, growing = Curve(rest, STRING).force, Curve(rest, STRING, growth=Growth([0.0])).force
    assert plain.growth is None
    assert not any("growth" in kernel for kernel in plain.kernels)
    assert {k for k in growing.kernels if "growth" in k} == {
        "curve_growth.grow_lengths",
        "curve_growth.grow_stretching",
    }
    assert growing.bytes() > plain.bytes()
    assert growing.most_steps < plain.most_steps


def test_every_place_of_what_grows_is_written() -> None:
    layout = Layout((3, 4), 1)
    words = curve_growth(1, wp.float64)
    rest = wp.array([1.2, 1.0, 2.0, 3.0], dtype=wp.float64, device="cpu")
    assert rest.shape == (REST_ENTRIES,)

    def filled(components: int, value: float) -> wp.array:
        return wp.full((components, layout.rows, layout.columns), value, dtype=wp.float64, device="cpu")

    share = filled(1, 0.5)
    for name, components, more in (
        ("grow_lengths", 1, ()),
        ("grow_stretching", 1, ()),
        ("grow_bending", 3, ()),
        ("grow_curvature", 3, (share,)),
    ):
        out = filled(components, np.nan)
        inputs = [rest, share, *more, filled(components, 2.0), out]
        wp.launch(getattr(words, name), dim=(layout.rows, layout.columns), inputs=inputs, device="cpu")
        assert np.isfinite(out.numpy()).all(), name


def test_rigid_motions_cost_nothing_of_what_has_grown() -> None:
    curve = grown("helix", (7, 3), Growth([0.0, 1.0], [1.0, 0.6]))
    small = 0.6 * curve.rest
    moved = turned(small, (1, 2, 3), 0.7) + 0.3
    assert curve.energy(moved) < 1e-20
