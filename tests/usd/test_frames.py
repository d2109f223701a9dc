from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdShade

from warpdeform.errors import InputError, SimulationFailure, WarpdeformError
from warpdeform.obstacle import Obstacle
from warpdeform.track import Track
from warpdeform.usd.check import check_stage, schema_errors
from warpdeform.usd.frames import FrameWriter
from warpdeform.usd.surface import SurfaceMesh

FPS = 60.0
SHEET = SurfaceMesh("sheet", (7, 5), color=(0.2, 0.3, 0.4), roughness=0.5, thickness=0.002)
TETRAHEDRON = {
    "vertices": np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    "faces": np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
}
OBSTACLES = [
    Obstacle("plane", name="ground"),
    Obstacle("sphere", {"radius": 0.3}, name="ball", track=Track.line((0, 0, 0), (1, 0, 2), 0.0, 0.1)),
    Obstacle("box", {"size": (1.0, 2.0, 0.3)}, name="box", track=Track.fixed((1, 2, 3), (0, 0, 0.6, 0.8))),
    Obstacle("capsule", {"radius": 0.1, "height": 0.4}, name="capsule"),
    Obstacle(
        "cylinder", {"radius": 0.1, "height": 0.4}, name="cylinder", track=Track([0], [(0, 0, 0)], spin=(0, 0, 9))
    ),
    Obstacle("cone", {"radius": 0.1, "height": 0.4}, name="cone"),
    Obstacle("torus", {"radius": 0.4, "tube_radius": 0.1}, name="torus"),
    Obstacle("mesh", name="tetrahedron", **TETRAHEDRON),  # type: ignore[arg-type]
]
PRIM_TYPES = ["Plane", "Sphere", "Cube", "Capsule", "Cylinder", "Cone", "Mesh", "Mesh"]
Written = Callable[..., Path]


def sheet_of(stage: Usd.Stage) -> UsdGeom.Mesh:
    return UsdGeom.Mesh(stage.GetPrimAtPath("/World/sheet"))


@pytest.mark.parametrize("suffix", [".usdc", ".usda", ".usdz"])
def test_every_suffix_passes_all_checks(tmp_path: Path, written: Written, suffix: str) -> None:
    path = written(tmp_path / f"wave{suffix}", bodies=[SHEET], obstacles=OBSTACLES)
    assert check_stage(path, tolerance=0.01) == []
    assert schema_errors(path) == []
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    head = path.read_bytes()[:8]
    assert head.startswith({".usdc": b"PXR-USDC", ".usda": b"#usda", ".usdz": b"PK"}[suffix])


def test_samples_and_times(tmp_path: Path, written: Written, wave: Callable) -> None:
    stage = Usd.Stage.Open(str(written(tmp_path / "wave.usdc", frames=8)))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 8)
    assert (stage.GetTimeCodesPerSecond(), stage.GetFramesPerSecond()) == (FPS, FPS)
    mesh = sheet_of(stage)
    assert mesh.GetPointsAttr().GetTimeSamples() == [float(k) for k in range(1, 9)]
    assert mesh.GetPointsAttr().Get() is None
    for k in range(8):
        positions, velocities = wave(k / FPS)
        np.testing.assert_allclose(mesh.GetPointsAttr().Get(k + 1), positions["sheet"].reshape(-1, 3), atol=1e-6)
        np.testing.assert_allclose(mesh.GetVelocitiesAttr().Get(k + 1), velocities["sheet"].reshape(-1, 3), atol=1e-6)


def test_prims_of_the_surface(tmp_path: Path, written: Written) -> None:
    stage = Usd.Stage.Open(str(written(tmp_path / "wave.usdc", bodies=[SHEET])))
    root, mesh = stage.GetDefaultPrim(), sheet_of(stage)
    assert root.IsA(UsdGeom.Xform)
    assert Usd.ModelAPI(root).GetKind() == "component"
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
    assert mesh.GetDoubleSidedAttr().Get() is True
    assert mesh.GetNormalsInterpolation() == "vertex"
    assert UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").GetInterpolation() == "faceVarying"
    np.testing.assert_allclose(mesh.GetDisplayColorAttr().Get(), [SHEET.color])
    assert mesh.GetPrim().GetAttribute("warpdeform:thickness").Get() == pytest.approx(0.002)
    material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
    shader, _, _ = material.ComputeSurfaceSource()
    assert shader.GetShaderId() == "UsdPreviewSurface"
    np.testing.assert_allclose(shader.GetInput("diffuseColor").Get(), SHEET.color)


def test_obstacles_are_native_prims_with_their_poses(tmp_path: Path, written: Written) -> None:
    stage = Usd.Stage.Open(str(written(tmp_path / "wave.usdc", obstacles=OBSTACLES)))
    prims = [stage.GetPrimAtPath(f"/World/{obstacle.name}") for obstacle in OBSTACLES]
    assert [prim.GetTypeName() for prim in prims] == PRIM_TYPES
    for prim, obstacle in zip(prims, OBSTACLES, strict=True):
        operations = UsdGeom.Xformable(prim).GetOrderedXformOps()
        sampled = [operation.GetAttr().GetNumTimeSamples() for operation in operations[:2]]
        assert sampled == ([0, 0] if obstacle.track.static else [8, 8])
        assert UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
        for k in (0, 5):
            matrix = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(k + 1))
            position, rotation = obstacle.track.pose(k / FPS)
            np.testing.assert_allclose(matrix[3, :3], position, atol=1e-6)
            axis = matrix[0, :3] / np.linalg.norm(matrix[0, :3])  # where the x axis of the obstacle points
            x, y, z, w = rotation
            expected = [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)]
            np.testing.assert_allclose(axis, expected, atol=1e-6)
    size = np.linalg.norm(np.array(UsdGeom.Xformable(prims[2]).ComputeLocalToWorldTransform(1))[:3, :3], axis=1)
    np.testing.assert_allclose(size * UsdGeom.Cube(prims[2]).GetSizeAttr().Get(), (1.0, 2.0, 0.3), rtol=1e-6)


def test_lengths_are_in_the_units_of_the_file(tmp_path: Path, written: Written, wave: Callable) -> None:
    path = written(tmp_path / "wave.usdc", obstacles=OBSTACLES, up_axis="Y", meters_per_unit=0.01)
    assert check_stage(path, tolerance=0.01) == []
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    positions, velocities = wave(2 / FPS)
    np.testing.assert_allclose(
        sheet_of(stage).GetPointsAttr().Get(3), 100 * positions["sheet"].reshape(-1, 3), rtol=1e-5
    )
    np.testing.assert_allclose(
        sheet_of(stage).GetVelocitiesAttr().Get(3), 100 * velocities["sheet"].reshape(-1, 3), rtol=1e-5, atol=1e-5
    )
    assert stage.GetPrimAtPath("/World/ball").GetAttribute("radius").Get() == pytest.approx(30.0)
    box = np.array(UsdGeom.Xformable(stage.GetPrimAtPath("/World/box")).ComputeLocalToWorldTransform(1))
    np.testing.assert_allclose(box[3, :3], (100.0, 200.0, 300.0))


def test_what_made_the_file_stays_with_it(tmp_path: Path, wave: Callable) -> None:
    metadata = {"scene": '[scene]\nname = "wave"', "versions": {"usd": "26.11", "none": None}, "nodes": (7, 5)}
    statistics = {"newton_iterations": 12, "max_residual": np.float32(0.5), "preconditioner": "jacobi"}
    writer = FrameWriter(tmp_path / "wave.usdc", bodies=[SHEET], fps=FPS, metadata=metadata)
    writer.write(0.0, *wave(0.0))
    assert writer.close(statistics) == tmp_path / "wave.usdc"
    stage = Usd.Stage.Open(str(writer.path))
    assert stage.GetRootLayer().customLayerData["warpdeform"] == {
        "scene": metadata["scene"],
        "versions": {"usd": "26.11"},
        "nodes": "[7, 5]",
        "statistics": statistics,
        "state": "complete",
    }


def test_names_that_usd_cannot_take_are_made_valid_and_kept(tmp_path: Path, wave: Callable) -> None:
    names = ["my sheet", "my-sheet", "Materials", "7"]
    path = tmp_path / "names.usda"
    with FrameWriter(path, bodies=[SurfaceMesh(name, (3, 3)) for name in names], fps=FPS) as writer:
        samples = [wave(0.0, (3, 3), name) for name in names]
        points, velocities = ({k: v for sample in samples for k, v in sample[part].items()} for part in (0, 1))
        writer.write(0.0, points, velocities)
    assert schema_errors(path) == check_stage(path) == []
    stage = Usd.Stage.Open(str(path))
    meshes = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert sorted(mesh.GetDisplayName() or mesh.GetName() for mesh in meshes) == sorted(names)


def test_odd_file_names(tmp_path: Path, written: Written) -> None:
    path = written(tmp_path / "new" / "folder @ [1]" / "a @b ü.v2 [x].usdz")
    assert check_stage(path) == schema_errors(path) == []


def test_two_runs_write_the_same_bytes(tmp_path: Path, written: Written) -> None:
    first, second = (written(tmp_path / name, obstacles=OBSTACLES) for name in ("a.usdc", "b.usdc"))
    assert first.read_bytes() == second.read_bytes()


def test_an_older_file_is_replaced_only_at_the_end(tmp_path: Path, wave: Callable) -> None:
    path = tmp_path / "wave.usdc"
    path.write_text("older")
    with FrameWriter(path, bodies=[SHEET], fps=FPS, chunk_frames=1) as writer:
        writer.write(0.0, *wave(0.0))
        assert path.read_text() == "older"
    assert check_stage(path) == []


def test_without_frames_there_is_no_file(tmp_path: Path) -> None:
    with FrameWriter(tmp_path / "none.usdc", bodies=[SHEET], fps=FPS) as writer:
        pass
    assert writer.close() is None
    assert list(tmp_path.iterdir()) == []


def test_close_can_be_called_twice_and_ends_writing(tmp_path: Path, wave: Callable) -> None:
    writer = FrameWriter(tmp_path / "wave.usdc", bodies=[SHEET], fps=FPS)
    writer.write(0.0, *wave(0.0))
    first = writer.close()
    stamp = writer.path.stat().st_mtime_ns
    assert writer.close() == first
    assert writer.path.stat().st_mtime_ns == stamp
    with pytest.raises(WarpdeformError, match="closed"):
        writer.write(1 / FPS, *wave(1 / FPS))


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e39])
@pytest.mark.parametrize("which", [0, 1])
def test_samples_that_are_not_finite_are_refused(tmp_path: Path, wave: Callable, bad: float, which: int) -> None:
    path = tmp_path / "wave.usdc"
    with FrameWriter(path, bodies=[SHEET], fps=FPS) as writer:
        writer.write(0.0, *wave(0.0))
        sample = wave(1 / FPS)
        sample[which]["sheet"][3, 2, 1] = bad
        with pytest.raises(SimulationFailure, match=r"node \[3, 2\]"):
            writer.write(1 / FPS, *sample)
    assert check_stage(path) == []
    assert Usd.Stage.Open(str(path)).GetEndTimeCode() == 1


def test_samples_that_do_not_fit_are_refused(tmp_path: Path, wave: Callable) -> None:
    good = wave(1 / FPS)
    with FrameWriter(tmp_path / "wave.usdc", bodies=[SHEET], fps=FPS) as writer:
        writer.write(0.0, *wave(0.0))
        with pytest.raises(InputError, match=r"shape \[7, 5, 3\]"):
            writer.write(1 / FPS, *wave(1 / FPS, nodes=(5, 7)))
        with pytest.raises(InputError, match="sample for each body"):
            writer.write(1 / FPS, {}, good[1])
        with pytest.raises(InputError, match="sample for each body"):
            writer.write(1 / FPS, good[0] | {"other": good[0]["sheet"]}, good[1])
        for time in (0.0, 2 / FPS, np.nan):
            with pytest.raises(InputError, match="time of sample 1"):
                writer.write(time, *good)
        writer.write(1 / FPS + 1e-9, *good)
        assert writer.frames == 2


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"fps": 0.0}, "fps"),
        ({"fps": float("nan")}, "fps"),
        ({"up_axis": "X"}, "up_axis"),
        ({"meters_per_unit": -1.0}, "meters_per_unit"),
        ({"bodies": []}, "bodies"),
        ({"bodies": [SHEET, SHEET]}, "sheet"),
        ({"chunk_frames": 0}, "chunk_frames"),
    ],
)
def test_refused_settings(tmp_path: Path, settings: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        FrameWriter(tmp_path / "wave.usdc", **({"bodies": [SHEET], "fps": FPS} | settings))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("wave", "no suffix"),
        ("wave.abc", "suffix .abc"),
        ("wave.usd", "suffix .usd,"),
        ("folder.usdc", "is a folder"),
        ("file.txt/wave.usdc", "which is a file"),
        ("file.txt/deeper/wave.usdc", "which is a file"),
        ("taken.usdc", "taken.partial"),
        ("x" * 300 + ".usdc", "too long"),
        ("x" * 245 + ".usdc", "too long"),
        ("nul\0.usdc", "null"),
    ],
)
def test_refused_paths(tmp_path: Path, name: str, words: str) -> None:
    (tmp_path / "folder.usdc").mkdir()
    (tmp_path / "file.txt").touch()
    (tmp_path / "taken.partial").touch()
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputError, match=words) as caught:
        FrameWriter(tmp_path / name, bodies=[SHEET], fps=FPS)
    assert caught.value.mistakes[0].key == "output"
    assert len(str(caught.value).splitlines()) == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_folders_without_the_right_to_write_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.access", lambda *_: False)  # the tests may run as root, who may write anywhere
    with pytest.raises(InputError, match="no right to write"):
        FrameWriter(tmp_path / "wave.usdc", bodies=[SHEET], fps=FPS)


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a folder that nobody can write in")
def test_folders_that_refuse_when_written_are_refused() -> None:
    with pytest.raises(InputError, match="cannot be written"):
        FrameWriter("/proc/self/wave.usdc", bodies=[SHEET], fps=FPS)
