"""Rest shapes: where the nodes lie, and which grids are refused."""

import math
from pathlib import Path

import numpy as np
import pytest

from warpdeform.errors import InputError
from warpdeform.shape import SHAPES, RestShape, arc, from_array, from_file, from_map, sheet


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


def test_every_named_shape_takes_nodes() -> None:
    assert {"sheet", "arc", "file"} <= set(SHAPES)
    assert SHAPES["sheet"](nodes=[3, 4], size=[1.0, 1.0]).nodes == (3, 4)
