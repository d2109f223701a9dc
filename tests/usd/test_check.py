"""Every check finds its mistake, in files that are right except for it."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from motions import shearing_block, waving_strands
from pxr import Gf, Usd, UsdGeom

from warpdeform.errors import InputError
from warpdeform.obstacle import Obstacle
from warpdeform.track import Track
from warpdeform.usd.check import check_stage, schema_errors
from warpdeform.usd.curves import CurveSet
from warpdeform.usd.mesh import warp_asset
from warpdeform.usd.solid import SolidBlock

BALL = Obstacle("sphere", {"radius": 0.3}, name="ball", track=Track.line((0, 0, 0), (1, 0, 2), 0.0, 0.1))
TORUS = Obstacle("torus", {"radius": 0.4, "tube_radius": 0.1}, name="torus")
FPS = 60.0
Edit = Callable[[Usd.Stage, UsdGeom.Mesh], object]


def change(attribute: str, code: float, node: int, value: tuple[float, float, float]) -> Edit:
    """Set one element of a sample."""

    def edit(_: Usd.Stage, mesh: UsdGeom.Mesh) -> None:
        target = mesh.GetPrim().GetAttribute(attribute)
        array = np.array(target.Get(code))
        array[node] = value
        target.Set(array, code)

    return edit


def scale(attribute: str, factor: float) -> Edit:
    """Multiply all samples of an attribute."""

    def edit(_: Usd.Stage, mesh: UsdGeom.Mesh) -> None:
        target = mesh.GetPrim().GetAttribute(attribute)
        for code in target.GetTimeSamples():
            target.Set(factor * np.array(target.Get(code)), code)

    return edit


def reverse(name: str) -> Edit:
    """Turn the faces of a mesh around."""

    def edit(stage: Usd.Stage, _: UsdGeom.Mesh) -> None:
        indices = UsdGeom.Mesh(stage.GetPrimAtPath(f"/World/{name}")).GetFaceVertexIndicesAttr()
        indices.Set(np.array(indices.Get()).reshape(-1, 4)[:, ::-1].reshape(-1))

    return edit


MISTAKES: dict[str, tuple[Edit, str]] = {
    "not finite": (change("points", 3, 2, (0, np.nan, 0)), "points is not finite (element 2, time code 3)"),
    "velocity not finite": (change("velocities", 3, 2, (0, np.inf, 0)), "velocities is not finite"),
    "extent": (change("extent", 4, 1, (1.2, 0.9, 0.2)), "the extent is not that of the points (time code 4)"),
    "lost sample": (lambda _, mesh: mesh.GetNormalsAttr().ClearAtTime(5), "normals does not have one sample at each"),
    "sample off the frames": (
        lambda _, m: m.GetPointsAttr().Set(m.GetPointsAttr().Get(2), 2.5),
        "points does not have",
    ),
    "span": (lambda stage, _: stage.SetEndTimeCode(9), "(8 samples from 1 to 8)"),
    "fewer points": (lambda _, m: m.GetPointsAttr().Set(m.GetPointsAttr().Get(2)[:-1], 2), "number of points changes"),
    "fewer velocities": (lambda _, m: m.GetVelocitiesAttr().Set([(0, 0, 0)], 2), "not as many velocities as points"),
    "fewer normals": (lambda _, m: m.GetNormalsAttr().Set([(0, 0, 1)], 2), "not as many normals as points"),
    "changing topology": (
        lambda _, m: m.GetFaceVertexIndicesAttr().Set(m.GetFaceVertexIndicesAttr().Get(), 2),
        "faceVertexIndices changes over time",
    ),
    "bad index": (lambda _, m: m.GetFaceVertexIndicesAttr().Set([99] * 96), "the faces do not fit the points"),
    "velocities per frame": (scale("velocities", 1 / FPS), "velocities do not agree with the motion"),
    "velocities backwards": (scale("velocities", -1.0), "velocities do not agree with the motion"),
    "normals too long": (scale("normals", 1.5), "normals do not have length 1"),
    "normals inside": (scale("normals", -1.0), "normals lie on the other side than the winding"),
    "winding": (reverse("sheet"), "normals lie on the other side than the winding"),
    "closed mesh inside out": (reverse("torus"), "/World/torus: the mesh is closed, but its faces look inwards"),
    "no up axis": (lambda stage, _: stage.ClearMetadata("upAxis"), "upAxis is not authored"),
    "no units": (lambda stage, _: stage.ClearMetadata("metersPerUnit"), "metersPerUnit is not authored"),
    "rates": (lambda stage, _: stage.SetFramesPerSecond(24), "framesPerSecond is not authored as"),
    "no first frame": (lambda stage, _: stage.ClearMetadata("startTimeCode"), "startTimeCode is not authored"),
    "no default prim": (lambda stage, _: stage.ClearDefaultPrim(), "there is no default prim"),
    "no kind": (lambda stage, _: stage.GetDefaultPrim().ClearMetadata("kind"), "the default prim has no kind"),
    "pose": (
        lambda stage, _: stage.GetAttributeAtPath("/World/ball.xformOp:translate").Set((np.nan, 0, 0), 3),
        "/World/ball: xformOp:translate is not finite (time code 3)",
    ),
    "quaternion": (
        lambda stage, _: stage.GetAttributeAtPath("/World/ball.xformOp:orient").Set(Gf.Quatf(2, 0, 0, 0), 3),
        "xformOp:orient is not a unit quaternion",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_every_mistake_is_found(tmp_path: Path, written: Callable[..., Path], name: str) -> None:
    path = written(tmp_path / "wave.usda", obstacles=[BALL, TORUS])
    assert check_stage(path) == []
    edit, words = MISTAKES[name]
    stage = Usd.Stage.Open(str(path))
    edit(stage, UsdGeom.Mesh(stage.GetPrimAtPath("/World/sheet")))
    stage.Save()
    findings = check_stage(path)
    assert any(words in finding for finding in findings), findings


def curves_of(stage: Usd.Stage) -> UsdGeom.BasisCurves:
    return UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/hair"))


def cells_of(stage: Usd.Stage) -> UsdGeom.TetMesh:
    return UsdGeom.TetMesh(stage.GetPrimAtPath("/World/block_tetrahedra"))


def set_element(attribute: Usd.Attribute, code: float | None, node: int, value: object) -> None:
    """Set one element of a sample, or of the value at all times."""
    time = Usd.TimeCode.Default() if code is None else Usd.TimeCode(code)
    array = np.array(attribute.Get(time))
    array[node] = value
    attribute.Set(array, time)


def grow(stage: Usd.Stage) -> None:
    """Make a strand half as thick again, but not its extent."""
    set_element(curves_of(stage).GetWidthsAttr(), None, 3, 0.03)


def turn(stage: Usd.Stage) -> None:
    """Say that the tetrahedra are left-handed."""
    cells_of(stage).GetOrientationAttr().Set(UsdGeom.Tokens.leftHanded)


OTHER_KINDS: dict[str, tuple[Callable[[Usd.Stage], object], str]] = {
    "counts": (
        lambda stage: curves_of(stage).GetCurveVertexCountsAttr().Set([9] * 3 + [8]),
        "/World/hair: the curves do not fit the points",
    ),
    "one point": (
        lambda stage: curves_of(stage).GetCurveVertexCountsAttr().Set([9] * 3 + [8, 1]),
        "the curves do not fit the points",
    ),
    "closed from two points": (
        lambda stage: (
            curves_of(stage).GetWrapAttr().Set("periodic"),
            curves_of(stage).GetCurveVertexCountsAttr().Set([2] * 18),
        ),
        "the curves do not fit the points",
    ),
    "changing counts": (
        lambda stage: curves_of(stage).GetCurveVertexCountsAttr().Set([9] * 4, 2),
        "curveVertexCounts changes over time",
    ),
    "fewer widths": (lambda stage: curves_of(stage).GetWidthsAttr().Set([0.02] * 35), "35 and not 36, time code 1"),
    "widths of strands": (
        lambda stage: curves_of(stage).SetWidthsInterpolation("uniform"),
        "there are not as many widths as are uniform (36 and not 4",
    ),
    "no width": (
        lambda stage: set_element(curves_of(stage).GetWidthsAttr(), None, 3, 0.0),
        "widths are not finite and",
    ),
    "bad width": (
        lambda stage: set_element(curves_of(stage).GetWidthsAttr(), None, 3, np.nan),
        "/World/hair: widths are not finite and above 0 (time code 1), and 5 more",
    ),
    "wider than the extent": (grow, "/World/hair: the extent is not that of the points (time code 1), and 5 more"),
    "strand not finite": (
        lambda stage: set_element(curves_of(stage).GetPointsAttr(), 2, 30, np.inf),
        "/World/hair: points is not finite (element 30, time code 2)",
    ),
    "strands backwards": (
        lambda stage: [
            curves_of(stage).GetVelocitiesAttr().Set(-np.array(curves_of(stage).GetVelocitiesAttr().Get(k)), k)
            for k in range(1, 7)
        ],
        "/World/hair: velocities do not agree with the motion",
    ),
    "lost strand sample": (
        lambda stage: curves_of(stage).GetVelocitiesAttr().ClearAtTime(3),
        "/World/hair: velocities does not have one sample at each time code",
    ),
    "inverted": (
        lambda stage: set_element(cells_of(stage).GetPointsAttr(), 4, 0, (0.25, 0.2, 0.2)),
        "/World/block_tetrahedra: tetrahedra are inverted (",
    ),
    "all inverted": (turn, "tetrahedra are inverted (144 of 144, time code 1), and 5 more"),
    "bad corner": (
        lambda stage: set_element(cells_of(stage).GetTetVertexIndicesAttr(), None, 0, 99),
        "the tetrahedra do not fit the points",
    ),
    "bad surface": (
        lambda stage: set_element(cells_of(stage).GetSurfaceFaceVertexIndicesAttr(), None, 0, -1),
        "the surface faces do not fit the points",
    ),
    "skin inside out": (
        lambda stage: UsdGeom.Mesh(stage.GetPrimAtPath("/World/block")).GetOrientationAttr().Set("leftHanded"),
        "/World/block: the mesh is closed, but its faces look inwards",
    ),
    "normals of corners": (
        lambda stage: UsdGeom.Mesh(stage.GetPrimAtPath("/World/block")).GetNormalsAttr().Set([(0, 0, 1)], 2),
        "there are not as many normals as face corners (time code 2)",
    ),
}


@pytest.mark.parametrize("name", OTHER_KINDS)
def test_every_mistake_of_curves_and_solids_is_found(tmp_path: Path, recorded: Callable[..., Path], name: str) -> None:
    hair = CurveSet("hair", (9, 4), np.linspace(0.01, 0.005, 9)[:, None])
    path = recorded(tmp_path / "both.usda", [(hair, waving_strands), (SolidBlock("block", (5, 4, 3)), shearing_block)])
    assert check_stage(path, tolerance=0.01) == []
    edit, words = OTHER_KINDS[name]
    stage = Usd.Stage.Open(str(path))
    edit(stage)
    stage.Save()
    findings = check_stage(path)
    assert any(words in finding for finding in findings), findings


def test_widths_by_strand_may_change_over_time(tmp_path: Path, recorded: Callable[..., Path]) -> None:
    path = recorded(tmp_path / "hair.usda", [(CurveSet("hair", (9, 4), 0.01), waving_strands)])
    stage = Usd.Stage.Open(str(path))
    curves = curves_of(stage)
    curves.GetWidthsAttr().Clear()
    curves.SetWidthsInterpolation("uniform")
    for code in range(1, 7):
        curves.GetWidthsAttr().Set([0.02, 0.01 * code, 0.01, 0.01], code)
        curves.GetExtentAttr().Set(UsdGeom.Boundable.ComputeExtentFromPlugins(curves, code), code)
    stage.Save()
    assert check_stage(path) == []


def test_repeated_mistakes_are_counted(tmp_path: Path, written: Callable[..., Path]) -> None:
    path = written(tmp_path / "wave.usda")
    stage = Usd.Stage.Open(str(path))
    scale("normals", 2.0)(stage, UsdGeom.Mesh(stage.GetPrimAtPath("/World/sheet")))
    stage.Save()
    assert check_stage(path) == ["/World/sheet: normals do not have length 1 (time code 1), and 7 more"]


def test_velocities_at_the_end_of_a_step_are_accepted(tmp_path: Path, written: Callable[..., Path]) -> None:
    path = written(tmp_path / "wave.usda", frames=30)
    stage = Usd.Stage.Open(str(path))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/sheet"))
    for code in range(2, 31):
        points = [np.array(mesh.GetPointsAttr().Get(k)) for k in (code - 1, code)]
        mesh.GetVelocitiesAttr().Set((points[1] - points[0]) * FPS, code)
    stage.Save()
    assert check_stage(path, tolerance=0.01) == []


def test_validators_find_what_usd_forbids(tmp_path: Path, written: Callable[..., Path]) -> None:
    path = written(tmp_path / "wave.usda")
    stage = Usd.Stage.Open(str(path))
    UsdGeom.Sphere.Define(stage, "/World/sheet/inside")
    stage.Save()
    assert any("NestedGprims" in error or "nested" in error.lower() for error in schema_errors(path))


def test_still_files_need_no_rates() -> None:
    assert check_stage(warp_asset("bunny")) == ["/root: the default prim has no kind"]


def test_files_that_cannot_be_opened(tmp_path: Path) -> None:
    (tmp_path / "bad.usdc").write_text("garbage")
    for check in (check_stage, schema_errors):
        with pytest.raises(InputError, match="cannot be read as USD"):
            check(tmp_path / "bad.usdc")


def test_pxr_is_imported_only_when_it_is_needed() -> None:
    names = "check_output, CurveSet, SolidBlock, SurfaceMesh"
    code = f"import sys, warpdeform.usd; from warpdeform.usd import {names}; print('pxr' in sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "False"
