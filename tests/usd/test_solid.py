"""Solids in USD: a skin with the edges of the block, and tetrahedra beside it."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from motions import breathing_torus, shearing_block
from pxr import Usd, UsdGeom, UsdShade

from warpdeform.errors import InputError
from warpdeform.usd.check import check_stage, schema_errors
from warpdeform.usd.geometry import enclosed_volume
from warpdeform.usd.solid import SolidBlock

FPS = 60.0


def mirrored(time: float, nodes: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """The shearing block with v running backwards: a left-handed grid."""
    positions, velocities = shearing_block(time, nodes)
    return positions[:, ::-1], velocities[:, ::-1]


@pytest.mark.parametrize("motion", [shearing_block, mirrored])
def test_skin_and_tetrahedra_of_a_block(tmp_path: Path, recorded: Callable[..., Path], motion: Callable) -> None:
    nodes = (5, 4, 3)
    block = SolidBlock("block", nodes, color=(0.1, 0.2, 0.3)).outward(motion(0.0, nodes)[0])
    assert block.turned == (motion is mirrored)
    path = recorded(tmp_path / "block.usdc", [(block, motion)])
    assert check_stage(path, tolerance=0.01) == schema_errors(path) == []
    stage = Usd.Stage.Open(str(path))
    skin = UsdGeom.Mesh(stage.GetPrimAtPath("/World/block"))
    cells = UsdGeom.TetMesh(stage.GetPrimAtPath("/World/block_tetrahedra"))

    for code in (1, 6):
        positions, velocities = (array.reshape(-1, 3) for array in motion((code - 1) / FPS, nodes))
        inside = np.zeros(nodes, dtype=bool)
        inside[1:-1, 1:-1, 1:-1] = True
        outer = ~inside.reshape(-1)
        np.testing.assert_allclose(skin.GetPointsAttr().Get(code), positions[outer], atol=1e-6)
        np.testing.assert_allclose(skin.GetVelocitiesAttr().Get(code), velocities[outer], atol=1e-6)
        np.testing.assert_allclose(cells.GetPointsAttr().Get(code), positions, atol=1e-6)
        np.testing.assert_allclose(cells.GetVelocitiesAttr().Get(code), velocities, atol=1e-6)
        for prim in (skin, cells):
            expected = UsdGeom.Boundable.ComputeExtentFromPlugins(prim, code)
            np.testing.assert_allclose(prim.GetExtentAttr().Get(code), expected, atol=1e-7)

    assert skin.GetDoubleSidedAttr().Get() is False
    assert len(skin.GetFaceVertexCountsAttr().Get()) == 2 * (4 * 3 + 4 * 2 + 3 * 2)
    assert UsdShade.MaterialBindingAPI(skin).ComputeBoundMaterial()[0]
    assert cells.GetPurposeAttr().Get() == "guide"
    assert len(cells.GetTetVertexIndicesAttr().Get()) == 6 * 4 * 3 * 2
    assert UsdGeom.TetMesh.FindInvertedElements(cells, 6) == []
    np.testing.assert_allclose(cells.GetDisplayColorAttr().Get(), [block.color])


def test_surface_of_the_tetrahedra_is_that_which_usd_finds(tmp_path: Path, recorded: Callable[..., Path]) -> None:
    path = recorded(tmp_path / "a.usda", [(SolidBlock("a", (8, 6, 3), (True, True, False)), breathing_torus)], frames=1)
    stage = Usd.Stage.Open(str(path))
    cells = UsdGeom.TetMesh(stage.GetPrimAtPath("/World/a_tetrahedra"))
    found = np.array(UsdGeom.TetMesh.ComputeSurfaceFaces(cells, 1))
    written = np.array(cells.GetSurfaceFaceVertexIndicesAttr().Get())
    turned = [
        np.take_along_axis(faces, (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1)
        for faces in (found, written)
    ]
    assert len(found) == len(written)
    np.testing.assert_array_equal(*(np.unique(faces, axis=0) for faces in turned))


def test_normals_keep_the_edges_of_the_block_and_are_smooth_elsewhere(
    tmp_path: Path, recorded: Callable[..., Path]
) -> None:
    """At rest every corner of a face has the normal of its side; on a hollow torus, that of the torus."""
    path = recorded(tmp_path / "block.usda", [(SolidBlock("block", (5, 4, 3)), shearing_block)], frames=1)
    stage = Usd.Stage.Open(str(path))
    skin = UsdGeom.Mesh(stage.GetPrimAtPath("/World/block"))
    assert skin.GetNormalsInterpolation() == "faceVarying"
    normals = np.array(skin.GetNormalsAttr().Get(1))
    np.testing.assert_allclose(np.sort(np.abs(normals), axis=1), np.tile([0.0, 0, 1], (len(normals), 1)), atol=1e-5)
    corners = np.array(skin.GetPointsAttr().Get(1))[np.array(skin.GetFaceVertexIndicesAttr().Get())]
    middle = [0.0, 0.0, 0.15]
    reach = np.einsum("ij,ij->i", normals, corners - middle)
    np.testing.assert_allclose(reach, np.abs(normals) @ [0.3, 0.2, 0.15], atol=1e-5)

    nodes = (32, 16, 2)
    path = recorded(tmp_path / "torus.usda", [(SolidBlock("a", nodes, (True, True, False)), breathing_torus)], frames=1)
    stage = Usd.Stage.Open(str(path))
    skin = UsdGeom.Mesh(stage.GetPrimAtPath("/World/a"))
    corners = np.array(skin.GetPointsAttr().Get(1))[np.array(skin.GetFaceVertexIndicesAttr().Get())]
    ring = 0.5 * corners * [1, 1, 0] / np.linalg.norm(corners * [1, 1, 0], axis=1, keepdims=True)
    radius = np.linalg.norm(corners - ring, axis=1, keepdims=True)
    exact = (corners - ring) / radius * np.where(radius < 0.14, -1.0, 1.0)  # into the core inside, outwards outside
    np.testing.assert_allclose(skin.GetNormalsAttr().Get(1), exact, atol=0.05)


@pytest.mark.parametrize(
    ("nodes", "periodic", "sides", "right"),
    [
        ((16, 10, 3), (True, True, False), 2, 2 * np.pi**2 * 0.5 * 0.2**2 * (1 - 0.4**2)),
        ((16, 4, 3), (True, False, False), 4, None),
        ((4, 10, 3), (False, True, False), 4, None),
    ],
    ids=["hollow torus", "ring", "tube"],
)
def test_solids_that_wrap_have_no_faces_there(
    tmp_path: Path, recorded: Callable[..., Path], nodes: tuple, periodic: tuple, sides: int, right: float | None
) -> None:
    def motion(time: float, nodes: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
        """A whole torus, or a part of one: along the ring, or around the tube."""
        whole = (16 if not periodic[0] else nodes[0], 16 if not periodic[1] else nodes[1], nodes[2])
        positions, velocities = breathing_torus(time, whole)
        return positions[: nodes[0], : nodes[1]], velocities[: nodes[0], : nodes[1]]

    block = SolidBlock("a", nodes, periodic)
    assert len(block.sides()) == sides
    path = recorded(tmp_path / "a.usda", [(block, motion)])
    assert check_stage(path, tolerance=0.02) == schema_errors(path) == []
    stage = Usd.Stage.Open(str(path))
    skin = UsdGeom.Mesh(stage.GetPrimAtPath("/World/a"))
    arrays = (skin.GetPointsAttr().Get(1), skin.GetFaceVertexCountsAttr().Get(), skin.GetFaceVertexIndicesAttr().Get())
    volume = enclosed_volume(*(np.array(array) for array in arrays))
    assert volume > 0.0
    if right is not None:
        assert volume == pytest.approx(right, rel=0.1)


def test_every_side_has_the_whole_texture_without_a_run_back() -> None:
    block = SolidBlock("a", (6, 4, 3), (True, False, False))
    values, corners = block.texture()
    quads = values[corners].reshape(-1, 4, 2)
    assert len(quads) == len(block.skin())
    first = 0
    for side in block.sides():
        n1, n2 = side.nodes.shape
        cells = (n1 if side.periodic[0] else n1 - 1, n2 if side.periodic[1] else n2 - 1)
        own = quads[first : first + cells[0] * cells[1]]
        assert (own.min(), own.max()) == (0.0, 1.0)
        np.testing.assert_allclose(own[:, 2] - own[:, 0], np.tile(1.0 / np.array(cells), (len(own), 1)), atol=1e-6)
        first += len(own)
    assert first == len(quads)


def test_names_beside_each_other(tmp_path: Path, recorded: Callable[..., Path]) -> None:
    blocks = [SolidBlock(name, (3, 2, 2)) for name in ("a_tetrahedra", "a", "my block")]
    path = recorded(tmp_path / "a.usda", [(block, shearing_block) for block in blocks], frames=1)
    assert check_stage(path) == schema_errors(path) == []
    stage = Usd.Stage.Open(str(path))
    names = {prim.GetDisplayName() or prim.GetName() for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)}
    assert names == {"a_tetrahedra", "a", "my block"}
    assert sum(prim.IsA(UsdGeom.TetMesh) for prim in stage.Traverse()) == 3


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        ({"nodes": (3, 3)}, "nodes"),
        ({"nodes": (3, 1, 3)}, "nodes"),
        ({"nodes": (2, 3, 3), "periodic": (True, False, False)}, "nodes"),
        ({"periodic": (True, True, True)}, "periodic"),
        ({"periodic": (True, True)}, "periodic"),
        ({"color": (1.0, 0.0)}, "color"),
    ],
)
def test_refused_descriptions(arguments: dict, key: str) -> None:
    with pytest.raises(InputError, match=key) as caught:
        SolidBlock("a", **({"nodes": (3, 3, 3)} | arguments))
    assert [mistake.key for mistake in caught.value.mistakes] == [key]
