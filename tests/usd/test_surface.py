"""Surfaces in USD: which sides they have, how they close, and where their texture goes."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from motions import breathing_torus, squashed_ball
from pxr import Usd, UsdGeom

from warpdeform.body import Body
from warpdeform.errors import InputError
from warpdeform.material import Material
from warpdeform.shape import sphere
from warpdeform.usd.check import check_stage, schema_errors
from warpdeform.usd.geometry import enclosed_volume, vertex_normals
from warpdeform.usd.recorder import describe
from warpdeform.usd.surface import SurfaceMesh

RING = (False, True)


def tube(time: float, nodes: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """A tube along z that swells."""
    z, v = np.meshgrid(np.linspace(0, 1, nodes[0]), 2 * np.pi * np.arange(nodes[1]) / nodes[1], indexing="ij")
    out = np.stack([np.cos(v), np.sin(v), 0 * v], axis=-1)
    return (0.2 + 0.1 * time) * out + z[..., None] * [0, 0, 1.0], 0.1 * out


def backwards(motion: Callable, time: float, nodes: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """A motion whose u runs the other way."""
    positions, velocities = motion(time, nodes)
    return positions[::-1], velocities[::-1]


def lying(motion: Callable, time: float, nodes: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """A motion with its axes exchanged."""
    positions, velocities = motion(time, nodes[::-1])
    return positions.transpose(1, 0, 2), velocities.transpose(1, 0, 2)


def mesh_of(path: Path) -> UsdGeom.Mesh:
    mesh_of.stage = Usd.Stage.Open(str(path))  # type: ignore[attr-defined]  # prims live as long as their stage
    return UsdGeom.Mesh(mesh_of.stage.GetPrimAtPath("/World/a"))  # type: ignore[attr-defined]


def volume(mesh: UsdGeom.Mesh, code: float) -> float:
    arrays = (
        mesh.GetPointsAttr().Get(code),
        mesh.GetFaceVertexCountsAttr().Get(),
        mesh.GetFaceVertexIndicesAttr().Get(),
    )
    return enclosed_volume(*(np.array(array) for array in arrays))


CLOSED = {
    "torus": ((16, 10), (True, True), (False, False), breathing_torus, 2 * np.pi**2 * 0.5 * 0.2**2),
    "ball": ((12, 16), RING, (True, True), squashed_ball, 4 / 3 * np.pi * 0.3**3),
    "ball of odd rings": ((12, 15), RING, (True, True), squashed_ball, 4 / 3 * np.pi * 0.3**3),
    "can": ((3, 16), RING, (True, True), tube, np.pi * 0.2**2),
    "ball around u": ((16, 12), (True, False), (True, True), partial(lying, squashed_ball), 4 / 3 * np.pi * 0.3**3),
}


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("name", CLOSED)
def test_closed_surfaces_show_one_side_and_enclose_a_positive_volume(
    tmp_path: Path, recorded: Callable[..., Path], name: str, reverse: bool
) -> None:
    nodes, periodic, caps, motion, right = CLOSED[name]
    motion = partial(backwards, motion) if reverse else motion
    surface = SurfaceMesh("a", nodes, periodic, caps=caps).outward(motion(0.0, nodes)[0])
    path = recorded(tmp_path / "closed.usda", [(surface, motion)])
    assert check_stage(path, tolerance=0.02) == schema_errors(path) == []
    mesh = mesh_of(path)
    assert mesh.GetDoubleSidedAttr().Get() is False
    assert volume(mesh, 1) == pytest.approx(right, rel=0.15)


def test_what_faces_inwards_without_being_turned_is_found(tmp_path: Path, recorded: Callable[..., Path]) -> None:
    path = recorded(
        tmp_path / "a.usda", [(SurfaceMesh("a", (16, 10), (True, True)), partial(backwards, breathing_torus))]
    )
    assert any("its faces look inwards" in finding for finding in check_stage(path))


@pytest.mark.parametrize("caps", [(False, False), (True, False)])
def test_tubes_stay_open_at_their_ends_and_show_both_sides(
    tmp_path: Path, recorded: Callable[..., Path], caps: tuple[bool, bool]
) -> None:
    surface = SurfaceMesh("a", (4, 8), RING, caps=caps)
    assert surface.outward(tube(0.0, (4, 8))[0][::-1]) is surface
    path = recorded(tmp_path / "tube.usda", [(surface, tube)])
    assert check_stage(path, tolerance=0.02) == schema_errors(path) == []
    mesh = mesh_of(path)
    assert mesh.GetDoubleSidedAttr().Get() is True
    assert len(mesh.GetFaceVertexCountsAttr().Get()) == 3 * 8 + 3 * sum(caps)
    assert len(mesh.GetPointsAttr().Get(1)) == 4 * 8


def test_caps_around_u_are_those_around_v_with_the_axes_exchanged() -> None:
    nodes, caps = (12, 7), (True, False)
    standing, lying_down = (
        SurfaceMesh("a", nodes[::-1], RING, caps=caps),
        SurfaceMesh("a", nodes, (True, False), caps=caps),
    )
    numbers = np.arange(84).reshape(nodes).T.ravel()
    # Exchanged axes turn the faces over.
    expected = {frozenset(numbers[corners].tolist()) for group in standing.faces()[1:] for corners in group}
    found = {frozenset(corners.tolist()) for group in lying_down.faces()[1:] for corners in group}
    assert found == expected
    points = squashed_ball(0.1, nodes[::-1])[0].astype(np.float32)
    normals = vertex_normals(points, RING, caps)
    exchanged = vertex_normals(points.transpose(1, 0, 2), (True, False), caps)
    np.testing.assert_array_equal(exchanged, -normals.transpose(1, 0, 2))


def test_simulated_balls_are_closed() -> None:
    ball = Body("ball", sphere((12, 8), 0.3), Material.preset("rubber"))
    mesh = describe(ball)
    assert isinstance(mesh, SurfaceMesh)
    assert mesh.caps == (True, True)
    assert mesh.closed
    assert mesh.outward(ball.shape.positions) is mesh


@pytest.mark.parametrize("turned", [False, True])
def test_texture_follows_the_faces_and_does_not_run_back_over_the_seam(turned: bool) -> None:
    surface = SurfaceMesh("a", (5, 6), RING, caps=(True, True), turned=turned)
    values, corners = surface.texture()
    counts, indices = (np.concatenate(parts) for parts in zip(*[
        (np.full(len(faces), faces.shape[1]), faces.reshape(-1)) for faces in surface.faces()
    ], strict=True))  # fmt: skip
    assert len(corners) == len(indices) == counts.sum()
    s, t = values[corners].T
    np.testing.assert_allclose(s, (indices // 6) / 4, atol=1e-6)
    np.testing.assert_allclose(t % 1.0, (indices % 6) / 6, atol=1e-6)
    quads = t[: 4 * 4 * 6].reshape(-1, 4)
    np.testing.assert_allclose(np.ptp(quads, axis=1), 1 / 6, atol=1e-6)
    assert (s[4 * 4 * 6 :] % 1.0 == 0.0).all()


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        ({"nodes": (1, 5)}, "nodes"),
        ({"nodes": (2, 5), "periodic": (True, False)}, "nodes"),
        ({"nodes": (3, 3, 3)}, "nodes"),
        ({"nodes": (3, 3), "periodic": (True,)}, "periodic"),
        ({"nodes": (3, 3), "color": (0.1, float("nan"), 0.0)}, "color"),
        ({"nodes": (3, 3), "roughness": 1.5}, "roughness"),
        ({"nodes": (3, 3), "thickness": -1.0}, "thickness"),
        ({"nodes": (3, 3), "caps": (True, False)}, "caps"),
        ({"nodes": (3, 3), "periodic": (True, True), "caps": (True, True)}, "caps"),
    ],
)
def test_refused_descriptions(arguments: dict, key: str) -> None:
    with pytest.raises(InputError, match=key) as caught:
        SurfaceMesh("a", **arguments)
    assert [mistake.key for mistake in caught.value.mistakes] == [key]
