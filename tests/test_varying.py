"""Quantities that vary over a body: arrays, functions, images and files, on grids of every kind."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from warpdeform.array_file import read_array
from warpdeform.errors import InputError
from warpdeform.grid import ParameterGrid
from warpdeform.varying import FORMATS, Varying

Array = np.ndarray[Any, Any]

OPEN = ParameterGrid((5, 4), (0.1, 0.1))
CLOSED = ParameterGrid((6, 4), (0.1, 0.1), (True, False))
STRANDS = ParameterGrid((5, 3), (0.1, 1.0), dimension=1)
SOLID = ParameterGrid((3, 4, 5), (0.1, 0.1, 0.1))


def refusal(call: Callable[..., Any], *arguments: Any, **options: Any) -> str:
    with pytest.raises(InputError) as caught:
        call(*arguments, **options)
    return str(caught.value)


@pytest.mark.parametrize("grid", [OPEN, CLOSED, STRANDS, SOLID], ids=["open", "closed", "strands", "solid"])
def test_values_per_node_and_per_cell_stay_what_they_are(grid: ParameterGrid) -> None:
    nodes = np.random.default_rng(0).uniform(size=grid.nodes)
    given = Varying(nodes)
    np.testing.assert_array_equal(given.at_nodes(grid), nodes)
    assert given.at_cells(grid).shape == grid.cells
    first = (0,) * len(grid.nodes)
    corners = [slice(0, 2)] * grid.dimension + [0] * (len(grid.nodes) - grid.dimension)
    assert given.at_cells(grid)[first] == pytest.approx(nodes[tuple(corners)].mean())
    cells = np.random.default_rng(1).uniform(size=grid.cells)
    given = Varying(cells)
    np.testing.assert_array_equal(given.at_cells(grid), cells)
    assert given.at_nodes(grid).shape == grid.nodes
    if not any(grid.periodic):
        assert given.at_nodes(grid)[first] == pytest.approx(cells[first])
    even = Varying(np.full(grid.cells, 3.0))
    np.testing.assert_allclose(even.at_nodes(grid), 3.0, rtol=1e-15)


def test_one_strand_stands_for_all() -> None:
    given = Varying([1.0, 2.0, 3.0, 4.0, 5.0])
    np.testing.assert_array_equal(given.at_nodes(STRANDS), np.repeat([[1.0], [2], [3], [4], [5]], 3, axis=1))
    np.testing.assert_array_equal(given.at_cells(STRANDS)[:, 2], [1.5, 2.5, 3.5, 4.5])


def test_functions_get_parameters_from_nought_to_one() -> None:
    given = Varying(lambda u, v: 2 * u + v)
    np.testing.assert_allclose(given.at_nodes(OPEN)[[0, 0, -1], [0, -1, -1]], [0.0, 1.0, 3.0])
    np.testing.assert_allclose(given.at_cells(OPEN)[0, 0], 2 * 0.125 + 1 / 6)
    np.testing.assert_allclose(given.at_nodes(CLOSED)[-1, 0], 2 * 5 / 6)
    np.testing.assert_allclose(Varying(lambda u, v, w: w).at_nodes(SOLID)[1, 2], [0.0, 0.25, 0.5, 0.75, 1.0])
    np.testing.assert_array_equal(Varying(lambda u, v: 7.0).at_cells(OPEN), np.full((4, 3), 7.0))
    strand = Varying(lambda u, strand: u + 10 * strand).at_nodes(STRANDS)
    np.testing.assert_allclose(strand[:, 2], 10.0 + np.linspace(0, 1, 5))


def test_images_are_linear_between_the_middles_of_their_pixels() -> None:
    ramp = Varying.image(np.add.outer(np.arange(4.0), 10 * np.arange(3.0)))
    u, v = np.moveaxis(OPEN.parameters(), -1, 0)
    expected = np.clip(4 * u - 0.5, 0, 3) + 10 * np.clip(3 * v - 0.5, 0, 2)
    np.testing.assert_allclose(ramp.at_nodes(OPEN), expected, rtol=1e-14)
    # As many pixels as cells: each has its own.
    pixels = np.random.default_rng(2).uniform(size=OPEN.cells)
    np.testing.assert_allclose(Varying.image(pixels).at_cells(OPEN), pixels, rtol=1e-13)
    # Around a tube the last pixel leads on to the first one.
    round_ = Varying.image(np.array([[0.0, 0.0], [1.0, 1.0]]))
    np.testing.assert_allclose(round_.at_nodes(CLOSED)[0], 0.5)
    np.testing.assert_allclose(round_.at_nodes(OPEN)[0], 0.0)


def test_fine_images_are_averaged_and_thin_lines_are_not_lost() -> None:
    grid = ParameterGrid((9, 9), (0.1, 0.1))
    for at in range(0, 512, 7):
        line = np.zeros((512, 1))
        line[at] = 1.0
        found = Varying.image(line).at_cells(grid)
        np.testing.assert_allclose(found[:, 0], np.where(np.arange(8) == at * 8 // 512, 1 / 64, 0), atol=1e-15)


@pytest.mark.parametrize(("header", "pixels"), [
    (b"P5\n# a comment\n3 2\n255\n", bytes([0, 51, 102, 153, 204, 255])),
    (b"P2 3 2 # so wide\n255\n", b"0 51 102\n153 204 255 # the end\n"),
    (b"P5 3 2 65535 ", np.array([0, 13107, 26214, 39321, 52428, 65535], dtype=">u2").tobytes()),
])  # fmt: skip
def test_pictures_have_u_to_the_right_and_v_upwards(tmp_path: Path, header: bytes, pixels: bytes) -> None:
    path = tmp_path / "hem.pgm"
    path.write_bytes(header + pixels)
    found = Varying.image(path, range=(1.0, 2.0))
    np.testing.assert_allclose(found.values, 1.0 + np.array([[0.6, 0.0], [0.8, 0.2], [1.0, 0.4]]), rtol=1e-4)
    assert found.name == str(path)
    assert found.bounds == pytest.approx((1.0, 2.0))


def test_files_hold_arrays_with_u_first(tmp_path: Path) -> None:
    values = np.arange(20.0).reshape(5, 4)
    np.save(tmp_path / "a.npy", values)
    np.savez(tmp_path / "a.npz", values=values)
    np.savetxt(tmp_path / "a.csv", values, delimiter=",")
    for suffix in ("npy", "npz", "csv"):
        np.testing.assert_array_equal(Varying.file(tmp_path / f"a.{suffix}").at_nodes(OPEN), values)
    np.testing.assert_allclose(Varying.image(tmp_path / "a.npy").at_nodes(OPEN)[0, 0], 0.0)
    assert read_array(tmp_path / "a.npz", "path", "values", "").shape == (5, 4)


def test_wrong_sizes_are_named() -> None:
    wrong = Varying(np.ones((7, 4)))
    assert "has the shape 7 x 4, which is that of neither nodes nor cells" in refusal(wrong.at_nodes, OPEN)
    assert "Give 5 x 4 values, one per node, or 4 x 3, one per cell" in refusal(wrong.at_cells, OPEN)
    flat = Varying.image(np.ones((7, 4)))
    assert "has 7 x 4 pixels for a body of 3 axes" in refusal(flat.at_cells, SOLID)
    assert "has one pixel, which does not vary" in refusal(Varying.image, np.ones((1, 1)))
    assert refusal(Varying, np.zeros((0, 3))).startswith("values = [0, 3]: is neither an array")
    assert "is neither an array of numbers nor a function" in refusal(Varying, "hem")
    assert "is not finite at [1, 0]" in refusal(Varying, [[1.0, 2.0], [np.nan, 3.0]])


def test_wrong_ranges_are_named(tmp_path: Path) -> None:
    np.save(tmp_path / "mm.npy", np.array([[0.0, 1.0], [2.0, 3.0]]))
    said = refusal(Varying.image, tmp_path / "mm.npy", range=(0.0, 1e-3))
    assert "holds values from 0 to 3, which do not lie within 0 to 1" in said
    assert "mm.npy" in said
    for bad in ((1.0,), (0.0, np.inf), "all", (1, 2, 3)):
        assert refusal(Varying.image, np.zeros((2, 2)), range=bad).startswith("range")
    assert Varying.image(np.array([[0.0, 1.0], [2.0, 3.0]])).bounds == (0.0, 3.0)


def test_functions_that_fail_are_named() -> None:
    assert "is a function that fails" in refusal(Varying(lambda u: u).at_nodes, OPEN)
    assert "is a function that fails" in refusal(Varying(lambda u, v: np.ones(3)).at_nodes, OPEN)
    with np.errstate(divide="ignore"):
        said = refusal(Varying(lambda u, v: 1.0 / (u - 0.5)).at_nodes, OPEN)
    assert "is a function that is not finite at the parameters [0.5, 0.0]" in said


@pytest.mark.parametrize(
    ("name", "data", "problem"),
    [
        ("a.png", b"\x89PNG", 'has the unknown suffix ".png"'),
        ("a.pgm", b"P6 1 1 255 abc", "is no grey picture in the format P2 or P5"),
        ("a.pgm", b"P5 3 2 255 \x00", "does not hold 3 x 2 grey values"),
        ("a.pgm", b"P2 2 2 255 1 2 3 256", "does not hold 2 x 2 grey values from 0 to 255"),
        ("a.pgm", b"P2 2 2 255 1 2 3 x", "does not hold 2 x 2 grey values"),
        ("a.npy", b"nothing", "cannot be read"),
    ],
)
def test_unreadable_images_are_named(tmp_path: Path, name: str, data: bytes, problem: str) -> None:
    (tmp_path / name).write_bytes(data)
    said = refusal(Varying.image, tmp_path / name)
    assert said.startswith("image")
    assert problem in said
    assert FORMATS in said
    assert ("Image programs save grey pictures as .pgm" in said) == (name == "a.png")


def test_missing_files_are_named(tmp_path: Path) -> None:
    for call in (Varying.image, Varying.file):
        for name in ("none.npy", "none.pgm") if call is Varying.image else ("none.npy",):
            assert "does not exist" in refusal(call, tmp_path / name)
    np.savez(tmp_path / "b.npz", thickness=np.ones((2, 2)))
    assert 'has no array "values"' in refusal(Varying.file, tmp_path / "b.npz")
