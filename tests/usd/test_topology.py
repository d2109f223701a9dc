import numpy as np
import pytest
from motions import breathing_torus, shearing_block

from warpdeform.usd.topology import (
    block_sides,
    block_tetrahedra,
    cap_faces,
    cell_counts,
    flattened,
    quad_indices,
    texture_coordinates,
)

BLOCKS = [(False, False, False), (True, False, False), (False, True, False), (False, False, True), (True, True, False)]


@pytest.mark.parametrize("nodes", [(2, 2), (2, 7), (5, 3)])
def test_quads_cover_the_grid_counter_clockwise(nodes: tuple[int, int]) -> None:
    i, j = np.meshgrid(np.arange(nodes[0]), np.arange(nodes[1]), indexing="ij")
    points = np.stack([i, j, 0 * i], axis=-1).reshape(-1, 3).astype(float)
    quads = points[quad_indices(nodes)]
    areas = 0.5 * np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
    np.testing.assert_array_equal(areas, np.tile([0.0, 0.0, 1.0], ((nodes[0] - 1) * (nodes[1] - 1), 1)))


@pytest.mark.parametrize("periodic", [(True, False), (False, True), (True, True)])
def test_periodic_axes_close(periodic: tuple[bool, bool]) -> None:
    quads = quad_indices((5, 4), periodic)
    edges = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    border = int((np.unique(edges, axis=0, return_counts=True)[1] == 1).sum())
    assert border == {(True, False): 10, (False, True): 8, (True, True): 0}[periodic]
    assert len(quads) == np.prod(cell_counts((5, 4), periodic))


@pytest.mark.parametrize("periodic", [(False, False), (True, False), (True, True)])
def test_texture_coordinates_never_run_backwards_over_a_seam(periodic: tuple[bool, bool]) -> None:
    values, corners = texture_coordinates((5, 4), periodic)
    quads = values[corners]
    assert values.min() == 0.0
    assert values.max() == 1.0
    step = 1.0 / np.array(cell_counts((5, 4), periodic))
    np.testing.assert_allclose(quads[:, 2] - quads[:, 0], np.tile(step, (len(quads), 1)), atol=1e-6)


@pytest.mark.parametrize("count", range(3, 10))
def test_caps_cover_their_ring_and_keep_its_sense(count: int) -> None:
    angle = 2.0 * np.pi * np.arange(count) / count
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    area = 0.0
    edges: list[tuple[int, int]] = []
    for faces in cap_faces(count):
        for corners in faces:
            a, b = ring[corners], ring[np.roll(corners, -1)]
            own = 0.5 * float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
            assert own > 0.0
            area += own
            edges += zip(corners, np.roll(corners, -1), strict=True)
    assert area == pytest.approx(0.5 * count * np.sin(2.0 * np.pi / count))
    assert {(k, (k + 1) % count) for k in range(count)} <= set(edges)
    assert len(set(edges)) == len(edges)


@pytest.mark.parametrize("periodic", BLOCKS)
@pytest.mark.parametrize("turned", [False, True])
def test_sides_of_a_block_close_and_leave_out_what_wraps(periodic: tuple, turned: bool) -> None:
    nodes = (4, 5, 3)
    sides = block_sides(nodes, periodic, turned)
    assert len(sides) == 2 * (3 - sum(periodic))
    quads = np.concatenate([side.nodes.reshape(-1)[quad_indices(side.nodes.shape, side.periodic)] for side in sides])
    cells = cell_counts(nodes, periodic)
    expected = sum(2 * np.prod(cells) // cells[axis] for axis in range(3) if not periodic[axis])
    assert len(quads) == expected
    edges = np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2)
    assert len(np.unique(edges, axis=0)) == len(edges)  # each way once: closed, and all faces agree
    np.testing.assert_array_equal(np.unique(edges, axis=0), np.unique(edges[:, ::-1], axis=0))


@pytest.mark.parametrize("periodic", BLOCKS)
def test_tetrahedra_fill_the_block_face_to_face(periodic: tuple) -> None:
    nodes = (4, 3, 5)
    tetrahedra = block_tetrahedra(nodes, periodic)
    assert len(tetrahedra) == 6 * np.prod(cell_counts(nodes, periodic))
    faces = tetrahedra[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]].reshape(-1, 3)  # outside, as USD has it
    faces = np.take_along_axis(faces, (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1)
    back = faces[:, [0, 2, 1]]
    alone = faces[~(faces[:, None] == back).all(axis=2).any(axis=1)]
    sides = block_sides(nodes, periodic)
    quads = np.concatenate([side.nodes.reshape(-1)[quad_indices(side.nodes.shape, side.periodic)] for side in sides])
    skin = quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    skin = np.take_along_axis(skin, (skin.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1)
    np.testing.assert_array_equal(np.unique(alone, axis=0), np.unique(skin, axis=0))
    assert len(alone) == len(skin)


@pytest.mark.parametrize("turned", [False, True])
def test_tetrahedra_have_positive_volumes(turned: bool) -> None:
    points = shearing_block(0.1, (4, 3, 5))[0]
    points = points * [1.0, 1.0, -1.0] if turned else points
    r = points.reshape(-1, 3)[block_tetrahedra((4, 3, 5), (False,) * 3, turned)]
    volumes = np.einsum("ij,ij->i", r[:, 1] - r[:, 0], np.cross(r[:, 2] - r[:, 0], r[:, 3] - r[:, 0])) / 6.0
    assert (volumes > 0.0).all()
    assert volumes.sum() == pytest.approx(0.6 * 0.4 * 0.3, rel=0.02)


def test_tetrahedra_of_a_ring_span_its_seams() -> None:
    points = breathing_torus(0.0, (24, 12, 3))[0].reshape(-1, 3)
    r = points[block_tetrahedra((24, 12, 3), (True, True, False))]
    volumes = np.einsum("ij,ij->i", r[:, 1] - r[:, 0], np.cross(r[:, 2] - r[:, 0], r[:, 3] - r[:, 0])) / 6.0
    assert (volumes > 0.0).all()
    assert volumes.sum() == pytest.approx(2.0 * np.pi**2 * 0.5 * 0.2**2 * (1 - 0.4**2), rel=0.06)


def test_flattened_keeps_the_order_of_groups() -> None:
    counts, corners = flattened([np.array([[0, 1, 2, 3]]), np.array([[4, 5, 6], [7, 8, 9]])])
    np.testing.assert_array_equal(counts, [4, 3, 3])
    np.testing.assert_array_equal(corners, np.arange(10))
