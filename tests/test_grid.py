"""The parameter grid and its memory layout."""

import numpy as np
import pytest
from surfaces import GRIDS

from warpdeform.grid import Layout, ParameterGrid

WIDTHS = [1, 8, 16]


@pytest.mark.parametrize(
    ("periodic", "cells"), [((False, False), (3, 6)), ((True, False), (4, 6)), ((False, True), (3, 7))]
)
def test_periodic_axes_have_as_many_cells_as_nodes(periodic: tuple[bool, bool], cells: tuple[int, int]) -> None:
    grid = ParameterGrid((4, 7), (0.1, 0.2), periodic)
    assert grid.cells == cells
    assert grid.node_count == 28


@pytest.mark.parametrize("nodes", GRIDS, ids=str)
def test_parameters_run_from_nought_to_one(nodes: tuple[int, int]) -> None:
    a = ParameterGrid(nodes, (0.3, 0.4)).parameters()
    assert a.shape == (*nodes, 2)
    assert a[0, 0].tolist() == [0.0, 0.0]
    assert a[-1, -1].tolist() == [1.0, 1.0]
    np.testing.assert_allclose(a[1, 0], [1 / (nodes[0] - 1), 0])
    np.testing.assert_allclose(a[0, 1], [0, 1 / (nodes[1] - 1)])


def test_last_parameter_of_a_periodic_axis_is_one_cell_short() -> None:
    a = ParameterGrid((4, 5), (0.3, 0.4), (True, False)).parameters()
    np.testing.assert_allclose(a[-1, -1], [0.75, 1.0])


@pytest.mark.parametrize("nodes", GRIDS, ids=str)
def test_nodes_share_what_their_cells_have(nodes: tuple[int, int]) -> None:
    grid = ParameterGrid(nodes, (0.3, 0.4))
    even = grid.cells_to_nodes(np.full(grid.cells, 4.0))
    trapezoid = [np.where(np.isin(np.arange(n), (0, n - 1)), 1.0, 2.0) for n in nodes]
    np.testing.assert_allclose(even, np.outer(*trapezoid))
    cells = np.random.default_rng(0).uniform(size=grid.cells)
    assert grid.cells_to_nodes(cells).sum() == pytest.approx(cells.sum(), rel=1e-13)


def test_cells_of_a_periodic_axis_share_around_the_seam() -> None:
    grid = ParameterGrid((4, 3), (0.3, 0.4), (True, False))
    cells = np.zeros((4, 2))
    cells[3, 0] = 4.0
    shares = grid.cells_to_nodes(cells)
    assert shares[[3, 0], :2].tolist() == [[1.0, 1.0], [1.0, 1.0]]
    assert shares.sum() == 4.0


def test_parameters_around_poles_leave_room_for_them() -> None:
    both = ParameterGrid((6, 4), (0.3, 0.4), (True, False), poles=(True, True)).parameters()
    np.testing.assert_allclose(both[0, :, 1], [0.125, 0.375, 0.625, 0.875])
    start = ParameterGrid((3, 6), (0.3, 0.4), (False, True), poles=(True, False)).parameters()
    np.testing.assert_allclose(start[:, 0, 0], [0.2, 0.6, 1.0])


def test_grids_around_poles_stay_even_and_are_coarsened_around_them_first() -> None:
    grid: ParameterGrid | None = ParameterGrid((50, 33), (0.1, 0.1), (True, False), poles=(True, True))
    lengths, seen = (0.06, 0.1), []
    while grid is not None:
        seen.append(grid.nodes)
        assert grid.nodes[0] % 2 == 0
        assert grid.poles == (True, True)
        before, grid = grid, grid.coarser(lengths)
        if grid is not None:
            lengths = tuple(length * s / b for length, s, b in zip(lengths, grid.spacing, before.spacing, strict=True))
    assert seen[:4] == [(50, 33), (26, 33), (14, 33), (8, 17)]
    assert seen[-1][0] == 4


def test_rings_are_the_nodes_around_the_poles() -> None:
    north, south = ParameterGrid((6, 3), (1.0, 1.0), (True, False), poles=(True, True)).rings
    assert north.tolist() == [[i, 0] for i in range(6)]
    assert south.tolist() == [[i, 2] for i in range(6)]
    (ring,) = ParameterGrid((3, 6), (1.0, 1.0), (False, True), poles=(False, True)).rings
    assert ring.tolist() == [[2, j] for j in range(6)]


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("nodes", GRIDS, ids=str)
def test_layout_frames_whole_lane_groups(nodes: tuple[int, int], width: int) -> None:
    layout = Layout(nodes, width)
    assert layout.halo == width
    assert layout.rows == nodes[0] + 2
    assert layout.columns % width == 0
    assert nodes[1] + 2 * width <= layout.columns < nodes[1] + 3 * width
    assert layout.lane_dim == (nodes[0], -(-nodes[1] // width))
    assert (layout.lane_dim[1] + 2) * width == layout.columns


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("nodes", GRIDS, ids=str)
def test_pack_puts_nodes_in_their_places_and_zero_around(nodes: tuple[int, int], width: int) -> None:
    layout = Layout(nodes, width)
    values = np.random.default_rng(1).normal(size=(*nodes, 4))
    packed = layout.pack(values)
    assert packed.shape == (4, layout.rows, layout.columns)
    for i, j in ((0, 0), (nodes[0] - 1, nodes[1] - 1), (1, 0)):
        np.testing.assert_array_equal(packed[:, i + 1, j + width], values[i, j])
    assert np.count_nonzero(packed) == values.size
    np.testing.assert_array_equal(layout.unpack(packed), values)


def test_pack_takes_one_number_per_node_and_fewer_samples_than_nodes() -> None:
    layout = Layout((3, 5), 8)
    assert layout.pack(np.ones((3, 5))).shape == (1, 5, 24)
    cells = np.arange(8.0).reshape(2, 4, 1)
    packed = layout.pack(cells)
    np.testing.assert_array_equal(packed[0, 1:3, 8:12], cells[..., 0])
    assert packed[0, 3].sum() == 0
    np.testing.assert_array_equal(layout.unpack(packed, (2, 4)), cells)


def test_unpack_is_a_copy() -> None:
    layout = Layout((3, 5), 1)
    packed = layout.pack(np.ones((3, 5, 2)))
    layout.unpack(packed)[:] = 7.0
    assert packed.max() == 1.0


SOLIDS = [((2, 2, 2), (False,) * 3), ((3, 4, 17), (False,) * 3), ((4, 5, 8), (True, True, True))]


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize(("nodes", "periodic"), SOLIDS, ids=str)
def test_solids_lie_plane_after_plane_with_room_for_neighbours(
    nodes: tuple[int, ...], periodic: tuple[bool, ...], width: int
) -> None:
    layout = Layout(nodes, width, periodic)
    values = np.random.default_rng(1).normal(size=(*nodes, 4))
    packed = layout.pack(values)
    assert packed.shape == (4, layout.rows, layout.columns)
    np.testing.assert_array_equal(layout.unpack(packed), values)
    assert np.count_nonzero(packed) == values.size
    index = np.stack(np.meshgrid(*map(np.arange, nodes), indexing="ij"), axis=-1).reshape(-1, 3)
    places = layout.places(index)
    np.testing.assert_array_equal(packed[:, places[:, 0], places[:, 1]].T, values.reshape(-1, 4))
    for step, axis in ((layout.stride, 0), (1, 1)):
        inner = index[index[:, axis] + 1 < nodes[axis]]
        beside = inner + np.eye(3, dtype=int)[axis]
        np.testing.assert_array_equal(layout.places(beside)[:, 0] - layout.places(inner)[:, 0], step)
    reach = layout.stride + 1
    assert places[:, 0].min() - reach >= 0
    assert places[:, 0].max() + reach < layout.rows
    # What lies next to a border node along u or v belongs to no node.
    border = index[index[:, 1] == nodes[1] - 1]
    assert not packed[:, layout.places(border)[:, 0] + 1].any()
    assert not packed[:, layout.places(index[index[:, 1] == 0])[:, 0] - 1].any()


def test_strands_of_a_curve_are_not_connected() -> None:
    grid = ParameterGrid((9, 4), (0.1, 1.0), dimension=1)
    assert grid.cells == (8, 4)
    np.testing.assert_allclose(grid.cells_to_nodes(np.full((8, 4), 2.0))[:, 3], [1.0, *[2.0] * 7, 1.0])
    coarser = grid.coarser((0.1, 1e-9))
    assert coarser is not None
    assert coarser.nodes == (5, 4)
    assert coarser.dimension == 1


def test_cells_of_a_solid_share_among_eight_corners() -> None:
    grid = ParameterGrid((3, 4, 5), (1.0, 1.0, 1.0))
    shares = grid.cells_to_nodes(np.ones(grid.cells))
    assert shares[0, 0, 0] == 0.125
    assert shares[1, 1, 1] == 1.0
    assert shares.sum() == 24.0
