import numpy as np
import pytest
from numpy.typing import NDArray

from warpdeform.errors import InputError
from warpdeform.usd.geometry import creased_normals, extent, vertex_normals
from warpdeform.usd.surface import SurfaceMesh
from warpdeform.usd.topology import quad_indices, texture_coordinates


def torus(nodes: tuple[int, int], radius: float = 1.0, tube: float = 0.3) -> tuple[NDArray, NDArray]:
    """Points and exact normals of a torus whose r_u x r_v points outwards."""
    u, v = (np.linspace(0.0, 2.0 * np.pi, n, endpoint=False) for n in nodes)
    u, v = np.meshgrid(u, v, indexing="ij")
    normals = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=-1)
    centres = radius * np.stack([np.cos(u), np.sin(u), 0.0 * u], axis=-1)
    return (centres + tube * normals).astype(np.float32), normals


@pytest.mark.parametrize("nodes", [(2, 2), (2, 7), (5, 3)])
def test_quads_cover_the_grid_counter_clockwise(nodes: tuple[int, int]) -> None:
    i, j = np.meshgrid(np.arange(nodes[0]), np.arange(nodes[1]), indexing="ij")
    points = np.stack([i, j, 0 * i], axis=-1).reshape(-1, 3).astype(float)
    quads = points[quad_indices(SurfaceMesh("a", nodes))]
    areas = 0.5 * np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
    np.testing.assert_array_equal(areas, np.tile([0.0, 0.0, 1.0], ((nodes[0] - 1) * (nodes[1] - 1), 1)))


@pytest.mark.parametrize("periodic", [(True, False), (False, True), (True, True)])
def test_periodic_axes_close(periodic: tuple[bool, bool]) -> None:
    mesh = SurfaceMesh("a", (5, 4), periodic)
    quads = quad_indices(mesh)
    edges = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    border = int((np.unique(edges, axis=0, return_counts=True)[1] == 1).sum())
    assert border == {(True, False): 10, (False, True): 8, (True, True): 0}[periodic]
    assert len(quads) == mesh.cells[0] * mesh.cells[1]


@pytest.mark.parametrize("periodic", [(False, False), (True, False), (True, True)])
def test_texture_coordinates_never_run_backwards_over_a_seam(periodic: tuple[bool, bool]) -> None:
    mesh = SurfaceMesh("a", (5, 4), periodic)
    values, corners = texture_coordinates(mesh)
    quads = values[corners].reshape(-1, 4, 2)
    assert values.min() == 0.0
    assert values.max() == 1.0
    step = 1.0 / np.array(mesh.cells)
    np.testing.assert_allclose(quads[:, 2] - quads[:, 0], np.tile(step, (len(quads), 1)), atol=1e-6)


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
    grid = quad_indices(SurfaceMesh("a", (48, 24), (True, True)))
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


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        ({"nodes": (1, 5)}, "nodes"),
        ({"nodes": (2, 5), "periodic": (True, False)}, "nodes"),
        ({"nodes": (3, 3), "color": (0.1, float("nan"), 0.0)}, "color"),
        ({"nodes": (3, 3), "roughness": 1.5}, "roughness"),
        ({"nodes": (3, 3), "thickness": -1.0}, "thickness"),
    ],
)
def test_refused_descriptions(arguments: dict, key: str) -> None:
    with pytest.raises(InputError, match=key):
        SurfaceMesh("a", **arguments)
