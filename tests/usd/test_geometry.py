import numpy as np
import pytest
from motions import squashed_ball
from numpy.typing import NDArray

from warpdeform.usd.geometry import creased_normals, enclosed_volume, extent, face_areas, vertex_normals
from warpdeform.usd.topology import quad_indices


def torus(nodes: tuple[int, int], radius: float = 1.0, tube: float = 0.3) -> tuple[NDArray, NDArray]:
    """Points and exact normals of a torus whose r_u x r_v points outwards."""
    u, v = (np.linspace(0.0, 2.0 * np.pi, n, endpoint=False) for n in nodes)
    u, v = np.meshgrid(u, v, indexing="ij")
    normals = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=-1)
    centres = radius * np.stack([np.cos(u), np.sin(u), 0.0 * u], axis=-1)
    return (centres + tube * normals).astype(np.float32), normals


def test_normals_of_a_torus_point_outwards_and_converge() -> None:
    errors = []
    for scale in (1, 2):
        points, exact = torus((24 * scale, 16 * scale))
        normals = vertex_normals(points, (True, True))
        np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=1e-6)
        errors.append(np.abs(normals - exact).max())
    assert errors[0] < 0.05
    assert errors[1] < 0.3 * errors[0]


def test_normals_of_an_open_sheet_at_its_border() -> None:
    u, v = np.meshgrid(np.linspace(0, 1, 4), np.linspace(0, 2, 3), indexing="ij")
    points = np.stack([v, u, 0.5 * u], axis=-1)  # r_u x r_v = (0, 1, 0.5) x (1, 0, 0) = (0, 0.5, -1)
    expected = np.array([0.0, 0.5, -1.0]) / np.sqrt(1.25)
    np.testing.assert_allclose(
        vertex_normals(points.astype(np.float32)), np.broadcast_to(expected, (4, 3, 3)), atol=1e-6
    )


@pytest.mark.parametrize("shape", ["folded flat", "one point", "one line", "tiny"])
def test_normals_are_unit_vectors_whatever_the_sheet_does(shape: str) -> None:
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 4), indexing="ij")
    points = {
        "folded flat": np.stack([np.abs(u - 0.5), v, 0 * u], axis=-1),
        "one point": np.ones((5, 4, 3)),
        "one line": np.stack([u, u, u], axis=-1),
        "tiny": 1e-9 * np.stack([u, v, 0 * u], axis=-1),
    }[shape].astype(np.float32)
    normals = vertex_normals(points)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=1e-5)


def test_creased_normals_keep_edges_and_smooth_the_rest() -> None:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    of_cube = creased_normals(corners, faces)
    assert np.isin(np.abs(of_cube), (0.0, 1.0)).all()
    assert (np.einsum("ij,ij->i", of_cube, corners[faces.reshape(-1)]) > 0).all()

    points, exact = torus((48, 24))
    grid = quad_indices((48, 24), (True, True))
    faces = np.concatenate([grid[:, :3], grid[:, [0, 2, 3]]])
    smooth = creased_normals(points.reshape(-1, 3), faces)
    np.testing.assert_allclose(smooth, exact.reshape(-1, 3)[faces.reshape(-1)], atol=0.07)


def test_creased_normals_of_degenerate_faces_are_unit_vectors() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]])
    normals = creased_normals(vertices, np.array([[0, 1, 2], [0, 1, 3]]))
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6)


def test_extent() -> None:
    points = np.random.default_rng(1).normal(size=(4, 3, 3)).astype(np.float32)
    rows = points.reshape(-1, 3)
    np.testing.assert_array_equal(extent(points), [rows.min(axis=0), rows.max(axis=0)])


@pytest.mark.parametrize("flipped", [False, True])
def test_normals_around_the_poles_of_a_capped_ball_converge(flipped: bool) -> None:
    errors = []
    for scale in (1, 2):
        points = squashed_ball(0.0, (8 * scale, 12 * scale), radius=1.0)[0][:: -1 if flipped else 1].astype(np.float32)
        off = [np.abs((-1.0 if flipped else 1.0) * vertex_normals(points, (False, True), caps) - points)[[0, -1]]
               for caps in ((True, True), (False, False), (True, False))]  # fmt: skip
        errors.append(off[0].max())
        np.testing.assert_array_equal(off[2], np.stack([off[0][0], off[1][1]]))
        assert off[1].max() > 10.0 * errors[-1]
    assert errors[0] < 0.015
    assert errors[1] < 0.3 * errors[0]


def test_areas_and_volume_of_a_box_of_mixed_faces() -> None:
    x, y, z = (np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float) * [1, 2, 3]).T
    points = np.stack([x, y, z], axis=-1).astype(np.float32)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4)]
    corners = np.array([k for quad in quads for k in quad] + [1, 5, 7, 1, 7, 3])
    counts = np.array([4] * 5 + [3, 3])
    areas, centres = face_areas(points, counts, corners)
    np.testing.assert_allclose(areas.sum(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(areas[:2], [[-6, 0, 0], [6, 0, 0]])
    np.testing.assert_allclose(centres[0], [0, 1, 1.5])
    assert enclosed_volume(points + np.float32(100), counts, corners) == pytest.approx(6.0)
    assert enclosed_volume(
        points,
        counts,
        np.concatenate(
            [corners[:20].reshape(-1, 4)[:, ::-1].reshape(-1), corners[20:].reshape(-1, 3)[:, ::-1].reshape(-1)]
        ),
    ) == pytest.approx(-6.0)
