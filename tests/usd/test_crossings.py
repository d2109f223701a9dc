"""The referee on files: meshes, curves and solids, each with itself and with the others."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from motions import Sample, shearing_block
from pxr import Usd, UsdGeom

from warpdeform.errors import InputError
from warpdeform.obstacle import Obstacle
from warpdeform.usd.crossings import count_crossings
from warpdeform.usd.curves import CurveSet
from warpdeform.usd.solid import SolidBlock
from warpdeform.usd.surface import SurfaceMesh


def falling_sheet(time: float, nodes: tuple[int, int]) -> Sample:
    """A level sheet that falls from 0.12 m at 2.4 m/s: at frame 4 of 60 a second it arrives at 0."""
    u, v = np.meshgrid(*(np.linspace(-0.5, 0.5, n) for n in nodes), indexing="ij")
    return np.stack([u, v, 0 * u + 0.12 - 2.4 * time], axis=-1), np.stack([0 * u, 0 * u, 0 * u - 2.4], axis=-1)


def standing_strand(time: float, nodes: tuple[int, int]) -> Sample:
    x = np.zeros((*nodes, 3))
    x[..., 2] = np.linspace(-0.3, 0.061, nodes[0])[:, None]
    x[..., 0] = 0.013
    x[..., 1] = 0.0217
    return x, 0 * x


def test_a_strand_that_pierces_a_sheet_is_counted_from_then_on(tmp_path: Path, recorded: Callable[..., Path]) -> None:
    path = recorded(
        tmp_path / "out.usda",
        [(SurfaceMesh("sheet", (5, 7)), falling_sheet), (CurveSet("rod", (6, 1), radius=0.01), standing_strand)],
    )
    report = count_crossings(path)
    # Heights 0.12, 0.08, 0.04, 0 and below: the tip at 0.061 is through from the third frame on.
    assert [frame.crossings for frame in report.frames] == [0, 0, 1, 1, 1, 1]
    assert report.frames[2].between == {("rod", "sheet"): 1}
    assert (report.largest, report.at_end) == (1, 1)
    assert report.frames[1].distance == pytest.approx(0.08 - 0.061, rel=1e-5)


def test_skins_count_and_tetrahedra_do_not(tmp_path: Path, recorded: Callable[..., Path]) -> None:
    def block(time: float, nodes: tuple[int, int, int]) -> Sample:
        points, velocities = shearing_block(0.1, nodes)
        return points - [0.0, 0.0, 0.31], 0 * velocities

    path = recorded(
        tmp_path / "out.usdc", [(SolidBlock("block", (4, 3, 3)), block), (SurfaceMesh("sheet", (9, 9)), falling_sheet)]
    )
    report = count_crossings(path)
    counts = [frame.crossings for frame in report.frames]
    assert counts[:3] == [0, 0, 0]
    assert min(counts[4:]) > 0
    assert set(report.frames[-1].between) == {("block", "sheet"), ("sheet", "block")}


def test_obstacle_meshes_count_against_bodies_only(tmp_path: Path, recorded: Callable[..., Path]) -> None:
    a, b = np.eye(3) * 0.1, np.eye(3) * 0.1
    b[2] = [0.0, 0.0, 0.02]
    vertices = np.concatenate([a - 0.13, b - 0.13, [[0.02, 0.01, 0.05], [0.03, 0.012, 0.07], [0.021, 0.03, 0.06]]])
    crossed = Obstacle("mesh", name="flake", vertices=vertices, faces=np.arange(9).reshape(-1, 3), thickness=0.001)
    path = recorded(tmp_path / "out.usda", [(SurfaceMesh("sheet", (5, 5)), falling_sheet)], obstacles=[crossed])
    report = count_crossings(path)
    assert report.frames[0].crossings == 0
    assert set(report.frames[-1].between) == {("flake", "sheet"), ("sheet", "flake")}


def test_metres_and_poses_of_the_stage_count(tmp_path: Path, recorded: Callable[..., Path]) -> None:
    path = recorded(
        tmp_path / "out.usda",
        [(SurfaceMesh("sheet", (5, 7)), falling_sheet), (CurveSet("rod", (6, 1), radius=0.01), standing_strand)],
    )
    stage = Usd.Stage.Open(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.XformCommonAPI(stage.GetPrimAtPath("/World/rod")).SetTranslate((0.0, 0.0, 0.01))
    stage.GetRootLayer().Save()
    report = count_crossings(path)
    assert report.frames[1].distance == pytest.approx(0.01 * (0.08 - 0.071), rel=1e-4)


def test_a_file_in_which_nothing_deforms_is_refused(tmp_path: Path) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "still.usda"))
    UsdGeom.Sphere.Define(stage, "/ball")
    stage.GetRootLayer().Save()
    with pytest.raises(InputError, match="no mesh and no curve that deforms"):
        count_crossings(tmp_path / "still.usda")
