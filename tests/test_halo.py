"""The halo of periodic axes: what lies beside a body repeats its other end, and nothing else is touched."""

from itertools import product
from typing import Any

import numpy as np
import pytest
import warp as wp

from warpdeform.grid import Layout
from warpdeform.halo import Halo

Array = np.ndarray[Any, Any]
CPU = wp.get_device("cpu")
NODES = [(3, 3), (4, 8), (5, 11), (3, 4, 5), (4, 3, 8)]
GRIDS = [
    (nodes, periodic) for nodes in NODES for periodic in product((False, True), repeat=len(nodes)) if any(periodic)
]
OPEN = [((4, 5), (False, False)), ((3, 4, 5), (False, False, False))]


def filled(layout: Layout, real: Any = wp.float64) -> tuple[Array, wp.array]:
    """A number of its own at every node, nothing elsewhere: values (*nodes, 2) and the component array."""
    values = 1.0 + np.arange(2.0 * np.prod(layout.nodes)).reshape(*layout.nodes, 2)
    return values, wp.array(layout.pack(values), dtype=real, device=CPU)


@pytest.mark.parametrize("width", [1, 8])
@pytest.mark.parametrize(("nodes", "periodic"), GRIDS, ids=str)
def test_neighbours_of_every_node_are_found_across_the_seam(
    nodes: tuple[int, ...], periodic: tuple[bool, ...], width: int
) -> None:
    layout = Layout(nodes, width, periodic)
    values, array = filled(layout)
    Halo(layout, wp.float64, CPU).refresh(array)
    found = array.numpy()
    index = np.stack(np.meshgrid(*map(np.arange, nodes), indexing="ij"), axis=-1).reshape(-1, len(nodes))
    row_steps = (1,) if len(nodes) == 2 else (layout.stride, 1)
    for step in product((-1, 0, 1), repeat=len(nodes)):
        beside = index + step
        outside = [axis for axis in range(len(nodes)) if not periodic[axis]]
        exists = ((beside >= 0) & (beside < nodes))[:, outside].all(axis=1)
        rows, columns = layout.places(index[exists]).T
        seen = found[:, rows + np.dot(step[:-1], row_steps), columns + step[-1]].T
        np.testing.assert_array_equal(seen, values[tuple((beside[exists] % nodes).T)])


POLAR = [((6, 5), (True, False)), ((8, 8), (True, False)), ((4, 6), (False, True)), ((3, 10), (False, True))]


@pytest.mark.parametrize("width", [1, 8])
@pytest.mark.parametrize(("nodes", "periodic"), POLAR, ids=str)
def test_behind_a_pole_comes_the_other_side(nodes: tuple[int, int], periodic: tuple[bool, bool], width: int) -> None:
    layout = Layout(nodes, width, periodic, (True, True))
    values, array = filled(layout)
    halo = Halo(layout, wp.float64, CPU)
    halo.refresh(array)
    found, around = array.numpy().copy(), periodic.index(True)
    half = nodes[around] // 2
    for end, step in ((0, -1), (nodes[1 - around] - 1, 1)):
        for m in range(-1, nodes[around] + 1):
            behind, opposite = [m, m], [0, 0]
            behind[1 - around], opposite[1 - around] = end + step, end
            opposite[around] = (m + half) % nodes[around]
            assert found[:, behind[0] + 1, behind[1] + layout.halo].tolist() == values[tuple(opposite)].tolist()
    # Cells end at a pole; what is measured along the axes turns around.
    _, cells = filled(layout)
    halo.refresh_cells(cells)
    assert np.count_nonzero(cells.numpy()) == np.count_nonzero(found) - 4 * (nodes[around] + 2)
    _, turned = filled(layout)
    halo.refresh_turned(turned, halo.turning([1, 0], [1.0, -1.0]))
    behind = np.zeros(found.shape[1:], dtype=bool)
    behind[:, :] = (found != cells.numpy()).any(axis=0)
    np.testing.assert_array_equal(turned.numpy()[:, behind], found[::-1][:, behind] * [[1.0], [-1.0]])
    np.testing.assert_array_equal(turned.numpy()[:, ~behind], cells.numpy()[:, ~behind])


@pytest.mark.parametrize("width", [1, 8])
@pytest.mark.parametrize(("nodes", "periodic"), GRIDS, ids=str)
def test_nothing_but_the_halo_is_written_and_lanes_are_cleared(
    nodes: tuple[int, ...], periodic: tuple[bool, ...], width: int
) -> None:
    layout = Layout(nodes, width, periodic)
    values, array = filled(layout)
    halo = Halo(layout, wp.float64, CPU)
    halo.refresh(array)
    np.testing.assert_array_equal(layout.unpack(array.numpy()), values)
    around = np.prod([n + 2 * p for n, p in zip(nodes, periodic, strict=True)])
    assert np.count_nonzero(array.numpy()) == 2 * around
    halo.clear(array)
    # What lies where kernels over lanes write belongs to nodes again; `unpack` reads those.
    rows, groups = layout.lane_dim
    lanes = array.numpy()[:, 1 : rows + 1, layout.halo : layout.halo + groups * width]
    assert np.count_nonzero(lanes) == values.size
    np.testing.assert_array_equal(layout.unpack(array.numpy()), values)


@pytest.mark.parametrize(("nodes", "periodic", "copied"), [
    ((5, 8), (True, True), False),
    ((5, 11), (True, False), False),
    ((5, 11), (False, True), True),
    ((4, 3, 8), (True, False, False), True),
])  # fmt: skip
def test_constants_are_kept_twice_only_where_sums_would_see_their_halo(
    nodes: tuple[int, ...], periodic: tuple[bool, ...], copied: bool
) -> None:
    layout = Layout(nodes, 8, periodic)
    values, array = filled(layout)
    around = Halo(layout, wp.float64, CPU).surrounded(array)
    assert (around is not array) is copied
    rows, groups = layout.lane_dim
    lanes = array.numpy()[:, 1 : rows + 1, layout.halo : layout.halo + 8 * groups]
    assert lanes.sum() == values.sum()
    assert around.numpy().sum() > values.sum()


@pytest.mark.parametrize(("nodes", "periodic"), OPEN, ids=str)
def test_open_bodies_launch_and_keep_nothing(
    nodes: tuple[int, ...], periodic: tuple[bool, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    halo = Halo(Layout(nodes, 8, periodic), wp.float64, CPU)
    array = filled(Layout(nodes, 8, periodic))[1]
    before = array.numpy().copy()
    monkeypatch.setattr(wp, "launch", lambda *_, **__: pytest.fail("launched"))
    halo.refresh(array)
    halo.clear(array)
    assert halo.surrounded(array) is array
    assert halo.bytes() == 0
    np.testing.assert_array_equal(array.numpy(), before)


def test_single_precision() -> None:
    layout = Layout((5, 11), 16, (True, True))
    array = filled(layout, wp.float32)[1]
    Halo(layout, wp.float32, CPU).refresh(array)
    assert array.numpy()[0, 0, layout.halo - 1] == layout.unpack(array.numpy())[-1, -1, 0]
