"""The referee against exact arithmetic, and in cases that are known."""

from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest

from warpdeform.crossings import closest, crossing_pairs, overlapping, point_distances, segment_distances
from warpdeform.grid import ParameterGrid
from warpdeform.simplices import Simplices

Point = tuple[Fraction, ...]


def minus(a: Point, b: Point) -> Point:
    return tuple(x - y for x, y in zip(a, b, strict=True))


def cross(a: Point, b: Point) -> Point:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def dot(a: Point, b: Point) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))


def side(a: Point, b: Point, c: Point, d: Point) -> Fraction:
    return dot(cross(minus(b, a), minus(c, a)), minus(d, a))


def crosses_exactly(edge: list[Point], triangle: list[Point]) -> bool:
    """Whether a closed edge meets a closed triangle that is none of a line; by signs of volumes, not by axes."""
    (p, q), (a, b, c) = edge, triangle
    above, below = side(a, b, c, p), side(a, b, c, q)
    if above * below > 0:
        return False
    if above == below == 0:
        return meets_in_plane(edge, triangle)
    signs = [side(p, q, u, v) for u, v in ((a, b), (b, c), (c, a))]
    return all(s >= 0 for s in signs) or all(s <= 0 for s in signs)


def meets_in_plane(edge: list[Point], triangle: list[Point]) -> bool:
    a, b, c = triangle
    normal = cross(minus(b, a), minus(c, a))
    drop = max(range(3), key=lambda k: abs(normal[k]))
    flat = [tuple(x for k, x in enumerate(point) if k != drop) for point in (*edge, *triangle)]

    def turn(u: Point, v: Point, w: Point) -> Fraction:
        return (v[0] - u[0]) * (w[1] - u[1]) - (v[1] - u[1]) * (w[0] - u[0])

    def between(u: Point, v: Point, w: Point) -> bool:
        return all(min(u[k], v[k]) <= w[k] <= max(u[k], v[k]) for k in (0, 1))

    def meet(u: Point, v: Point, w: Point, x: Point) -> bool:
        t = (turn(u, v, w), turn(u, v, x), turn(w, x, u), turn(w, x, v))
        if t[0] * t[1] < 0 and t[2] * t[3] < 0:
            return True
        touching = ((t[0], u, v, w), (t[1], u, v, x), (t[2], w, x, u), (t[3], w, x, v))
        return any(s == 0 and between(m, n, o) for s, m, n, o in touching)

    p, q, *corners = flat
    if any(meet(p, q, corners[k], corners[(k + 1) % 3]) for k in range(3)):
        return True
    inside = [turn(corners[k], corners[(k + 1) % 3], p) for k in range(3)]
    return all(s >= 0 for s in inside) or all(s <= 0 for s in inside)


def triangle_soup(points: np.ndarray) -> Simplices:
    return Simplices.of_triangles(len(points), np.arange(len(points)).reshape(-1, 3))


def crossings_exactly(points: np.ndarray, simplices: Simplices) -> list[list[int]]:
    exact = [tuple(Fraction(float(x)) for x in point) for point in points]
    found = []
    for e, edge in enumerate(simplices.edges):
        for t, triangle in enumerate(simplices.triangles):
            if set(edge) & set(triangle):
                continue
            if crosses_exactly([exact[k] for k in edge], [exact[k] for k in triangle]):
                found.append([e, t])
    return found


def full(points: np.ndarray) -> np.ndarray:
    """Triangles that are none of a line."""
    corners = points.reshape(-1, 3, 3)
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return corners[np.abs(areas).sum(axis=1) > 0].reshape(-1, 3)


@pytest.mark.parametrize("seed", range(4))
def test_random_triangles_as_in_exact_arithmetic(seed: int) -> None:
    points = np.random.default_rng(seed).uniform(-1.0, 1.0, (3 * 16, 3))
    soup = triangle_soup(points)
    expected = crossings_exactly(points, soup)
    assert len(expected) > 30
    assert crossing_pairs(points, soup).tolist() == expected


@pytest.mark.parametrize(("seed", "size"), [(0, (3, 3, 3)), (1, (3, 3, 3)), (2, (5, 5, 1)), (3, (8, 8, 2))])
def test_triangles_that_touch_and_lie_in_one_plane_as_in_exact_arithmetic(seed: int, size: tuple[int, ...]) -> None:
    points = full(np.random.default_rng(seed).integers(0, size, (3 * 16, 3)).astype(np.float64))
    soup = triangle_soup(points)
    expected = crossings_exactly(points, soup)
    assert len(expected) > 50
    assert crossing_pairs(points, soup).tolist() == expected


def test_what_rounding_cannot_tell_apart_counts_as_crossing() -> None:
    rng = np.random.default_rng(5)
    for _ in range(40):
        a, b, c = rng.uniform(-1.0, 1.0, (3, 3))
        inside = a + 0.3 * (b - a) + 0.4 * (c - a)  # off the plane by round-off, on either side
        away = inside + rng.choice([-1.0, 1.0]) * np.cross(b - a, c - a)
        simplices = Simplices(5, np.array([[0, 1, 2]]), np.array([[3, 4]]))
        assert len(crossing_pairs(np.array([a, b, c, inside, away]), simplices)) == 1
        lifted = inside + 1e-12 * (away - inside)
        assert len(crossing_pairs(np.array([a, b, c, lifted, away]), simplices)) == 0


def turned_sheet(nodes: tuple[int, int]) -> tuple[np.ndarray, Simplices]:
    """A flat sheet, in no plane of coordinates."""
    u, v = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in nodes), indexing="ij")
    rotation = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    points = np.stack([u, v, 0.0 * u], axis=-1).reshape(-1, 3) @ rotation
    return points, Simplices.of_grid(ParameterGrid(nodes, (1.0, 1.0)))


def test_a_flat_sheet_does_not_cross_itself() -> None:
    points, sheet = turned_sheet((21, 17))
    assert len(crossing_pairs(points, sheet)) == 0
    assert closest(points, sheet, 0.04).distance == np.inf


def test_a_fold_that_goes_through_is_found_and_one_that_does_not_is_measured() -> None:
    sheet = Simplices.of_grid(ParameterGrid((41, 17), (1.0, 1.0)))
    x, v = np.linspace(0.0, 1.0, 41), np.linspace(0.0, 1.0, 17)
    angle = np.clip((x - 0.4) / 0.2 * np.pi, 0.0, np.pi)
    for end, crosses in ((0.02, False), (-0.02, True)):
        # Half a turn of a radius of 6 cm; what follows leads back over, or through, where the sheet begins.
        along = np.minimum(x, 0.4) + 0.06 * np.sin(angle) - np.maximum(x - 0.6, 0.0)
        height = 0.06 * (1.0 - np.cos(angle)) + (end - 0.12) * np.maximum(x - 0.6, 0.0) / 0.4
        points = np.stack([np.repeat(along, 17), np.tile(v + 0.003, 41), np.repeat(height, 17)], axis=-1)
        assert (len(crossing_pairs(points, sheet)) > 0) is crosses
        if not crosses:
            assert closest(points, sheet, 0.03).distance == pytest.approx(0.02, rel=0.1)


def test_a_strand_through_a_sheet_is_found() -> None:
    points, sheet = turned_sheet((9, 9))
    normal = np.cross(points[1] - points[0], points[9] - points[0])
    normal /= np.linalg.norm(normal)
    strand = Simplices.of_strands([6], closed=False)
    both = Simplices.joined([sheet, strand])
    middle = points.mean(axis=0) + 0.2 * (points[1] - points[0]) + 0.1 * (points[9] - points[0])
    for offset, expected in ((0.0, 1), (1.0, 0)):
        line = middle + (np.linspace(-0.5, 0.5, 6) + offset)[:, None] * normal
        pairs = crossing_pairs(np.concatenate([points, line]), both)
        assert len(pairs) == expected
        if expected:
            assert (both.edges[pairs[0, 0]] >= 81).all()
    near = closest(np.concatenate([points, middle + np.linspace(0.02, 0.5, 6)[:, None] * normal]), both, 0.1)
    assert near.distance == pytest.approx(0.02)
    assert near.vertices[0] == (81,)


def test_strands_are_measured_against_each_other() -> None:
    strands = Simplices.of_strands([3, 3], closed=False)
    first = np.array([[-1.0, 0.0, 0.0], [0.1, 0.0, 0.0], [1.0, 0.0, 0.0]])
    second = first[:, [1, 0, 2]] + [0.0, 0.0, 0.05]
    assert closest(np.concatenate([first, second]), strands, 0.2).distance == pytest.approx(0.05)


def test_the_skin_of_a_block_is_closed() -> None:
    skin = Simplices.of_grid(ParameterGrid((3, 4, 5), (1.0, 1.0, 1.0)))
    assert len(skin.triangles) == 2 * 2 * (2 * 3 + 3 * 4 + 4 * 2)
    sides = np.sort(np.concatenate([skin.triangles[:, [0, 1]], skin.triangles[:, [1, 2]], skin.triangles[:, [2, 0]]]))
    assert (np.unique(sides, axis=0, return_counts=True)[1] == 2).all()
    assert len(skin.edges) == len(np.unique(np.sort(sides, axis=1), axis=0))


def test_a_ring_of_strands_and_a_tube_close() -> None:
    ring = Simplices.of_grid(ParameterGrid((5, 2), (1.0, 1.0), (True, False), 1))
    assert sorted(map(tuple, ring.edges.tolist())) == sorted(
        (min(2 * k + s, 2 * ((k + 1) % 5) + s), max(2 * k + s, 2 * ((k + 1) % 5) + s))
        for k in range(5)
        for s in range(2)
    )
    tube = Simplices.of_grid(ParameterGrid((3, 6), (1.0, 1.0), (False, True)))
    assert len(tube.triangles) == 2 * 2 * 6
    assert len(tube.edges) == 3 * 6 + 2 * 6 + 2 * 6


def test_distances_of_points_and_segments_against_sampling() -> None:
    rng = np.random.default_rng(2)
    points, triangles, segments = rng.normal(size=(30, 1, 3)), rng.normal(size=(30, 3, 3)), rng.normal(size=(30, 2, 3))
    s, t = np.meshgrid(np.linspace(0.0, 1.0, 201), np.linspace(0.0, 1.0, 201), indexing="ij")
    u, v = (x[s + t <= 1.0] for x in (s, t))
    inside = triangles[:, :1] + u[:, None] * (triangles[:, 1:2] - triangles[:, :1])
    inside = inside + v[:, None] * (triangles[:, 2:] - triangles[:, :1])
    sampled = np.linalg.norm(inside - points, axis=-1).min(axis=1)
    assert np.abs(point_distances(points, triangles) - sampled).max() < 0.02
    others = rng.normal(size=(30, 2, 3))
    along = segments[:, None, :1] + s[..., None] * (segments[:, None, 1:] - segments[:, None, :1])
    across = others[:, None, :1] + t[..., None] * (others[:, None, 1:] - others[:, None, :1])
    sampled = np.linalg.norm(along - across, axis=-1).min(axis=(1, 2))
    assert np.abs(segment_distances(segments, others) - sampled).max() < 0.02
    parallel = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]])
    assert segment_distances(parallel, parallel + [2.0, 0.0, 1.0]) == pytest.approx(np.sqrt(2.0))
    assert segment_distances(parallel, parallel + [0.5, 0.0, 1.0]) == pytest.approx(1.0)


def test_boxes_that_overlap_are_all_found() -> None:
    rng = np.random.default_rng(3)
    low, other = rng.uniform(0.0, 1.0, (300, 3)), rng.uniform(0.0, 1.0, (170, 3))
    high, upper = low + rng.uniform(0.0, 0.2, (300, 3)), other + rng.uniform(0.0, 0.2, (170, 3))
    found = {pair for i, j in overlapping((low, high), (other, upper), 0.01) for pair in zip(i, j, strict=True)}
    meets = (low[:, None] - 0.01 <= upper[None]).all(axis=2) & (other[None] <= high[:, None] + 0.01).all(axis=2)
    assert found == set(zip(*np.nonzero(meets), strict=True))


def test_every_pair_without_a_common_vertex_counts() -> None:
    points = np.random.default_rng(4).uniform(-1.0, 1.0, (7, 3))
    triangles = np.array(list(combinations(range(7), 3)))
    everything = Simplices.of_triangles(7, triangles)
    assert crossing_pairs(points, everything).tolist() == crossings_exactly(points, everything)
