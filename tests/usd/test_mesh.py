from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from warpdeform.errors import InputError
from warpdeform.obstacle import Obstacle
from warpdeform.usd.mesh import read_mesh, warp_asset

CUBE_POINTS = [(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)]
CUBE_QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def stage_with_cube(path: Path, up_axis: str = "Z", meters_per_unit: float = 1.0) -> tuple[Usd.Stage, UsdGeom.Mesh]:
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up_axis)
    UsdGeom.SetStageMetersPerUnit(stage, meters_per_unit)
    UsdGeom.Xform.Define(stage, "/root")
    mesh = UsdGeom.Mesh.Define(stage, "/root/cube")
    mesh.CreatePointsAttr(CUBE_POINTS)
    mesh.CreateFaceVertexCountsAttr([4] * 6)
    mesh.CreateFaceVertexIndicesAttr([i for quad in CUBE_QUADS for i in quad])
    return stage, mesh


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.sum(np.cross(a, b) * c)) / 6.0


def test_the_bunny_is_closed_upright_and_its_right_size() -> None:
    vertices, faces = read_mesh(warp_asset("bunny"))
    assert vertices.shape == (6102, 3)
    assert faces.shape == (12200, 3)
    size = np.ptp(vertices, axis=0)
    assert size[2] == pytest.approx(1.62, abs=0.01)
    assert volume(vertices, faces) > 0.0
    assert Obstacle("mesh", vertices=vertices, faces=faces).faces is not None


def test_polygons_become_fans_that_keep_their_side(tmp_path: Path) -> None:
    stage, _ = stage_with_cube(tmp_path / "cube.usda")
    stage.Save()
    vertices, faces = read_mesh(tmp_path / "cube.usda")
    assert faces.shape == (12, 3)
    assert volume(vertices, faces) == pytest.approx(1.0)

    hexagon = [(np.cos(a), np.sin(a), 0.0) for a in np.linspace(0, 2 * np.pi, 7)[:-1]]
    mesh = UsdGeom.Mesh.Define(stage, "/root/flat")
    mesh.CreatePointsAttr(hexagon)
    mesh.CreateFaceVertexCountsAttr([6, 3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3, 4, 5, 0, 1, 2])
    mesh.CreateHoleIndicesAttr([1])
    stage.Save()
    _, faces = read_mesh(tmp_path / "cube.usda", "/root/flat")
    np.testing.assert_array_equal(faces, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("left_handed", [False, True])
def test_handedness(tmp_path: Path, mirrored: bool, left_handed: bool) -> None:
    stage, mesh = stage_with_cube(tmp_path / "cube.usda")
    if mirrored:
        mesh.AddScaleOp().Set(Gf.Vec3f(-1, 1, 1))
    if left_handed:
        mesh.CreateOrientationAttr(UsdGeom.Tokens.leftHanded)
    stage.Save()
    assert volume(*read_mesh(tmp_path / "cube.usda")) == pytest.approx(-1.0 if left_handed else 1.0)


def test_transforms_units_and_up_axis(tmp_path: Path) -> None:
    stage, mesh = stage_with_cube(tmp_path / "cube.usda", "Y", 0.01)
    UsdGeom.Xform(stage.GetPrimAtPath("/root")).AddTranslateOp().Set((10.0, 20.0, 30.0))
    mesh.AddScaleOp().Set(Gf.Vec3f(100.0))
    stage.Save()
    for up_axis, low in (("Z", (0.1, -1.3, 0.2)), ("Y", (0.1, 0.2, 0.3))):
        vertices, faces = read_mesh(tmp_path / "cube.usda", up_axis=up_axis)
        np.testing.assert_allclose(vertices.min(axis=0), low, atol=1e-9)
        np.testing.assert_allclose(np.ptp(vertices, axis=0), 1.0)
        assert volume(vertices, faces) == pytest.approx(1.0)


def test_meshes_with_samples_only_are_read_at_the_earliest(tmp_path: Path) -> None:
    stage, mesh = stage_with_cube(tmp_path / "cube.usda")
    mesh.GetPointsAttr().Clear()
    mesh.GetPointsAttr().Set(CUBE_POINTS, 3)
    mesh.GetPointsAttr().Set([(9, 9, 9)] * 8, 4)
    mesh.AddTranslateOp().Set((0, 0, 5), 3)
    stage.Save()
    vertices, _ = read_mesh(tmp_path / "cube.usda")
    np.testing.assert_array_equal(vertices.min(axis=0), (0, 0, 5))


def test_instances_are_found(tmp_path: Path) -> None:
    stage, _ = stage_with_cube(tmp_path / "cube.usda")
    stage.SetDefaultPrim(stage.GetPrimAtPath("/root"))
    stage.Save()
    other = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    UsdGeom.SetStageMetersPerUnit(other, 1.0)
    UsdGeom.SetStageUpAxis(other, "Z")
    prim = UsdGeom.Xform.Define(other, "/thing").GetPrim()
    prim.GetReferences().AddReference("./cube.usda")
    prim.SetInstanceable(True)
    other.Save()
    assert len(read_mesh(tmp_path / "scene.usda")[0]) == 8


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("mesh.obj", "v 0 0 0", "no USD file by its suffix"),
        ("missing.usd", None, "does not exist"),
        ("broken.usda", "garbage", "cannot be read as USD"),
        ("broken.usdc", "garbage", "cannot be read as USD"),
        ("broken.usdz", "garbage", "cannot be read as USD"),
        ("empty.usda", "#usda 1.0\n", "holds no Mesh prim"),
        ("folder.usd", "", "is a folder"),
    ],
)
def test_files_that_cannot_be_read(tmp_path: Path, name: str, content: str | None, words: str) -> None:
    path = tmp_path / name
    if name.startswith("folder"):
        path.mkdir()
    elif content is not None:
        path.write_text(content)
    with pytest.raises(InputError, match=words) as caught:
        read_mesh(path, key="obstacle.0.mesh")
    assert str(caught.value).startswith(f'obstacle.0.mesh = "{path}"'[:60])
    assert len(str(caught.value).splitlines()) == 1


def test_which_mesh_must_be_said_where_there_are_several(tmp_path: Path) -> None:
    stage, _ = stage_with_cube(tmp_path / "two.usda")
    UsdGeom.Mesh.Define(stage, "/root/other")
    stage.Save()
    with pytest.raises(InputError, match=r"holds 2 meshes.*/root/cube, /root/other"):
        read_mesh(tmp_path / "two.usda")
    for prim in ("/root/none", "not a path", "/root"):
        with pytest.raises(InputError, match=r"no Mesh prim at .*/root/cube"):
            read_mesh(tmp_path / "two.usda", prim)
    with pytest.raises(InputError, match="no points or no faces"):
        read_mesh(tmp_path / "two.usda", "/root/other")


@pytest.mark.parametrize(
    ("counts", "indices", "points", "words"),
    [
        ([3], [0, 1, 8], CUBE_POINTS, "refers to vertex 8"),
        ([3], [0, 1, -1], CUBE_POINTS, "refers to vertex -1"),
        ([3, 3], [0, 1, 2], CUBE_POINTS, "counts that do not fit"),
        ([2], [0, 1], CUBE_POINTS, "counts that do not fit"),
        ([3], [0, 1, 2], [(0, 0, 0), (1, 0, 0), (0, float("nan"), 0)], "not finite"),
    ],
)
def test_bad_meshes(tmp_path: Path, counts: list, indices: list, points: list, words: str) -> None:
    stage, mesh = stage_with_cube(tmp_path / "bad.usda")
    mesh.GetFaceVertexCountsAttr().Set(counts)
    mesh.GetFaceVertexIndicesAttr().Set(indices)
    mesh.GetPointsAttr().Set(points)
    stage.Save()
    with pytest.raises(InputError, match=words):
        read_mesh(tmp_path / "bad.usda")


def test_unknown_assets_list_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"rabbit.*bunny"):
        warp_asset("rabbit")
