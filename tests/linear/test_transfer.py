"""Grids of a hierarchy and the maps between them."""

from typing import Any

import numpy as np
import pytest
import warp as wp

from warpdeform.grid import MOST_GROWTH, Layout, ParameterGrid
from warpdeform.kernels.multigrid import multigrid
from warpdeform.linear.level import COARSEST_NODES
from warpdeform.linear.transfer import Transfer

Array = np.ndarray[Any, Any]
CPU = wp.get_device("cpu")
SIZES = [(3, 3), (4, 4), (5, 8), (7, 5), (16, 17), (64, 33), (50, 37), (200, 6), (3, 90)]


def step(nodes: tuple[int, int], width: int = 8, periodic: tuple[bool, bool] = (False, False)) -> Transfer:
    fine = ParameterGrid(nodes, (1.0, 1.0), periodic)
    coarse = fine.coarser((1.0, 1.0))
    return Transfer(fine, Layout(nodes, width), coarse or fine, wp.float64, CPU)


def carried(transfer: Transfer, nodes: tuple[int, int], values: Array, tables: str) -> Array:
    """The kernel's map of a vector per node of the fine grid (prolong: of the coarse one)."""
    width = transfer.layout.lane_width
    fine, coarse = Layout(nodes, width), transfer.layout
    source, target = (coarse, fine) if tables == "prolong" else (fine, coarse)
    a = wp.array(source.pack(values), dtype=wp.float64, device=CPU)
    b = wp.array(target.pack(np.full((*target.nodes, 3), np.nan)), dtype=wp.float64, device=CPU)
    kernel = multigrid(width, wp.float64).carry
    wp.launch(kernel, dim=target.lane_dim, inputs=[a, getattr(transfer, tables).of_rows(0, target.rows), b], device=CPU)
    outside = b.numpy().copy()
    outside[:, 1:-1, target.halo : target.halo + target.nodes[1]] = 0.0
    assert not outside.any(), "written outside the body"
    return target.unpack(b.numpy())


@pytest.mark.parametrize("width", [1, 8])
@pytest.mark.parametrize("nodes", SIZES, ids=str)
def test_interpolation_reproduces_linear_functions_both_ways(nodes: tuple[int, int], width: int) -> None:
    transfer = step(nodes, width)

    def linear(of: tuple[int, int]) -> Array:
        u, v = np.meshgrid(np.linspace(0, 1, of[0]), np.linspace(0, 1, of[1]), indexing="ij")
        return np.stack([1.0 + 0 * u, 2.0 * u - v, u + 3.0 * v], axis=-1)

    fine, coarse = linear(nodes), linear(transfer.coarse.nodes)
    np.testing.assert_allclose(carried(transfer, nodes, coarse, "prolong"), fine, atol=1e-12)
    np.testing.assert_allclose(carried(transfer, nodes, fine, "positions"), coarse, atol=1e-12)
    np.testing.assert_allclose(transfer.sample(fine), coarse, atol=1e-12)


@pytest.mark.parametrize("periodic", [(False, False), (True, False), (True, True)])
@pytest.mark.parametrize("nodes", SIZES, ids=str)
def test_restriction_is_the_transpose_of_interpolation(nodes: tuple[int, int], periodic: tuple[bool, bool]) -> None:
    transfer = step(nodes, 8, periodic)
    random = np.random.default_rng(2)
    a, b = random.normal(size=(*nodes, 3)), random.normal(size=(*transfer.coarse.nodes, 3))
    down, up = carried(transfer, nodes, a, "restrict"), carried(transfer, nodes, b, "prolong")
    assert np.vdot(down, b) == pytest.approx(np.vdot(a, up), rel=1e-12, abs=1e-12)
    np.testing.assert_allclose(transfer.gather(a[..., 0]), down[..., 0], atol=1e-12)
    assert transfer.gather(np.ones(nodes)).sum() == pytest.approx(nodes[0] * nodes[1])


def test_interpolation_wraps_around_a_periodic_axis() -> None:
    transfer = step((12, 5), 8, (True, False))
    assert transfer.coarse.nodes == (6, 3)
    values = np.zeros((6, 3, 3))
    values[0] = 1.0
    found = carried(transfer, (12, 5), values, "prolong")
    np.testing.assert_allclose(found[[0, 1, 11], 0, 0], [1.0, 0.5, 0.5])
    assert not found[2:11].any()


@pytest.mark.parametrize("nodes", SIZES, ids=str)
def test_averages_of_cells_keep_the_integral(nodes: tuple[int, int]) -> None:
    transfer = step(nodes)
    cells = np.zeros((*nodes, 3))
    cells[:-1, :-1] = np.random.default_rng(3).normal(size=(nodes[0] - 1, nodes[1] - 1, 3))
    found = carried(transfer, nodes, cells, "cells")
    growth = transfer.growth[0] * transfer.growth[1]
    np.testing.assert_allclose(growth * found.sum(axis=(0, 1)), cells.sum(axis=(0, 1)), atol=1e-10)
    assert not found[-1].any()
    assert not found[:, -1].any()


@pytest.mark.parametrize("nodes", [*SIZES, (513, 513), (129, 4), (1000, 3)], ids=str)
@pytest.mark.parametrize("lengths", [(1.0, 1.0), (1.0, 10.0), (10.0, 1.0), (1.0, 1.9)])
def test_grids_come_down_to_a_few_nodes(nodes: tuple[int, int], lengths: tuple[float, float]) -> None:
    grid, extent = (
        ParameterGrid(nodes, (1.0, 1.0)),
        [length * (n - 1) for length, n in zip(lengths, nodes, strict=True)],
    )
    for _ in range(40):
        coarser = grid.coarser(lengths)
        if coarser is None:
            break
        growth = [old / new for old, new in zip(grid.cells, coarser.cells, strict=True)]
        assert min(growth) >= 1.0
        assert 1.0 < max(growth) <= MOST_GROWTH
        if growth[0] > 1.0 and growth[1] > 1.0:
            assert 0.5 < lengths[0] / lengths[1] < 2.0
        grid = coarser
        lengths = (extent[0] / grid.cells[0], extent[1] / grid.cells[1])
        assert grid.spacing == pytest.approx([(n - 1) / cells for n, cells in zip(nodes, grid.cells, strict=True)])
    assert grid.node_count <= COARSEST_NODES
    assert grid.coarser(lengths) is None


def test_whole_lane_groups_stay_whole() -> None:
    grid = ParameterGrid((256, 64), (1.0, 1.0))
    found = []
    while grid.node_count > COARSEST_NODES and (coarser := grid.coarser((1.0, 1.0))):
        grid = coarser
        found.append(grid.nodes)
    assert found[:3] == [(128, 32), (64, 16), (32, 8)]


OTHERS = [
    ParameterGrid((9, 5), (1.0, 1.0), dimension=1),
    ParameterGrid((12, 20), (1.0, 1.0), (True, False), dimension=1),
    ParameterGrid((5, 6, 7), (1.0, 1.0, 1.0)),
    ParameterGrid((9, 8, 33), (1.0, 1.0, 1.0), (False, True, False)),
    ParameterGrid((3, 17, 4), (1.0, 1.0, 1.0)),
]


@pytest.mark.parametrize("width", [1, 8])
@pytest.mark.parametrize("grid", OTHERS, ids=lambda grid: str(grid.nodes))
def test_transfers_of_curves_and_solids(grid: ParameterGrid, width: int) -> None:
    coarse = grid.coarser((1.0,) * len(grid.nodes))
    assert coarse is not None
    fine_layout = Layout(grid.nodes, width, grid.periodic)
    transfer = Transfer(grid, fine_layout, coarse, wp.float64, CPU)
    random = np.random.default_rng(5)
    a, b = random.normal(size=(*grid.nodes, 3)), random.normal(size=(*coarse.nodes, 3))

    def moved(values: Array, tables: str, source: Layout, target: Layout) -> Array:
        given = wp.array(source.pack(values), dtype=wp.float64, device=CPU)
        found = wp.zeros((3, target.rows, target.columns), dtype=wp.float64, device=CPU)
        inputs = [given, getattr(transfer, tables).of_rows(0, target.rows), found]
        wp.launch(multigrid(width, wp.float64).carry, dim=target.lane_dim, inputs=inputs, device=CPU)
        values = target.unpack(found.numpy())
        assert np.count_nonzero(found.numpy()) <= values.size, "written outside the body"
        return values

    down = moved(a, "restrict", fine_layout, transfer.layout)
    up = moved(b, "prolong", transfer.layout, fine_layout)
    assert np.vdot(down, b) == pytest.approx(np.vdot(a, up), rel=1e-12, abs=1e-12)
    np.testing.assert_allclose(transfer.gather(a[..., 0]), down[..., 0], atol=1e-12)
    np.testing.assert_allclose(transfer.sample(a), moved(a, "positions", fine_layout, transfer.layout), atol=1e-12)
    np.testing.assert_allclose(moved(np.ones(b.shape), "prolong", transfer.layout, fine_layout), 1.0, atol=1e-12)


@pytest.mark.parametrize("periodic", [(False, False), (False, True)])
def test_means_of_what_varies_keep_constants_and_totals(periodic: tuple[bool, bool]) -> None:
    transfer, fine = step((9, 12), 1, periodic), ParameterGrid((9, 12), (1.0, 1.0), periodic)
    matrices = np.broadcast_to(np.arange(9.0).reshape(3, 3), (*fine.cells, 3, 3))
    np.testing.assert_allclose(transfer.average_cells(matrices)[1, 2], matrices[0, 0], rtol=1e-14)
    np.testing.assert_allclose(transfer.average_nodes(np.full((9, 12, 2), 3.0)), 3.0, rtol=1e-14)
    values = np.random.default_rng(0).uniform(size=fine.cells)
    coarse = transfer.average_cells(values)
    assert coarse.shape == transfer.coarse.cells
    assert coarse.mean() == pytest.approx(values.mean(), rel=1e-13)
