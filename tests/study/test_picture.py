"""Pictures: what is read from a stage, where the camera stands, what both engines draw, and what is refused."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from motions import shearing_block, waving_strands
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt
from typer.testing import CliRunner

from warpdeform.cli import app
from warpdeform.errors import InputError, WarpdeformError
from warpdeform.study.picture import Camera, render_still, render_strip, shapes
from warpdeform.study.picture import blender as blender_engine
from warpdeform.study.picture.camera import MARGIN, SENSOR, place_camera
from warpdeform.study.picture.drawing import ground_height
from warpdeform.study.picture.stage import StageReader
from warpdeform.study.picture.tubes import tubes
from warpdeform.usd import CurveSet, FrameWriter, SolidBlock

RED, BLUE = (0.5, 0.03, 0.03), (0.02, 0.05, 0.5)


def add_sheet(stage, name, *, color=RED, frames=2, nodes=17, height=1.0, normals=True, roughness=None):
    """A wavy sheet over the unit square that rises by 0.1 m a frame."""
    mesh = UsdGeom.Mesh.Define(stage, f"/World/{name}")
    i, j = np.meshgrid(np.arange(nodes - 1), np.arange(nodes - 1), indexing="ij")
    first = i * nodes + j
    faces = np.stack([first, first + nodes, first + nodes + 1, first + 1], axis=-1).reshape(-1)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray([4] * (nodes - 1) ** 2))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.astype(np.int32)))
    u, v = np.meshgrid(np.linspace(0, 1, nodes), np.linspace(0, 1, nodes), indexing="ij")
    slope = 0.5 * np.cos(10.0 * u)
    up = np.stack([-slope, 0 * u, 1 + 0 * u], axis=-1).reshape(-1, 3)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    for frame in range(1, frames + 1):
        points = np.stack([u, v, height + 0.05 * np.sin(10.0 * u) + 0.1 * (frame - 1)], axis=-1).reshape(-1, 3)
        mesh.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)), frame)
        if normals:
            mesh.CreateNormalsAttr().Set(Vt.Vec3fArray.FromNumpy(up.astype(np.float32)), frame)
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    if color is not None:
        mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set([Gf.Vec3f(*color)])
    if roughness is not None:
        material = UsdShade.Material.Define(stage, f"/World/{name}_look")
        shader = UsdShade.Shader.Define(stage, f"/World/{name}_look/surface")
        shader.CreateIdAttr("UsdPreviewSurface")
        shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(roughness)
        material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    return mesh


def new_stage(path, *, up="Z", metres=1.0, frames=2):
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    if frames:
        stage.SetStartTimeCode(1)
        stage.SetEndTimeCode(frames)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    return stage


@pytest.fixture
def result(tmp_path):
    """A sheet above a sphere on the ground."""
    path = tmp_path / "result.usdc"
    stage = new_stage(path)
    add_sheet(stage, "sheet", roughness=0.7)
    UsdGeom.Plane.Define(stage, "/World/floor")
    ball = UsdGeom.Sphere.Define(stage, "/World/ball")
    ball.GetRadiusAttr().Set(0.3)
    ball.AddTranslateOp().Set((0.5, 0.5, 0.3))
    stage.GetRootLayer().Save()
    return path


def pixels(path):
    image = pytest.importorskip("matplotlib.image").imread(path)
    return np.rint(255 * image[..., :3]).astype(int)


def reddish(image):
    return (image[..., 0] > 1.6 * image[..., 1]) & (image[..., 0] > 1.6 * image[..., 2])


def bluish(image):
    return (image[..., 2] > 1.4 * image[..., 0]) & (image[..., 2] > 1.2 * image[..., 1])


# What is read


def test_reader_tells_bodies_from_obstacles_and_finds_the_ground(result):
    drawing = StageReader(result).draw()
    assert {item.name: item.role for item in drawing.items} == {"/World/sheet": "body", "/World/ball": "obstacle"}
    sheet = drawing.items[0]
    assert drawing.ground == 0.0
    assert drawing.time_code == 2.0
    assert sheet.triangles.shape == (2 * 16 * 16, 3)
    assert sheet.roughness == pytest.approx(0.7)
    np.testing.assert_allclose(sheet.colors, np.broadcast_to(RED, (17 * 17, 3)), rtol=1e-6)
    np.testing.assert_allclose(sheet.points[:, 2].mean(), 1.1, atol=0.02)
    np.testing.assert_allclose(np.linalg.norm(sheet.normals, axis=1), 1.0, rtol=1e-6)
    ball = drawing.items[1]
    np.testing.assert_allclose(np.linalg.norm(ball.points - [0.5, 0.5, 0.3], axis=1), 0.3, rtol=1e-9)


def test_reader_takes_frames_between_samples(result):
    heights = [StageReader(result).draw(frame).items[0].points[:, 2].mean() for frame in (1, 1.5, 2)]
    np.testing.assert_allclose(np.diff(heights), 0.05, rtol=1e-5)


def test_reader_turns_and_scales_to_metres_with_z_up(tmp_path):
    path = tmp_path / "yup.usda"
    stage = new_stage(path, up="Y", metres=0.01, frames=0)
    box = UsdGeom.Cube.Define(stage, "/World/box")
    box.GetSizeAttr().Set(10.0)
    box.AddTranslateOp().Set((0, 100, 0))
    stage.GetRootLayer().Save()
    (item,) = StageReader(path).draw().items
    np.testing.assert_allclose(item.points.mean(axis=0), [0, 0, 1.0], atol=1e-12)
    np.testing.assert_allclose(np.ptp(item.points, axis=0), 0.1)


def test_reader_skips_what_is_hidden_and_splits_corners_with_their_own_normals(tmp_path):
    path = tmp_path / "mesh.usda"
    stage = new_stage(path, frames=0)
    UsdGeom.Imageable(UsdGeom.Sphere.Define(stage, "/World/hidden")).MakeInvisible()
    UsdGeom.Imageable(UsdGeom.Sphere.Define(stage, "/World/guide")).CreatePurposeAttr("guide")
    mesh = UsdGeom.Mesh.Define(stage, "/World/fold")
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (1, 0, 1)])
    mesh.CreateFaceVertexCountsAttr([4, 3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3, 1, 4, 2])
    mesh.CreateNormalsAttr([(0, 0, 1), (-1, 0, 0)])
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.uniform)
    stage.GetRootLayer().Save()
    (item,) = StageReader(path).draw().items
    assert item.points.shape == (7, 3)
    assert item.triangles.tolist() == [[0, 1, 2], [4, 5, 6], [0, 2, 3]]
    assert item.normals.tolist() == [[0, 0, 1]] * 4 + [[-1, 0, 0]] * 3


def test_ground_lies_below_a_body_that_hangs_free_and_under_a_pole(tmp_path):
    stage = new_stage(tmp_path / "free.usda")
    add_sheet(stage, "sheet")
    stage.GetRootLayer().Save()
    drawing = StageReader(tmp_path / "free.usda").draw(1)
    assert 0.7 < ground_height((drawing,)) < 0.95
    pole = UsdGeom.Cylinder.Define(stage, "/World/pole")
    pole.GetRadiusAttr().Set(0.02)
    pole.GetHeightAttr().Set(1.2)
    pole.AddTranslateOp().Set((0, 0, 0.65))
    stage.GetRootLayer().Save()
    drawing = StageReader(tmp_path / "free.usda").draw(1)
    assert ground_height((drawing,)) == pytest.approx(0.05)


def add_curves(stage, name, strands, *, widths, interpolation="constant", wrap="nonperiodic", color=RED):
    """Linear curves of any lengths at frame 1."""
    curves = UsdGeom.BasisCurves.Define(stage, f"/World/{name}")
    curves.CreateTypeAttr("linear")
    curves.CreateWrapAttr(wrap)
    curves.CreateCurveVertexCountsAttr([len(strand) for strand in strands])
    curves.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy(np.concatenate(strands).astype(np.float32)), 1)
    curves.CreateWidthsAttr(Vt.FloatArray.FromNumpy(np.asarray(widths, dtype=np.float32)))
    curves.SetWidthsInterpolation(interpolation)
    curves.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set([Gf.Vec3f(*color)])
    return curves


def test_reader_makes_tubes_of_curves_with_their_widths(tmp_path):
    stage = new_stage(tmp_path / "curves.usda", frames=1)
    short, long = np.array([[0, 0, 0], [0, 0, 1.0]]), np.array([[1, 0, 0], [1, 0, 1.0], [1, 1, 1], [1, 1, 0]])
    add_curves(stage, "rope", [short, long, short + [3, 0, 0]], widths=[0.1, 0.2, 0.4], interpolation="uniform")
    add_curves(stage, "point", [np.zeros((1, 3))], widths=[0.1])
    UsdGeom.Sphere.Define(stage, "/World/ball")
    stage.GetRootLayer().Save()
    drawing = StageReader(tmp_path / "curves.usda").draw()
    assert {item.name: item.role for item in drawing.items} == {"/World/rope": "body", "/World/ball": "obstacle"}
    (rope,) = (item for item in drawing.items if item.role == "body")
    assert not rope.thin
    np.testing.assert_allclose(rope.colors, np.broadcast_to(RED, rope.points.shape), rtol=1e-6)
    for x, radius in ((0.0, 0.05), (3.0, 0.2)):
        near = np.abs(rope.points[:, 0] - x) < 0.5
        across = np.linalg.norm(rope.points[near][:, :2] - [x, 0], axis=1)
        np.testing.assert_allclose(across, radius, rtol=1e-6)
    assert signed_volume(rope.points, rope.triangles) > 0


@pytest.mark.parametrize("closed", [False, True])
def test_tubes_are_closed_face_outwards_and_do_not_wind(closed):
    angle = np.linspace(0.0, 2 * np.pi, 40, endpoint=not closed)
    knot = np.stack([(2 + np.cos(3 * angle)) * np.cos(2 * angle), (2 + np.cos(3 * angle)) * np.sin(2 * angle),
                     np.sin(3 * angle)], axis=-1)  # fmt: skip
    paths = np.stack([knot, 0.5 * knot[:, [1, 2, 0]]])
    radii = np.broadcast_to([[0.1], [0.05]], (2, 40))
    points, triangles, normals, owners = tubes(paths, radii, 9, closed=closed)
    assert len(points) == len(normals) == len(owners)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-9)
    reach = np.linalg.norm(points - paths.reshape(-1, 3)[owners], axis=1)
    np.testing.assert_allclose(reach, radii.reshape(-1)[owners], rtol=1e-9)
    a, b, c = points[triangles].swapaxes(0, 1)
    assert (np.einsum("mx,mx->m", np.cross(b - a, c - a), normals[triangles].sum(axis=1)) > 0).all()
    lengths = np.linalg.norm(np.diff(np.concatenate([paths, paths[:, :1]], axis=1), axis=1), axis=2)
    length = (lengths if closed else lengths[:, :-1]).sum(axis=1)
    expected = length @ [0.1**2, 0.05**2] * 4.5 * np.sin(2 * np.pi / 9)
    assert signed_volume(points, triangles) == pytest.approx(expected, rel=0.03)
    _, counts = np.unique(np.sort(merged(points, triangles), axis=1), axis=0, return_counts=True)
    assert (counts == 2).all()


def test_closed_tubes_join_without_a_twist():
    """Frames that are carried around this coil come back turned by 25 degrees."""
    angle = np.linspace(0.0, 2 * np.pi, 200, endpoint=False)
    reach = 2 + 0.6 * np.cos(5 * angle)
    coil = np.stack([reach * np.cos(angle), reach * np.sin(angle), 0.6 * np.sin(5 * angle)], axis=-1)
    points, triangles, _, owners = tubes(coil[None], np.full((1, 200), 0.3), 48, closed=True)
    a, b = points[triangles], points[np.roll(triangles, -1, axis=1)]
    lengths = np.linalg.norm(b - a, axis=2)
    seam = (owners[triangles] == 0).any(axis=1) & (owners[triangles] == 199).any(axis=1)
    assert seam.sum() == 2 * 48
    assert lengths[seam].max() < 1.1 * lengths[~seam].max()


def test_tubes_survive_nodes_that_coincide_or_turn_back():
    paths = np.array([[[0, 0, 0], [0, 0, 0], [0, 0, 1], [0, 0, 0.5], [0, 0, 0.5]]], dtype=float)
    points, _, normals, _ = tubes(paths, np.full((1, 5), 0.1), 6, closed=False)
    assert np.isfinite(points).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-9)


def signed_volume(points, triangles):
    a, b, c = points[triangles].swapaxes(0, 1)
    return np.einsum("mx,mx->m", a, np.cross(b, c)).sum() / 6


def merged(points, triangles):
    """Edges of triangles (3 m, 2) by the numbers of places, where vertices at one place count as one."""
    _, place = np.unique(np.round(points, 9), axis=0, return_inverse=True)
    corners = place.reshape(-1)[triangles]
    return np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2)


@pytest.mark.parametrize(
    ("surface", "volume"),
    [
        (shapes.sphere(0.5), 4 / 3 * np.pi * 0.125),
        (shapes.cylinder(0.5, 2.0), np.pi * 0.5),
        (shapes.along(shapes.cylinder(0.5, 2.0), "X"), np.pi * 0.5),
        (shapes.capsule(0.5, 2.0), np.pi * 0.5 + 4 / 3 * np.pi * 0.125),
        (shapes.cone(0.5, 2.0), np.pi * 0.5 / 3),
        (shapes.along(shapes.cube(2.0), "Y"), 8.0),
    ],
    ids=["sphere", "cylinder", "cylinder-x", "capsule", "cone", "cube-y"],
)
def test_solids_are_closed_face_outwards_and_have_unit_normals(surface, volume):
    points, triangles, normals = surface
    a, b, c = points[triangles].swapaxes(0, 1)
    assert signed_volume(points, triangles) == pytest.approx(volume, rel=5e-3)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-9)
    flat = np.cross(b - a, c - a)
    real = np.linalg.norm(flat, axis=1) > 1e-12
    assert (np.einsum("mx,mx->m", flat, normals[triangles].sum(axis=1))[real] > 0).all()


# Where the camera stands


@pytest.mark.parametrize("size", [(1280, 720), (300, 900)])
@pytest.mark.parametrize("azimuth", [-62.0, 0.0, 170.0])
def test_camera_sees_everything_and_no_more_than_it_must(size, azimuth):
    subject = np.random.default_rng(3).normal(size=(200, 3)) * [1.0, 0.3, 2.0] + [5.0, -3.0, 1.0]
    camera = Camera(azimuth=azimuth)
    view = place_camera(camera, subject, size)
    np.testing.assert_allclose(view.axes @ view.axes.T, np.eye(3), atol=1e-12)
    right, up, back = ((subject - view.position) @ view.axes.T).T
    scale = 2 * camera.lens * max(size) / SENSOR
    across, upward = scale * right / -back / size[0], scale * up / -back / size[1]
    assert (back < 0).all()
    assert max(abs(across).max(), abs(upward).max()) == pytest.approx(1 / MARGIN)


def test_camera_distance_and_explicit_position():
    subject = np.array([[0.0, 0, 0], [1, 1, 1]])
    near, far = (place_camera(Camera(distance=d), subject, (640, 360)) for d in (1.0, 2.0))
    assert far.distance == pytest.approx(2 * near.distance, rel=0.05)
    placed = place_camera(Camera(position=(3.0, 0.5, 0.5), target=(0.5, 0.5, 0.5)), subject, (640, 360))
    np.testing.assert_allclose(placed.axes[2], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(placed.position, [3, 0.5, 0.5])


@pytest.mark.parametrize(
    "wrong", [{"elevation": 95.0}, {"distance": 0.0}, {"lens": 2.0}, {"azimuth": float("nan")},
              {"position": (0.0, 0.0, 0.0), "target": (0.0, 0.0, 0.0)}]
)  # fmt: skip
def test_camera_refuses_impossible_places(wrong):
    with pytest.raises(InputError, match="camera"):
        Camera(**wrong)


# What is drawn


def check_picture(image, size):
    """The sheet is there in its colour, shaded; the ground is bright and has a shadow."""
    assert image.shape == (size[1], size[0], 3)
    sheet = reddish(image)
    assert 0.05 < sheet.mean() < 0.8
    assert np.ptp(image[sheet][:, 0]) > 15
    ground = ~sheet & (np.ptp(image, axis=-1) < 30)
    assert np.percentile(image[ground], 90) > 150
    assert np.percentile(image[ground], 90) - np.percentile(image[ground], 2) > 25


def test_matplotlib_draws_a_still(result, tmp_path):
    pytest.importorskip("matplotlib")
    out = tmp_path / "still.png"
    picture = render_still(result, out, size=(192, 108), engine="matplotlib")
    assert picture.engine == "matplotlib"
    assert picture.frames == (2.0,)
    check_picture(pixels(out), (192, 108))
    assert [path.name for path in tmp_path.iterdir() if path.suffix != ".usdc"] == ["still.png"]


def test_matplotlib_hides_what_is_behind(tmp_path):
    pytest.importorskip("matplotlib")
    stage = new_stage(tmp_path / "two.usda", frames=1)
    add_sheet(stage, "above", frames=1, height=0.6)
    add_sheet(stage, "below", frames=1, height=0.0, color=BLUE, normals=False)
    stage.GetRootLayer().Save()
    seen = {}
    for name, elevation in (("top", 80.0), ("bottom", -80.0)):
        out = tmp_path / f"{name}.png"
        render_still(tmp_path / "two.usda", out, size=(120, 120), engine="matplotlib", camera=(0.0, elevation, 1.0))
        image = pixels(out)[40:80, 40:80]
        seen[name] = reddish(image).mean(), bluish(image).mean()
    assert seen["top"] == (1.0, 0.0)
    assert seen["bottom"] == (0.0, 1.0)


def test_matplotlib_draws_strands_and_solids_that_the_engine_writes(tmp_path):
    """Red strands behind a blue block, seen from either side of it."""
    pytest.importorskip("matplotlib")
    path = tmp_path / "both.usdc"
    bodies = [CurveSet("strands", (9, 8), 0.03, color=RED), SolidBlock("block", (5, 4, 3), color=BLUE)]
    samples = {"strands": waving_strands(0.0, (9, 8), length=0.2), "block": shearing_block(0.0)}
    places = {"strands": [-0.17, 0.0, 0.0], "block": [0.0, 0.6, 0.0]}
    with FrameWriter(path, bodies=bodies, fps=60) as writer:
        positions = {name: sample[0] + places[name] for name, sample in samples.items()}
        writer.write(0.0, positions, {name: sample[1] for name, sample in samples.items()})
    drawing = StageReader(path).draw()
    assert [(item.name, item.thin) for item in drawing.items] == [("/World/strands", False), ("/World/block", False)]
    for azimuth, seen in ((-90.0, True), (90.0, False)):
        render_still(path, tmp_path / "both.png", size=(192, 108), engine="matplotlib", camera=(azimuth, 3.0, 1.0))
        image = pixels(tmp_path / "both.png")
        assert bluish(image).mean() > 0.04
        assert reddish(image).mean() > 0.05 if seen else not reddish(image).any()


def test_matplotlib_shows_the_near_side_of_solids(tmp_path):
    """A red rope in a blue block is not seen."""
    pytest.importorskip("matplotlib")
    path = tmp_path / "inside.usdc"
    with FrameWriter(path, fps=60, bodies=[CurveSet("rope", (2, 1), 0.05, color=RED),
                                           SolidBlock("block", (3, 3, 3), color=BLUE)]) as writer:  # fmt: skip
        rope, block = np.array([[[0.0, 0.0, 0.1]], [[0.0, 0.0, 0.2]]]), shearing_block(0.0, (3, 3, 3))[0]
        writer.write(0.0, {"rope": rope, "block": block}, {"rope": 0 * rope, "block": 0 * block})
    render_still(path, tmp_path / "inside.png", size=(96, 54), engine="matplotlib")
    image = pixels(tmp_path / "inside.png")
    assert bluish(image).mean() > 0.1
    assert not reddish(image).any()


def test_matplotlib_draws_a_strip(result, tmp_path):
    pytest.importorskip("matplotlib")
    out = tmp_path / "strip.png"
    picture = render_strip(result, out, frames=2, size=(242, 80), engine="matplotlib")
    assert picture.frames == (1.0, 2.0)
    image = pixels(out)
    assert picture.size == (242, 80)
    assert image.shape == (80, 242, 3)
    assert (image[:, 120:122] == 255).all()
    left, right = reddish(image[:, :120]), reddish(image[:, 122:])
    assert np.argwhere(left)[:, 0].mean() > np.argwhere(right)[:, 0].mean() + 2


def test_two_pictures_of_one_frame_are_alike_to_the_bit(result, tmp_path):
    pytest.importorskip("matplotlib")
    for name in ("a.png", "b.png"):
        render_still(result, tmp_path / name, size=(96, 54), engine="matplotlib")
    np.testing.assert_array_equal(pixels(tmp_path / "a.png"), pixels(tmp_path / "b.png"))


needs_blender = pytest.mark.skipif(
    blender_engine.blender_python() is None,
    reason="bpy is not installed: pip install 'warpdeform[pictures]' in Python 3.11, or set WARPDEFORM_BLENDER_PYTHON",
)


@needs_blender
def test_blender_draws_a_strip_of_both_frames(result, tmp_path):
    out = tmp_path / "strip.png"
    try:
        picture = render_strip(result, out, frames=2, size=(258, 72), engine="blender", samples=8)
    except InputError as error:
        if "shared object" in str(error):
            pytest.skip(str(error))
        raise
    assert picture.engine == "blender"
    image = pixels(out)
    check_picture(image[:, :128], (128, 72))
    check_picture(image[:, 130:], (128, 72))
    left, right = reddish(image[:, :128]), reddish(image[:, 130:])
    assert np.argwhere(left)[:, 0].mean() > np.argwhere(right)[:, 0].mean() + 2


# What is refused, and how


def test_wrong_arguments_are_named_all_at_once(result, tmp_path):
    with pytest.raises(InputError) as caught:
        render_still(result, tmp_path / "no" / "still.jpg", size=(4, 90), engine="povray", samples=0)
    assert {mistake.key for mistake in caught.value.mistakes} == {"out", "size", "engine", "samples"}


def test_frames_outside_the_file_are_refused_with_its_range(result, tmp_path):
    with pytest.raises(InputError, match=r"frame = 7.*1 \(the first\) to 2 \(the last\)"):
        render_still(result, tmp_path / "still.png", frame=7)
    with pytest.raises(InputError, match="do not fit"):
        render_strip(result, tmp_path / "strip.png", frames=30, size=(100, 60))
    for frames in (0, []):
        with pytest.raises(InputError, match="frames"):
            render_strip(result, tmp_path / "strip.png", frames=frames)


def test_files_that_show_nothing_are_refused(tmp_path):
    out = tmp_path / "still.png"
    with pytest.raises(InputError, match="does not exist"):
        render_still(tmp_path / "none.usdc", out)
    (tmp_path / "broken.usdc").write_bytes(b"PXR-USDC then nothing")
    with pytest.raises(InputError, match="cannot be read as USD"):
        render_still(tmp_path / "broken.usdc", out)
    stage = new_stage(tmp_path / "empty.usda")
    stage.GetRootLayer().Save()
    with pytest.raises(InputError, match="nothing to draw"):
        render_still(tmp_path / "empty.usda", out)
    stage = new_stage(tmp_path / "nan.usda", frames=1)
    mesh = add_sheet(stage, "sheet", frames=1)
    points = np.array(mesh.GetPointsAttr().Get(1))
    points[3] = np.nan
    mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points), 1)
    stage.GetRootLayer().Save()
    with pytest.raises(InputError, match="/World/sheet: has points that are not finite at frame 1"):
        render_still(tmp_path / "nan.usda", out)
    assert not out.exists()


def fake_python(tmp_path, monkeypatch, message, code):
    """A stand-in for the Python that should draw: it prints and ends."""
    program = tmp_path / "fake-python"
    program.write_text(f"#!/bin/sh\necho '{message}' >&2\nexit {code}\n")
    program.chmod(0o755)
    monkeypatch.setenv(blender_engine.PYTHON_VARIABLE, str(program))


def test_missing_blender_names_the_remedy(result, tmp_path, monkeypatch):
    monkeypatch.delenv(blender_engine.PYTHON_VARIABLE, raising=False)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install 'warpdeform\[pictures\]'"):
        render_still(result, tmp_path / "still.png", engine="blender")
    monkeypatch.setenv(blender_engine.PYTHON_VARIABLE, str(tmp_path / "nowhere"))
    with pytest.raises(InputError, match="cannot be started"):
        render_still(result, tmp_path / "still.png", engine="blender")


def test_missing_libraries_name_the_debian_packages(result, tmp_path, monkeypatch):
    fake_python(tmp_path, monkeypatch, "cannot import bpy: libXi.so.6: cannot open shared object file", 3)
    with pytest.raises(InputError, match=r"libXi.so.6.*apt-get install libxi6"):
        render_still(result, tmp_path / "still.png", engine="blender")


def test_a_failing_blender_is_quoted(result, tmp_path, monkeypatch):
    fake_python(tmp_path, monkeypatch, "out of memory", 1)
    with pytest.raises(WarpdeformError, match="exit code 1:\nout of memory"):
        render_still(result, tmp_path / "still.png", engine="blender")


def test_auto_falls_back_to_matplotlib_and_says_why(result, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    fake_python(tmp_path, monkeypatch, "cannot import bpy: No module named bpy", 3)
    with pytest.warns(UserWarning, match="matplotlib instead"):
        picture = render_still(result, tmp_path / "still.png", size=(64, 36))
    assert picture.engine == "matplotlib"


# The command


def run(*arguments):
    return CliRunner().invoke(app, ["picture", *(str(argument) for argument in arguments)])


def test_command_prints_one_json_object(result, tmp_path):
    pytest.importorskip("matplotlib")
    out = tmp_path / "still.png"
    done = run(result, "--out", out, "--frame", 1, "--size", "96x54", "--engine", "matplotlib", "--json")
    assert done.exit_code == 0, done.output
    record = json.loads(done.stdout)
    assert record.pop("wall_s") > 0
    assert record == {"path": str(out), "engine": "matplotlib", "frames": [1.0], "size": [96, 54]}
    assert pixels(out).shape == (54, 96, 3)


@pytest.mark.parametrize(
    ("option", "message"),
    [
        (("--size", "big"), "size"),
        (("--strip", "1,x"), "strip"),
        (("--position", "1,2"), "position"),
        (("--strip", "3", "--frame", "1"), "frame"),
    ],
)
def test_command_refuses_what_it_cannot_read(result, option, message):
    done = run(result, *option)
    assert done.exit_code == 2
    assert done.stderr.startswith(message)
    assert done.stderr.count("\n") == 1


def test_importing_pictures_imports_nothing_heavy():
    heavy = ("pxr", "bpy", "matplotlib", "PIL", "warp")
    code = f"import sys, warpdeform.study.picture; print([name for name in {heavy} if name in sys.modules])"
    root = Path(__file__).parents[2]
    assert subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True).stdout == "[]\n"
