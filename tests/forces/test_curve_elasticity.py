"""The elastic energy of a curve against design 1.3 in NumPy, finite differences, symmetries and closed forms."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp
from curves import (
    CASES,
    CLOSED,
    FLAT,
    ROD,
    ROUND,
    RUBBER,
    SHAPES,
    STATES,
    Curve,
    crumpled,
    line,
    noise,
    spacing,
    stretched,
)
from surfaces import REALS, WIDTHS, turned

from warpdeform.kernels.strand_words import band_components

Array = np.ndarray[Any, Any]
State = Callable[[Array], Array]

SMALL = (6, 2)
FRAMED = [name for name in CASES if name not in ("string", "loop of string", "rod", "uneven rod", "paper")]
ROUGH = 1e-6
"""How far Newton on the angles may be from their best values, as a part of the forces: its last step is not checked."""


def largest(a: Array) -> float:
    return float(np.abs(a).max())


def settled(curve: Curve, z: Array) -> tuple[Any, Array | None]:
    """The oracle, and its angles of least energy; they start from those of the curve, there may be more minima."""
    design, frames = curve.design(), curve.force.frames
    if frames is None:
        return design, None
    curve.linearise(z)
    return design, design.settled(z, angle=curve.download(frames._angle)[: len(frames.start.tangents), :, 0])


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("state", STATES.values(), ids=STATES)
def test_energy_gradient_and_hessian_are_those_of_the_design(name: str, state: State) -> None:
    curve = Curve.of(name, SMALL)
    z = state(curve.rest)
    design, angle = settled(curve, z)
    assert curve.energy(z) == pytest.approx(design.energy(z, angle), rel=1e-11)
    gradient, hessian = design.gradient(z, angle), design.projected_hessian(z, angle)
    assert largest(curve.gradient(z) - gradient) < (1e-13 if angle is None else 1e-8) * largest(gradient)
    H = curve.hessian()
    assert largest(H - hessian) < (1e-13 if angle is None else 1e-7) * largest(hessian)
    assert largest(H - H.T) < 1e-15 * largest(H)
    assert np.linalg.eigvalsh(H).min() > -1e-14 * largest(H)


@pytest.mark.parametrize("name", CASES)
def test_blocks_are_those_on_the_diagonal_with_the_angles_held(name: str) -> None:
    curve = Curve.of(name, SMALL)
    z = crumpled(curve.rest)
    curve.linearise(z)
    H, blocks = curve.hessian(), curve.blocks()
    if curve.force.frames is not None:
        whole = largest(H)
        above = blocks.reshape(-1, 3, 3) - np.einsum("ikil->ikl", H.reshape(12, 3, 12, 3))
        assert np.linalg.eigvalsh(above).min() > -1e-14 * whole
        curve.force.frames.hold(np.ones((len(curve.force.frames.start.tangents), 2), dtype=bool))
        curve.linearise(z)
        H, blocks = curve.hessian(), curve.blocks()
    diagonal = np.einsum("ikil->ikl", H.reshape(12, 3, 12, 3)).reshape(*SMALL, 3, 3)
    assert largest(blocks - diagonal) < 1e-14 * largest(diagonal)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("nodes", [(4, 3), (5, 1), (17, 9)])
@pytest.mark.parametrize("state", STATES.values(), ids=STATES)
def test_gradient_is_the_difference_of_the_energy(name: str, nodes: tuple[int, int], state: State) -> None:
    curve = Curve.of(name, nodes, lane_width=8)
    z, p, step = state(curve.rest), noise(curve.rest, 1.0), 1e-6
    curve.linearise(z)
    slope = (curve.energy(z + step * p) - curve.energy(z - step * p)) / (2 * step)
    assert abs(np.sum(curve.gradient(z) * p) - slope) < 1e-6 * abs(slope)


def test_shortest_curves() -> None:
    for closed, count in ((False, 2), (False, 3), (True, 4)):
        for material in (ROD, RUBBER):
            options = {} if material is ROD else {"section": FLAT}
            rest = SHAPES["ring" if closed else "helix"](count, 2)
            curve = Curve(rest, material, closed=closed, **options)
            z = crumpled(rest)
            design, angle = settled(curve, z)
            gradient = design.gradient(z, angle)
            assert largest(curve.gradient(z) - gradient) < 1e-8 * largest(gradient)
            hessian = design.projected_hessian(z, angle)
            assert largest(curve.hessian() - hessian) < 1e-7 * largest(hessian)


@pytest.mark.parametrize("name", CASES)
def test_hessian_product_is_the_difference_of_the_gradient_at_rest(name: str) -> None:
    curve, step = Curve.of(name, (7, 3)), 1e-5
    p = noise(curve.rest, 1.0)
    if name == "ribbon":
        # A free straight ribbon would turn its easy side to the load, however small that is: clamp it.
        held = np.zeros((6, 3), dtype=bool)
        held[0] = True
        curve.force.frames.hold(held)
        p[:2] = 0.0
    change = curve.gradient(curve.rest + step * p) - curve.gradient(curve.rest - step * p)
    curve.linearise(curve.rest)
    assert largest(curve.product(p) - change / (2 * step)) < 1e-6 * largest(curve.product(p))


def test_compression_is_left_out_of_the_hessian_and_kept_in_the_gradient() -> None:
    rest, step = line(7, 1), 1e-5
    curve = Curve(rest, CASES["string"].material)
    across = np.cross(rest[-1, 0] - rest[0, 0], [0.3, 0.2, 1.0])
    z, p = 0.7 * rest, np.random.default_rng(0).normal(size=(7, 1, 1)) * across
    exact = (curve.gradient(z + step * p) - curve.gradient(z - step * p)) / (2 * step)
    curve.linearise(z)
    assert np.sum(p * exact) < 0
    assert np.sum(p * curve.product(p)) == pytest.approx(0.0, abs=1e-12 * abs(np.sum(p * exact)))


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("name", CASES)
def test_rigid_motions_give_no_force(name: str, real: Any) -> None:
    curve = Curve.of(name, (9, 3), real, WIDTHS[real][1])
    step = 1e-3 * spacing(curve.rest)
    scale = largest(curve.gradient(curve.rest + step * noise(curve.rest, 1.0))) / step
    epsilon = np.finfo(wp.dtype_to_numpy(real)).eps
    for angle in (0.0, 0.4, 2.5):
        z = turned(curve.rest, (1.0, -2.0, 0.5), angle) + np.array([0.3, -0.2, 0.5])
        assert largest(curve.gradient(z)) < 16 * epsilon * scale
        assert curve.energy(z) < 1e3 * (epsilon * scale) * epsilon * curve.rest.size


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("state", STATES.values(), ids=STATES)
@pytest.mark.parametrize("name", CASES)
def test_no_net_force_and_torque(name: str, state: State, real: Any) -> None:
    curve = Curve.of(name, (9, 3), real, WIDTHS[real][1])
    z = state(curve.rest)
    force = curve.gradient(z).astype(np.float64)
    epsilon = np.finfo(wp.dtype_to_numpy(real)).eps
    assert largest(force.sum((0, 1))) < 4 * epsilon * np.abs(force).sum()
    torque, arm = np.cross(z, force), np.linalg.norm(np.ptp(z, axis=(0, 1)))
    # Angles that are not quite of least energy would leave a torque about the segments.
    assert largest(torque.sum((0, 1))) < (8 * epsilon + (ROUGH if name in FRAMED else 0)) * np.abs(force).sum() * arm
    product = curve.product(noise(curve.rest, 1.0)).astype(np.float64)
    assert largest(product.sum((0, 1))) < 4 * epsilon * np.abs(product).sum()


@pytest.mark.parametrize("name", CASES)
def test_single_precision_and_lane_widths_agree(name: str) -> None:
    found = {}
    for real in REALS:
        for width in WIDTHS[real]:
            curve = Curve.of(name, (9, 5), real, width)
            z = stretched(curve.rest)
            gradient = curve.gradient(z)
            found[real, width] = gradient, curve.product(noise(curve.rest, 1.0)), curve.blocks(), curve.energy(z)
    for real in REALS:
        narrow, wide = (found[real, width] for width in WIDTHS[real])
        for a, b in zip(narrow[:3], wide[:3], strict=True):
            np.testing.assert_array_equal(a, b)
    for single, double in zip(found[wp.float32, 16], found[wp.float64, 8], strict=True):
        assert largest(np.asarray(single) - double) < 2e-4 * largest(np.asarray(double))


@pytest.mark.parametrize("state", STATES.values(), ids=STATES)
def test_frames_of_a_round_straight_curve_change_nothing(state: State) -> None:
    plain, framed = Curve.of("rod", (9, 3)), Curve.of("twistable", (9, 3))
    z = state(plain.rest)
    assert framed.energy(z) == pytest.approx(plain.energy(z), rel=1e-12)
    gradient = plain.gradient(z)
    assert largest(framed.gradient(z) - gradient) < 1e-10 * largest(gradient)


@pytest.mark.parametrize("name", ["rod", "paper", "ribbon", "helix", "ring"])
def test_mirrored_and_reversed_curves_have_mirrored_and_reversed_forces(name: str) -> None:
    case, flip = CASES[name], np.array([-1.0, 1.0, 1.0])
    closed = name in CLOSED
    curve = Curve.of(name, (9, 3))
    z = crumpled(curve.rest)
    gradient = curve.gradient(z)
    options = dict(case.options)
    if "director" in options:
        options["director"] = np.multiply(options["director"], flip)
    mirrored = Curve(curve.rest * flip, case.material, closed=closed, **options).gradient(z * flip)
    assert largest(mirrored * flip - gradient) < 1e-7 * largest(gradient)
    options = dict(case.options)
    if curve.force.frames is not None:
        # Segment n - 1 of a closed curve closes it from either end.
        directors = curve.force.frames.start.directors
        options["director"] = np.concatenate([directors[-2::-1], directors[-1:]]) if closed else directors[::-1]
    backwards = Curve(curve.rest[::-1], case.material, closed=closed, **options).gradient(z[::-1])
    assert largest(backwards[::-1] - gradient) < 1e-7 * largest(gradient)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("name", ["rod", "ribbon", "helix", "ring"])
def test_segments_without_length_and_folded_ones_stay_finite(name: str, real: Any) -> None:
    curve = Curve.of(name, (9, 3), real, WIDTHS[real][1])
    gathered, folded = curve.rest.copy(), curve.rest.copy()
    gathered[3:6] = gathered[3]
    folded[5:] = folded[[3, 2, 1, 0]]
    for z in (gathered, folded, 0 * curve.rest):
        assert np.isfinite(curve.energy(z))
        assert np.isfinite(curve.gradient(z)).all()
        assert np.isfinite(curve.product(noise(curve.rest, 1.0))).all()
        assert np.isfinite(curve.blocks()).all()


def test_gradients_and_products_add_to_what_is_there() -> None:
    curve = Curve.of("helix", SMALL)
    z, before = crumpled(curve.rest), noise(curve.rest, 1.0, 5)
    alone = curve.gradient(z)
    out = curve.upload(before)
    curve.force.add_gradient(None, curve.upload(z), out)
    np.testing.assert_allclose(curve.download(out), before + alone, rtol=1e-15, atol=1e-13 * largest(alone))


def test_a_hessian_product_survives_the_energy_of_another_shape() -> None:
    curve = Curve.of("helical ribbon", SMALL)
    p = noise(curve.rest, 1.0)
    curve.linearise(crumpled(curve.rest))
    product = curve.product(p)
    curve.energy(stretched(curve.rest))
    np.testing.assert_array_equal(curve.product(p), product)


@pytest.mark.parametrize("name", ["string", "rod", "helix", "ring"])
def test_named_kernels_are_those_that_are_launched(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    curve = Curve.of(name, SMALL)
    launched: set[str] = set()
    launch = wp.launch

    def recorded(kernel: wp.Kernel, *arguments: Any, **options: Any) -> None:
        launched.add(f"{kernel.module.name.removeprefix('warpdeform_')}.{kernel.func.__name__}")
        launch(kernel, *arguments, **options)

    monkeypatch.setattr(wp, "launch", recorded)
    body = SimpleNamespace(x=curve.upload(curve.rest), free=curve.upload(np.ones(curve.nodes)))
    band = wp.zeros((band_components(True), curve.layout.rows, curve.layout.columns), dtype=wp.float64, device="cpu")
    curve.energy(curve.rest)
    curve.gradient(curve.rest)
    curve.product(curve.rest)
    curve.blocks()
    curve.force.write_band(body, band)
    curve.force.finish(body)
    named = curve.force.kernels
    assert len(set(named)) == len(named) == len(launched)
    for room, kernel in (name.split(".") for name in named):
        assert any(name.startswith(f"{room}_") and name.endswith(f".{kernel}") for name in launched)


def test_a_curve_launches_and_keeps_only_what_it_needs() -> None:
    bytes_of, kernels_of = {}, {}
    for name, options in {"string": CASES["string"], "rod": CASES["rod"], "twistable": CASES["twistable"]}.items():
        curve = Curve(line(33, 33), options.material, **options.options)
        bytes_of[name], kernels_of[name] = curve.force.bytes(), curve.force.kernels
        assert (curve.force.frames is not None) == (name == "twistable")
    plane = 8 * 35 * 35
    assert bytes_of["string"] < 10 * plane
    assert bytes_of["rod"] < bytes_of["string"] + 17 * plane
    assert bytes_of["twistable"] > bytes_of["rod"] + 30 * plane
    assert not any("frame" in kernel for kernel in kernels_of["rod"])


@pytest.mark.parametrize(
    ("options", "framed"),
    [({"section": ROUND}, False), ({"section": FLAT}, True), ({"section": ROUND, "framed": True}, True)],
)
def test_frames_are_kept_where_something_asks_for_them(options: dict[str, Any], framed: bool) -> None:
    assert (Curve(line(9, 2), RUBBER, **options).force.frames is not None) == framed
    assert Curve(SHAPES["helix"](9, 2), RUBBER, section=ROUND).force.frames is not None
    straight = Curve(SHAPES["helix"](9, 2), RUBBER, section=ROUND, natural=line(9, 2))
    assert straight.force.frames is None
    assert straight.energy(straight.rest) > 0
