"""Pairs of points and triangles, edges and edges: which there are, and what they do."""

import functools
from typing import Any

import numpy as np
import pytest
from contacts import GAP, Scene, expected_pairs, folded, touching, wrinkled

import warpdeform as wd
from warpdeform.crossings import crossing_pairs, point_distances, segment_distances

Array = np.ndarray[Any, Any]

KINDS = ["folded", "stacked"]
WIDTHS = {"float64": (1, 8), "float32": (1, 16)}


@functools.cache
def scene(kind: str, precision: str = "float64", lane_width: int | None = None) -> tuple[Scene, tuple[Array, ...]]:
    """One sheet folded over itself, or two that lie on each other, and where they are."""
    if kind == "folded":
        shape, x = folded((19, 18), 0.9 * GAP)
        return Scene([shape], precision=precision, lane_width=lane_width), (x,)
    (lower, x), (upper, y) = wrinkled((14, 9), 1, 0.002), wrinkled((9, 12), 2, 0.002)
    y = y * [0.8, 1.1, 1.0] + [0.11, -0.03, 0.8 * GAP]
    return Scene([lower, upper], precision=precision, lane_width=lane_width), (x, y)


def joined(positions: tuple[Array, ...]) -> Array:
    return np.concatenate([x.reshape(-1, 3) for x in positions])


def turned(positions: tuple[Array, ...]) -> list[Array]:
    rotation = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    return [x @ (rotation * np.linalg.det(rotation)) + [0.3, -0.2, 0.7] for x in positions]


@pytest.mark.parametrize("kind", KINDS)
def test_points_feel_the_triangles_that_the_definition_names(kind: str) -> None:
    s, positions = scene(kind)
    s.linearise(positions)
    cutoff = s.system.touching[0].cutoff
    points, far, _ = s.pairs()
    expected = expected_pairs(joined(positions), s.simplices, cutoff)
    assert points == expected
    assert len(points) > 100
    assert crossing_pairs(joined(positions), s.simplices).size == 0
    assert all(set(edge[:2]).isdisjoint(edge[2:]) for edge in far)


def test_edges_feel_each_other_where_ridges_cross_and_where_they_are_close() -> None:
    # Two roofs, one upside down: their ridges cross in the middle of an edge each.
    shape = wd.sheet((3, 5), (0.2, 0.4))
    roof = shape.positions - [0.1, 0.25, 0.0]
    roof[..., 2] -= 0.5 * np.abs(roof[..., 0])
    other = roof[..., [1, 0, 2]] * [1.0, 1.0, -1.0] + [0.0, 0.0, 0.5 * GAP]
    for lift, where in ((0.0, 1), (-0.45 * GAP, 1), (2.0 * GAP, None)):
        s = Scene([shape, shape])
        x = [roof, other + [0.0, 0.0, lift]]
        s.linearise(x)
        _, far, close = s.pairs()
        ridges = {(7, 8, 15 + 7, 15 + 8)}
        assert (far == ridges) is (where == 1)
        assert not close & far
    # Flat sheets, edge over edge: only when they are very close.
    flat = wd.sheet((3, 3), (0.2, 0.2)).positions
    for distance, expected in ((0.5 * GAP, False), (0.09 * GAP, True)):
        s = Scene([wd.sheet((3, 3), (0.2, 0.2))] * 2)
        s.linearise([flat, flat + [0.05, 0.033, distance]])
        _, far, close = s.pairs()
        assert (len(close) > 0) is expected
        edges, points = s.simplices.edges, joined((flat, flat + [0.05, 0.033, distance]))
        for a, b, c, d in close:
            near = segment_distances(points[[[a, b]]], points[[[c, d]]])[0]
            assert near < 0.1 * GAP
        assert len(edges) == 32


def test_what_is_near_at_rest_does_not_feel_each_other() -> None:
    # A tube so narrow that its walls lie within each other's reach, at rest and squeezed.
    shape = wd.tube((5, 12), radius=0.4 * GAP, length=0.02)
    s = Scene([shape])
    rest, cutoff = shape.positions.reshape(-1, 3), s.system.touching[0].cutoff
    assert len(expected_pairs(rest, s.simplices, cutoff)) > 20
    s.linearise([shape.positions])
    assert s.pairs()[0] == set()
    squeezed = shape.positions * [0.8, 1.0, 1.0]
    s.system.reset()
    s.linearise([squeezed])
    pairs = np.array(sorted(expected_pairs(squeezed.reshape(-1, 3), s.simplices, cutoff)))
    now, then = (point_distances(x[pairs[:, :1]], x[pairs[:, 1:]]) for x in (squeezed.reshape(-1, 3), rest))
    expected = pairs[now < 0.9 * then]
    assert 0 < len(expected) < len(pairs)
    assert s.pairs()[0] == {tuple(pair) for pair in expected.tolist()}


def test_thickness_shifts_the_field() -> None:
    shape = wd.sheet((4, 4), (0.3, 0.3))
    flat, results = shape.positions, []
    for offset in (0.0, 0.02):
        s = Scene([shape, shape], offset=offset)
        x = [flat, flat + [0.03, 0.02, 0.6 * GAP + offset]]
        s.linearise(x)
        results.append(s.gradient()[[5, 6, 9, 10, 21, 22, 25, 26]])  # at borders the way between them is not upright
    assert np.abs(results[0]).max() > 0.0
    assert np.abs(results[0] - results[1]).max() < 1e-9 * np.abs(results[0]).max()


def test_only_named_pairs_feel_each_other() -> None:
    shape = wd.sheet((5, 5), (0.3, 0.3))
    layers = [shape.positions + [0.01 * k, 0.02 * k, 0.6 * GAP * k] for k in range(3)]
    s = Scene([shape] * 3, pairs=[touching(0, 1)])
    s.linearise(layers)
    points = s.pairs()[0]
    bodies = {(p // 25, t // 25) for p, t, *_ in points}
    assert bodies == {(0, 1), (1, 0)}


@pytest.mark.parametrize("kind", KINDS)
def test_gradient_is_the_derivative_of_the_energy(kind: str) -> None:
    s, positions = scene(kind)
    s.linearise(positions)
    gradient = s.gradient()
    nodes = np.flatnonzero(np.abs(gradient).max(axis=1) > 0.0)
    assert len(nodes) > 60
    rng = np.random.default_rng(0)
    x, step = joined(positions), 1e-7
    for _ in range(6):
        direction = np.zeros_like(x)
        direction[nodes] = rng.normal(size=(len(nodes), 3))
        change = s.energy(s.split(x + step * direction)) - s.energy(s.split(x - step * direction))
        expected = float(np.sum(gradient * direction))
        assert change / (2.0 * step) == pytest.approx(expected, rel=2e-5, abs=1e-5 * np.abs(gradient).max())


def test_hessian_is_the_derivative_of_the_gradient_where_normals_do_not_turn() -> None:
    shape = wd.sheet((6, 6), (0.3, 0.3))
    x = [shape.positions, 0.7 * shape.positions + [0.04, 0.05, 0.7 * GAP]]
    s = Scene([shape] * 2, pairs=[touching(0, 1)])
    rng = np.random.default_rng(1)
    direction = rng.uniform(size=(2, 1)).repeat(36, axis=0) * [0.0, 0.0, 1.0]
    s.linearise(x)
    product = s.product(direction)
    step, sides = 1e-6 * GAP, []
    for sign in (1.0, -1.0):
        s.linearise([a + sign * step * d for a, d in zip(x, s.split(direction), strict=True)])
        sides.append(s.gradient())
    expected = (sides[0] - sides[1]) / (2.0 * step)
    assert np.abs(product - expected).max() < 1e-5 * np.abs(expected).max()


@pytest.mark.parametrize("kind", KINDS)
def test_hessian_is_symmetric_positive_and_its_blocks_are_its_diagonal(kind: str) -> None:
    s, positions = scene(kind)
    s.linearise(positions)
    rng = np.random.default_rng(2)
    size = len(joined(positions))
    p, q = rng.normal(size=(2, size, 3))
    Hp, Hq = s.product(p), s.product(q)
    scale = np.linalg.norm(Hp) * np.linalg.norm(q)
    assert abs(np.sum(q * Hp) - np.sum(p * Hq)) < 1e-12 * scale
    assert np.sum(p * Hp) > 0.0
    blocks = s.blocks()
    for node in rng.choice(np.flatnonzero(np.abs(blocks).max(axis=(1, 2)) > 0.0), 5, replace=False):
        for axis in range(3):
            unit = np.zeros((size, 3))
            unit[node, axis] = 1.0
            assert np.abs(s.product(unit)[node] - blocks[node, :, axis]).max() < 1e-12 * np.abs(blocks).max()


@pytest.mark.parametrize("kind", KINDS)
def test_forces_add_up_to_nothing_and_turn_with_the_bodies(kind: str) -> None:
    s, positions = scene(kind)
    s.linearise(positions)
    gradient, energy = s.gradient(), s.energy(positions)
    size = np.abs(gradient).sum()
    assert np.abs(gradient.sum(axis=0)).max() < 1e-13 * size
    assert np.abs(np.cross(joined(positions), gradient).sum(axis=0)).max() < 1e-13 * size
    rotated = turned(positions)
    s.linearise(rotated)
    rotation = np.linalg.lstsq(joined(positions) - joined(positions).mean(axis=0),
                               joined(tuple(rotated)) - joined(tuple(rotated)).mean(axis=0), rcond=None)[0]  # fmt: skip
    assert s.energy(rotated) == pytest.approx(energy, rel=1e-9)
    assert np.abs(s.gradient() - gradient @ rotation).max() < 1e-7 * np.abs(gradient).max()


@pytest.mark.parametrize("kind", KINDS)
def test_lane_widths_agree_to_the_bit_and_precisions_closely(kind: str) -> None:
    results = {}
    for precision, widths in WIDTHS.items():
        for width in widths:
            s, positions = scene(kind, precision, width)
            s.linearise(positions)
            p = np.random.default_rng(3).normal(size=joined(positions).shape)
            results[precision, width] = (s.gradient(), s.product(p), s.blocks(), s.energy(positions))
    for precision, (narrow, wide) in WIDTHS.items():
        for a, b in zip(results[precision, narrow], results[precision, wide], strict=True):
            assert np.array_equal(a, b)
    for a, b in zip(results["float64", 8], results["float32", 16], strict=True):
        assert np.abs(np.subtract(a, b)).max() < 1e-3 * np.abs(a).max()


def test_a_list_is_used_again_until_nodes_have_moved() -> None:
    s, positions = scene("stacked")
    s.linearise(positions)
    before = s.pairs()
    moved = [positions[0], positions[1] + [0.19 * GAP, -0.19 * GAP, 0.0]]
    s.linearise(moved)
    assert s.pairs() == before
    gradient = s.gradient()
    s.linearise([positions[0], positions[1] + [0.21 * GAP, -0.19 * GAP, 0.0]])
    assert s.pairs() != before
    s.system.reset()
    s.linearise(moved)
    assert s.pairs() != before
    assert np.abs(s.gradient() - gradient).max() < 0.1 * np.abs(gradient).max()


def test_what_does_not_fit_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    shape = wd.sheet((9, 9), (0.3, 0.3))
    x = [shape.positions, shape.positions + [0.011, 0.013, 0.5 * GAP]]
    full = Scene([shape] * 2, pairs=[touching(0, 1)])
    full.linearise(x)
    length, _, lost = full.system.list.counts.numpy()
    assert lost == 0
    for name, value in (("ROW_CAPACITY", 8), ("PAIRS_PER_NODE", 0.5)):
        with monkeypatch.context() as patch:
            patch.setattr(f"warpdeform.forces.contact.{name}", value)
            s = Scene([shape] * 2, pairs=[touching(0, 1)])
        s.system.begin()
        s.linearise(x)
        kept, _, lost = s.system.list.counts.numpy()
        assert kept + lost == length
        assert lost > 0
        assert np.abs(s.gradient().sum(axis=0)).max() < 1e-12 * np.abs(s.gradient()).sum()
