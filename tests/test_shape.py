"""Rest shapes: where the nodes lie, and which grids are refused."""

import math
from pathlib import Path

import numpy as np
import pytest

from warpdeform.errors import InputError
from warpdeform.shape import (
    SHAPES,
    SHAPES_BY_KIND,
    RestShape,
    arc,
    bent_block,
    block,
    from_array,
    from_file,
    from_map,
    helix,
    kind_of_shape,
    line,
    pipe,
    ring,
    root_grid,
    root_line,
    sheet,
    sphere,
    strands,
    torus,
    tube,
)


def refusal(make: object, *arguments: object, **keywords: object) -> str:
    with pytest.raises(InputError) as caught:
        make(*arguments, **keywords)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_sheet_spans_the_xy_plane_from_the_origin() -> None:
    shape = sheet((3, 5), size=(1.0, 2.0))
    assert shape.nodes == (3, 5)
    assert shape.spacing == (0.5, 0.5)
    np.testing.assert_array_equal(shape.positions[0, 0], [0, 0, 0])
    np.testing.assert_array_equal(shape.positions[-1, -1], [1, 2, 0])
    np.testing.assert_array_equal(shape.positions[1, 0], [0.5, 0, 0])
    np.testing.assert_array_equal(shape.positions[0, 1], [0, 0.5, 0])


def test_smallest_sheet() -> None:
    assert sheet([2, 2]).positions.shape == (2, 2, 3)


def test_positions_are_a_read_only_copy() -> None:
    points = sheet((3, 3)).positions.copy()
    shape = from_array(points)
    points[0, 0] = 7.0
    assert shape.positions[0, 0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        shape.positions[0, 0] = 1.0


def test_arc_is_an_arch_of_the_given_radius_and_length() -> None:
    shape = arc((181, 3), radius=2.0, angle=180.0, length=0.5)
    centre = np.array([0.0, 0.0, -2.0])
    radii = np.linalg.norm((shape.positions - centre)[..., [0, 2]], axis=-1)
    np.testing.assert_allclose(radii, 2.0, rtol=1e-14)
    np.testing.assert_allclose(shape.positions[90, 0], [0, 0, 0], atol=1e-15)
    np.testing.assert_allclose(shape.positions[[0, -1], 0], [[-2, 0, -2], [2, 0, -2]], atol=1e-14)
    assert shape.spacing == pytest.approx((2.0 * math.pi / 180, 0.25))
    normal = np.cross(shape.positions[91, 0] - shape.positions[89, 0], shape.positions[90, 1] - shape.positions[90, 0])
    assert normal[2] > 0


def test_from_map_samples_the_function_at_the_nodes() -> None:
    shape = from_map(lambda u, v: np.stack([u, v, u * v], axis=-1), (5, 3), ((-1.0, 1.0), (0.0, 3.0)))
    assert shape.spacing == (0.5, 1.5)
    np.testing.assert_array_equal(shape.positions[0, 2], [-1, 3, -3])


def test_from_array_takes_parameters_in_metres() -> None:
    flat = sheet((4, 3), size=(3.0, 4.0))
    assert from_array(flat.positions).spacing == pytest.approx(flat.spacing)
    assert from_array(flat.positions, spacing=(1.0, 1.0)).spacing == (1.0, 1.0)


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".csv"])
def test_files_hold_grids_and_lists_of_points(tmp_path: Path, suffix: str) -> None:
    path, points = tmp_path / f"rest{suffix}", arc((4, 3)).positions
    if suffix == ".npy":
        np.save(path, points)
    elif suffix == ".npz":
        np.savez(path, positions=points.astype(np.float32))
    else:
        np.savetxt(path, points.reshape(-1, 3), delimiter=",", header="x,y,z", comments="")
    read = from_file(path, nodes=(4, 3))
    np.testing.assert_allclose(read.positions, points, atol=1e-7)
    if suffix == ".csv":
        assert "nodes: is missing" in refusal(from_file, path)
    else:
        assert from_file(path).nodes == (4, 3)
    assert "not 5 x 3 nodes" in refusal(from_file, path, nodes=(5, 3))


def test_unreadable_files_are_refused_in_one_line(tmp_path: Path) -> None:
    for suffix in (".npy", ".npz", ".csv"):
        assert "does not exist" in refusal(from_file, tmp_path / f"none{suffix}")
        broken = tmp_path / f"broken{suffix}"
        broken.write_bytes(b"1,2,3\n4,5\n6,7,8\n" if suffix == ".csv" else b"PK\x03\x04 no array")
        assert "cannot be read" in refusal(from_file, broken, nodes=(2, 2))
    assert "unknown suffix" in refusal(from_file, tmp_path / "rest.obj")
    np.savez(tmp_path / "other.npz", points=np.zeros((2, 2, 3)))
    assert 'no array "positions"' in refusal(from_file, tmp_path / "other.npz")


@pytest.mark.parametrize("nodes", [[1, 5], [5, 1], [0, 0], [-3, 4], [2.5, 4], [4], [4, 4, 4], 4, "44", [True, 4], None])
@pytest.mark.parametrize("make", [sheet, arc])
def test_bad_node_counts_are_refused(make: object, nodes: object) -> None:
    assert refusal(make, nodes).startswith("nodes")


@pytest.mark.parametrize(
    ("make", "key", "value"),
    [
        (sheet, "size", (1.0, 0.0)),
        (sheet, "size", (1.0, math.nan)),
        (sheet, "size", (1.0,)),
        (sheet, "size", "1x1"),
        (arc, "radius", -1.0),
        (arc, "radius", [1.0, 2.0]),
        (arc, "angle", 360.0),
        (arc, "angle", 0.0),
        (arc, "length", math.inf),
    ],
)
def test_bad_sizes_are_refused(make: object, key: str, value: object) -> None:
    assert refusal(make, (3, 3), **{key: value}).startswith(key)


def test_bad_maps_are_refused() -> None:
    assert refusal(from_map, lambda u, _: u, (3, 3), ((0, 1), (0, 1))).startswith("function")
    assert refusal(from_map, lambda u, _: u, (3, 3), ((0, 1), (1, 1))).startswith("extent")
    assert refusal(RestShape, sheet((2, 2)).positions, (0.0, 1.0)).startswith("spacing")


def test_bad_grids_are_refused_with_the_node_that_shows_it() -> None:
    good = sheet((4, 5)).positions
    assert "shape of a surface grid" in refusal(from_array, good[:1])
    assert "shape of a surface grid" in refusal(from_array, good[..., :2])
    infinite = good.copy()
    infinite[2, 3, 1] = math.inf
    assert "node [2, 3]" in refusal(from_array, infinite)
    coincident = good.copy()
    coincident[2, 4] = coincident[2, 3]
    assert "nodes [2, 3] and [2, 4]" in refusal(from_array, coincident)
    coincident = good.copy()
    coincident[2, 1] = coincident[1, 1] + 1e-9
    assert "nodes [1, 1] and [2, 1]" in refusal(from_array, coincident)
    line = from_map(lambda u, v: np.stack([u, v, 0 * u], axis=-1), (3, 3), ((0, 1), (0, 1))).positions.copy()
    line[..., 1] = line[..., 0]
    line[..., 0] = line[..., 0] + 0.3 * np.arange(3)
    line[..., 1] = line[..., 0]
    assert "without area" in refusal(from_array, line)


NODES = {"curve": (17,), "surface": (8, 5), "solid": (7, 5, 4)}


@pytest.mark.parametrize("name", [name for name in SHAPES if name != "file"])
def test_every_named_shape_takes_nodes(name: str) -> None:
    kind = kind_of_shape(name)
    shape = SHAPES[name](nodes=NODES[kind])
    assert shape.kind == kind
    assert shape.nodes == (*NODES[kind], *((1,) if kind == "curve" else ()))
    assert shape.grid.nodes == shape.nodes
    assert shape.grid.dimension == len(NODES[kind])
    # Parameters are metres on the line, circle or sheet that the name is about.
    edges = [np.linalg.norm(shape.grid.differences(shape.positions, k), axis=-1) for k in range(shape.dimension)]
    for length, spacing in zip(edges, shape.spacing, strict=False):
        assert 0.4 < length.max() / spacing < 1.6


def test_kinds_of_shapes() -> None:
    assert kind_of_shape("file") == ""
    assert {name for shapes in SHAPES_BY_KIND.values() for name in shapes} == set(SHAPES) - {"file"}
    assert refusal(RestShape, sheet((2, 2)).positions, (1.0, 1.0), (), "cloth").startswith("kind")


def test_line_helix_and_ring() -> None:
    straight = line((5,), 2.0)
    assert (straight.nodes, straight.spacing, straight.periodic) == ((5, 1), (0.5, 1.0), (False, False))
    np.testing.assert_array_equal(straight.positions[:, 0, 0], [0, 0.5, 1, 1.5, 2])
    coil = helix((401,), radius=0.2, pitch=0.3, turns=2.0)
    length = 2.0 * math.hypot(2 * math.pi * 0.2, 0.3)
    np.testing.assert_allclose(np.linalg.norm(coil.positions[..., 1:], axis=-1), 0.2, rtol=1e-14)
    np.testing.assert_allclose(coil.positions[[0, -1], 0], [[0, 0.2, 0], [0.6, 0.2, 0]], atol=1e-14)
    assert coil.spacing[0] == pytest.approx(length / 400)
    assert coil.positions[1, 0, 2] > 0  # right-handed about x
    circle = ring((12,), 0.3)
    assert circle.periodic == (True, False)
    assert circle.grid.cells == (12, 1)
    np.testing.assert_allclose(np.linalg.norm(circle.positions, axis=-1), 0.3, rtol=1e-14)


def test_strands_are_copies_turned_the_shortest_way() -> None:
    curve = helix((9,), 0.1, 0.2, 1.0)
    roots = root_grid((3, 4), (1.0, 0.5))
    hair = strands(curve, roots, [[0, 0, 1]])
    assert hair.nodes == (9, 12)
    np.testing.assert_allclose(
        hair.positions[..., 2], curve.positions[:, :, 0] + 0 * hair.positions[..., 2], atol=1e-14
    )
    np.testing.assert_allclose(roots[[0, 3, -1]], [[0, 0, 0], [0, 0.5, 0], [1, 0.5, 0]])
    for normal in ([0, 0, 1], [1, 2, -3], [-1, 0, 0], [-1, 1e-9, 0], [1, 0, 0]):
        (turned,) = np.moveaxis(strands(curve, [[0, 0, 0]], [normal]).positions, 1, 0)
        given = curve.positions[:, 0]
        np.testing.assert_allclose(turned @ turned.T, given @ given.T, atol=1e-14)
        assert np.linalg.det(np.linalg.lstsq(given, turned, rcond=None)[0]) == pytest.approx(1.0)
        unit = np.array(normal) / np.linalg.norm(normal)
        np.testing.assert_allclose(turned @ unit, given[:, 0], atol=1e-8)
    fringe = strands(line((4,), 0.1), root_line(5, 0.4))
    np.testing.assert_allclose(fringe.positions[0, :, 1], [0, 0.1, 0.2, 0.3, 0.4])
    assert root_line(1, 0.4).tolist() == [[0, 0, 0]]


def test_strands_that_are_refused() -> None:
    one = line((4,), 0.1)
    assert refusal(strands, sheet((2, 2)), [[0, 0, 0]]).startswith("curve")
    assert refusal(strands, strands(one, root_line(2, 1.0)), [[0, 0, 0]]).startswith("curve")
    assert refusal(strands, one, []).startswith("roots")
    assert refusal(strands, one, [[0, 0]]).startswith("roots")
    assert refusal(strands, one, [[0, 0, math.nan]]).startswith("roots")
    assert refusal(strands, one, "all").startswith("roots")
    assert refusal(strands, one, [[0, 0, 0]], [[0, 0, 0]]).startswith("normals")
    assert "for each of 3 roots" in refusal(strands, one, root_line(3, 1.0), np.ones((2, 3)))


@pytest.mark.parametrize("shape", [tube((24, 5)), torus((24, 16)), sphere((24, 12))], ids=["tube", "torus", "sphere"])
def test_normals_of_closed_surfaces_point_outwards(shape: RestShape) -> None:
    r = shape.grid.closed(shape.positions)
    m1, m2 = r[1:, 1:] - r[:-1, :-1], r[:-1, 1:] - r[1:, :-1]
    centre = 0.25 * (r[1:, 1:] + r[:-1, :-1] + r[:-1, 1:] + r[1:, :-1])
    outwards = centre.copy()
    if shape.periodic == (True, True):
        outwards -= 0.5 * centre * [1, 1, 0] / np.linalg.norm(centre[..., :2], axis=-1, keepdims=True)
    elif shape.spacing[1] == 0.25:
        outwards *= [1, 1, 0]
    assert np.sum(np.cross(m1, m2) * outwards, axis=-1).min() > 0


def test_closed_surfaces_have_their_sizes() -> None:
    cylinder = tube((24, 5), 0.3, 2.0)
    assert (cylinder.periodic, cylinder.grid.cells) == ((True, False), (24, 4))
    np.testing.assert_allclose(np.linalg.norm(cylinder.positions[..., :2], axis=-1), 0.3, rtol=1e-14)
    assert cylinder.positions[..., 2].max() == 2.0
    globe = sphere((24, 12), 0.7)
    np.testing.assert_allclose(np.linalg.norm(globe.positions, axis=-1), 0.7, rtol=1e-14)
    assert np.arcsin(globe.positions[0, -1, 2] / 0.7) == pytest.approx(math.pi / 2 * (1 - 1 / 12))
    assert globe.spacing[1] * 12 == pytest.approx(math.pi * 0.7)
    doughnut = torus((24, 12), 0.7, 0.2)
    out = np.linalg.norm(doughnut.positions[..., :2], axis=-1) - 0.7
    np.testing.assert_allclose(np.hypot(out, doughnut.positions[..., 2]), 0.2, rtol=1e-13)


def test_poles_that_cannot_close_are_named() -> None:
    assert sphere((6, 3)).poles == (True, True)
    assert tube((6, 3)).poles == (False, False)
    assert "must have an even number of at least 6 along u" in refusal(sphere, (7, 5))
    assert "Use for example [8, 5]" in refusal(sphere, (7, 5))
    assert "Use for example [6, 5]" in refusal(sphere, (4, 5))
    globe, around = sphere((8, 5)).positions, (True, False)
    closed = {"periodic": around, "poles": (True, True)}
    assert from_array(globe, **closed).grid.poles == (True, True)
    assert "has 7 nodes along u, of which every one needs another" in refusal(from_array, globe[:7], **closed)
    assert refusal(from_array, globe, poles=(True, True)).startswith("poles")
    assert "must be two of true and false" in refusal(from_array, globe, periodic=around, poles=(True,))
    assert refusal(from_array, torus((8, 6)).positions, periodic=(True, True), poles=(True, True)).startswith("poles")
    # A tube is no ball: what lies across its end is far away.
    wide = refusal(from_array, tube((8, 5), 0.5, 0.5).positions, **closed)
    assert "does not close at the start of v: the node across from [0, 0] is 8 steps of v away" in wide
    shuffled = globe.copy()
    shuffled[[1, 2], 0] = shuffled[[2, 1], 0]
    assert "crosses itself in the pole at the start of v" in refusal(from_array, shuffled, **closed)
    lifted = np.swapaxes(globe, 0, 1)
    assert from_array(lifted, periodic=(False, True), poles=(True, True)).grid.rings[1][3].tolist() == [4, 3]


def test_solids_are_right_handed_and_have_their_sizes() -> None:
    brick = block((3, 4, 5), (1.0, 2.0, 0.5))
    np.testing.assert_array_equal(brick.positions[-1, -1, -1], [1.0, 2.0, 0.5])
    assert brick.spacing == pytest.approx((0.5, 2 / 3, 0.125))
    arch = bent_block((91, 2, 3), (1.0, 0.2, 0.1), 180.0)
    middle = np.linalg.norm(np.diff(arch.positions[:, 0, 1], axis=0), axis=-1).sum()
    assert middle == pytest.approx(1.0, rel=1e-4)
    np.testing.assert_allclose(arch.positions[45, 0, 1], [0, 0, 0], atol=1e-15)
    assert arch.positions[..., 2].max() == pytest.approx(0.05)
    wall = pipe((24, 3, 4), 0.5, 2.0, 0.1)
    radii = np.linalg.norm(wall.positions[..., :2], axis=-1)
    assert wall.periodic == (True, False, False)
    np.testing.assert_allclose(radii, np.broadcast_to(np.linspace(0.45, 0.55, 4), radii.shape), rtol=1e-13)


@pytest.mark.parametrize(
    ("make", "nodes", "sizes", "key"),
    [
        (line, (1,), {}, "nodes"),
        (line, (4, 4), {}, "nodes"),
        (line, (4,), {"length": 0.0}, "length"),
        (helix, (4,), {"turns": -1.0}, "turns"),
        (helix, (15,), {"turns": 5.0}, "nodes"),
        (helix, (4,), {"pitch": 0.0}, "pitch"),
        (ring, (2,), {}, "nodes"),
        (ring, (8,), {"radius": math.inf}, "radius"),
        (tube, (2, 5), {}, "nodes"),
        (torus, (5, 2), {}, "nodes"),
        (torus, (5, 5), {"tube_radius": 0.6}, "tube_radius"),
        (sphere, (2, 5), {}, "nodes"),
        (block, (4, 4), {}, "nodes"),
        (block, (4, 4, 1), {}, "nodes"),
        (block, (4, 4, 4), {"size": (1.0, 1.0)}, "size"),
        (bent_block, (4, 4, 4), {"angle": 360.0}, "angle"),
        (bent_block, (4, 4, 4), {"size": (1.0, 1.0, 1.5), "angle": 90.0}, "angle"),
        (pipe, (4, 4, 4), {"thickness": 1.0}, "thickness"),
    ],
)
def test_bad_sizes_of_all_kinds(make: object, nodes: tuple[int, ...], sizes: dict[str, object], key: str) -> None:
    assert refusal(make, nodes, **sizes).startswith(key)


def test_maps_of_every_number_of_parameters() -> None:
    curve = from_map(lambda u: np.stack([u, u**2, 0 * u], -1), (5,), ((0, 2),))
    assert (curve.kind, curve.nodes, curve.spacing) == ("curve", (5, 1), (0.5, 1.0))
    solid = from_map(lambda u, v, w: np.stack([u, v, w + u * v], -1), (3, 4, 5), ((0, 1), (0, 1), (0, 1)))
    assert (solid.kind, solid.nodes) == ("solid", (3, 4, 5))
    closed = from_map(lambda u: np.stack([np.cos(u), np.sin(u), 0 * u], -1), (8,), ((0, 2 * math.pi),), (True,))
    assert closed.spacing[0] == pytest.approx(math.pi / 4)
    assert refusal(from_map, lambda u: u, (5,), ((0, 1), (0, 1))).startswith("extent")
    assert refusal(from_map, lambda u: u, (2,), ((0, 1),), (True,)).startswith("nodes")


def test_arrays_of_every_kind() -> None:
    assert from_array(line((5,), 2.0).positions[:, 0]).kind == "curve"
    assert from_array(line((5,), 2.0).positions[:, 0]).spacing == (0.5, 1.0)
    fringe = from_array(strands(line((5,), 2.0), root_line(3, 1.0)).positions, kind="curve")
    assert (fringe.kind, fringe.nodes) == ("curve", (5, 3))
    around = from_array(tube((24, 5)).positions, periodic=(True, False))
    assert around.spacing == pytest.approx(tube((24, 5)).spacing, rel=0.01)
    assert from_array(block((3, 4, 5)).positions).kind == "solid"
    assert "must be 3 of true and false" in refusal(from_array, block((3, 4, 5)).positions, None, (True,))
    assert "at least 2 nodes: a strand of one node" in refusal(from_array, np.zeros((1, 4, 3)), kind="curve")


def test_files_of_every_kind(tmp_path: Path) -> None:
    path = tmp_path / "rest.npy"
    np.save(path, tube((8, 5)).positions.reshape(-1, 3))
    assert from_file(path, (8, 5), (True, False)).grid.cells == (8, 4)
    np.save(path, block((3, 4, 5)).positions.reshape(-1, 3))
    assert from_file(path, (3, 4, 5)).kind == "solid"
    np.save(path, line((5,)).positions[:, 0])
    assert from_file(path, (5,)).nodes == (5, 1)
    assert from_file(path, kind="curve").nodes == (5, 1)
    np.save(path, strands(line((5,)), root_line(3, 1.0)).positions)
    assert from_file(path, kind="curve").nodes == (5, 3)
    assert from_file(path, (5, 3), kind="curve").nodes == (5, 3)
    assert "is not 4 x 3 nodes" in refusal(from_file, path, (4, 3), kind="curve")


def test_poles_seams_and_shapes_that_touch_themselves_are_named() -> None:
    def globe(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.stack([np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)], -1)

    whole, half = ((0, 2 * math.pi), (-math.pi / 2, math.pi / 2)), ((0, 2 * math.pi), (0, math.pi / 2))
    assert "has a pole: no edge along u has a length at the start of v" in refusal(
        from_map, globe, (8, 5), whole, (True, False)
    )
    assert "at the end of v. Let v end half a step" in refusal(from_map, globe, (8, 5), half, (True, False))
    assert "Let v start half a step beside the pole, and say so with poles" in refusal(
        from_map, globe, (8, 5), whole, (True, False)
    )
    # The seam's nodes given twice, as a file from elsewhere has them.
    doubled = np.concatenate([tube((8, 5)).positions, tube((8, 5)).positions[:1]])
    assert "coincides at nodes [8, 0] and [0, 0]" in refusal(from_array, doubled, None, (True, False))
    eight = ((0, 2 * math.pi),)
    crossing = refusal(from_map, lambda u: np.stack([np.cos(u), np.sin(2 * u), 0 * u], -1), (64,), eight, (True,))
    assert "touches itself: nodes [16, 0] and [48, 0]" in crossing
    # Two strands at one place, and an open curve that crosses itself, are for their owner to judge.
    strands(ring((8,)), np.zeros((2, 3)))
    from_map(lambda u: np.stack([np.cos(u), np.sin(2 * u), 0 * u], -1), (65,), eight)
    mirrored = block((3, 3, 3)).positions * [1, 1, -1]
    assert "is left-handed" in refusal(from_array, mirrored)
    folded = block((3, 3, 3)).positions.copy()
    folded[0, 0, 0] = [0.9, 0.9, 0.9]
    folded[1, 0, 0], folded[0, 1, 0], folded[0, 0, 1] = [0.1, 0.9, 0.9], [0.9, 0.1, 0.9], [0.9, 0.9, 0.1]
    assert "cell at node [0, 0, 0] without volume, or inside out" in refusal(from_array, folded)
