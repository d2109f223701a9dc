"""Lengths, areas, volumes and skins, shared among nodes."""

import numpy as np
import pytest
from surfaces import disk

from warpdeform.measure import cell_measures, exposed_shares, mean_edges, node_measures
from warpdeform.shape import RestShape, block, line, pipe, ring, root_line, sheet, sphere, strands, torus, tube


@pytest.mark.parametrize(
    ("shape", "total"),
    [
        (line((5,), 2.0), 2.0),
        (strands(line((5,), 2.0), root_line(3, 1.0)), 6.0),
        (ring((200,), 0.5), np.pi),
        (sheet((4, 7), (2.0, 0.5)), 1.0),
        (tube((200, 3), 0.5, 2.0), 2.0 * np.pi),
        (torus((100, 90), 0.5, 0.2), 0.4 * np.pi**2),
        (block((3, 4, 5), (1.0, 2.0, 0.5)), 1.0),
        (pipe((200, 3, 4), 0.5, 2.0, 0.1), 0.2 * np.pi),
    ],
    ids=str,
)
def test_measures_add_up(shape: RestShape, total: float) -> None:
    cells, nodes = cell_measures(shape.grid, shape.positions), node_measures(shape.grid, shape.positions)
    assert cells.shape == shape.grid.cells
    assert nodes.shape == shape.nodes
    assert cells.sum() == pytest.approx(total, rel=1e-3)
    assert nodes.sum() == pytest.approx(cells.sum(), rel=1e-13)
    assert nodes.min() > 0.0


def test_trapezoid_shares_at_borders() -> None:
    shape = block((3, 3, 3), (2.0, 2.0, 2.0))
    shares = node_measures(shape.grid, shape.positions)
    assert shares[0, 0, 0] == pytest.approx(1 / 8)
    assert shares[1, 0, 0] == pytest.approx(1 / 4)
    assert shares[1, 1, 1] == pytest.approx(1.0)
    strand = line((5,), 4.0)
    np.testing.assert_allclose(node_measures(strand.grid, strand.positions)[:, 0], [0.5, 1, 1, 1, 0.5])


def test_shares_around_poles_are_what_lies_around_the_nodes() -> None:
    # A flat disk: the ring at (k + 1/2) h stands for the ring from k h to (k + 1) h.
    shape, count, around = disk((64, 8), 1.0), 8, 64
    shares, h = node_measures(shape.grid, shape.positions), 1.0 / 7.5
    polygon = around / 2 * np.sin(2 * np.pi / around)
    expected = [polygon * h**2 * ((k + 1) ** 2 - k**2) for k in range(count - 1)]
    np.testing.assert_allclose(shares.sum(axis=0)[:-1], expected, rtol=1e-3)
    assert shares.sum() == pytest.approx(polygon, rel=2e-3)
    assert np.ptp(shares, axis=0).max() < 1e-15
    globe = sphere((64, 32), 0.5)
    assert node_measures(globe.grid, globe.positions).sum() == pytest.approx(np.pi, rel=3e-3)
    assert node_measures(globe.grid, globe.positions, np.full((64, 31), 3.0)).sum() == pytest.approx(
        3 * node_measures(globe.grid, globe.positions).sum(), rel=1e-13
    )


def test_density_counts_cell_by_cell() -> None:
    shape = sheet((3, 3), (2.0, 2.0))
    density = np.array([[1.0, 2.0], [3.0, 4.0]])
    shares = node_measures(shape.grid, shape.positions, density)
    np.testing.assert_allclose(shares, [[0.25, 0.75, 0.5], [1.0, 2.5, 1.5], [0.75, 1.75, 1.0]])


def test_mean_edges_of_a_solid() -> None:
    shape = block((3, 4, 5), (1.0, 2.0, 0.5))
    for axis, edges in enumerate(mean_edges(shape.grid, shape.positions)):
        assert edges.shape == (2, 3, 4, 3)
        np.testing.assert_allclose(
            edges, np.broadcast_to(shape.spacing[axis] * np.eye(3)[axis], edges.shape), atol=1e-15
        )


def test_what_the_world_meets() -> None:
    rope = line((5,), 2.0)
    assert exposed_shares(rope.grid, rope.positions, 0.01).sum() == pytest.approx(0.02)
    cloth = sheet((4, 7), (2.0, 0.5))
    assert exposed_shares(cloth.grid, cloth.positions).sum() == pytest.approx(1.0)
    brick = block((4, 4, 5), (1.0, 2.0, 0.5))
    skin = exposed_shares(brick.grid, brick.positions)
    assert skin.sum() == pytest.approx(2 * (2.0 + 1.0 + 0.5))
    assert not skin[1:-1, 1:-1, 1:-1].any()
    np.testing.assert_allclose(skin[0, 1, 1], [2.0 / 3 * 0.125, 0.0, 0.0])
    assert (skin[0, 0, 0] > 0).all()
    wall = pipe((60, 3, 4), 0.5, 2.0, 0.1)
    skin = exposed_shares(wall.grid, wall.positions)
    assert skin.sum() == pytest.approx(2 * 2.0 * np.pi + 2 * np.pi * 0.1, rel=3e-3)
    np.testing.assert_allclose(skin, np.broadcast_to(skin[:1], skin.shape), rtol=1e-12)
