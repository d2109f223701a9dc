"""Curves in USD: strand after strand, with their widths."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from motions import turning_loops, waving_strands
from pxr import Usd, UsdGeom, UsdShade

from warpdeform.errors import InputError
from warpdeform.usd.check import check_stage, schema_errors
from warpdeform.usd.curves import CurveSet

FPS = 60.0


def test_strands_are_linear_curves_one_after_the_other(tmp_path: Path, recorded: Callable[..., Path]) -> None:
    path = recorded(tmp_path / "hair.usdc", [(CurveSet("hair", (9, 4), 0.01, roughness=0.4), waving_strands)])
    assert check_stage(path, tolerance=0.01) == schema_errors(path) == []
    stage = Usd.Stage.Open(str(path))
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/hair"))
    assert curves.GetTypeAttr().Get() == "linear"
    assert curves.GetWrapAttr().Get() == "nonperiodic"
    assert list(curves.GetCurveVertexCountsAttr().Get()) == [9] * 4
    np.testing.assert_allclose(curves.GetWidthsAttr().Get(), [0.02])
    assert curves.GetWidthsInterpolation() == "constant"
    for code in (1, 6):
        positions, velocities = waving_strands((code - 1) / FPS)
        for attribute, expected in ((curves.GetPointsAttr(), positions), (curves.GetVelocitiesAttr(), velocities)):
            strands = np.array(attribute.Get(code)).reshape(4, 9, 3)
            for strand in range(4):
                np.testing.assert_allclose(strands[strand], expected[:, strand], atol=1e-6)
    material, _ = UsdShade.MaterialBindingAPI(curves).ComputeBoundMaterial()
    assert material.ComputeSurfaceSource()[0].GetInput("roughness").Get() == pytest.approx(0.4)


@pytest.mark.parametrize("radius", [0.01, np.linspace(0.02, 0.01, 9)[:, None]])
def test_extents_are_those_that_usd_computes(tmp_path: Path, recorded: Callable[..., Path], radius: object) -> None:
    path = recorded(tmp_path / "hair.usda", [(CurveSet("hair", (9, 4), radius), waving_strands)])  # type: ignore[arg-type]
    stage = Usd.Stage.Open(str(path))
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/hair"))
    for code in (1, 6):
        expected = UsdGeom.Boundable.ComputeExtentFromPlugins(curves, code)
        np.testing.assert_allclose(curves.GetExtentAttr().Get(code), expected, atol=1e-7)


def test_closed_strands_are_periodic(tmp_path: Path, recorded: Callable[..., Path]) -> None:
    path = recorded(tmp_path / "loops.usda", [(CurveSet("loops", (12, 2), 0.01, closed=True), turning_loops)])
    assert check_stage(path, tolerance=0.01) == schema_errors(path) == []
    stage = Usd.Stage.Open(str(path))
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/loops"))
    assert curves.GetWrapAttr().Get() == "periodic"
    assert list(curves.GetCurveVertexCountsAttr().Get()) == [12, 12]


@pytest.mark.parametrize(
    ("radius", "expected"),
    [
        (np.array([[0.1], [0.2], [0.3]]), [0.2, 0.4, 0.6, 0.2, 0.4, 0.6]),
        ([0.1, 0.2], [0.2, 0.2, 0.2, 0.4, 0.4, 0.4]),
        (np.full((3, 2), 0.1), [0.2]),
    ],
    ids=["tapered", "by strand", "all the same"],
)
def test_widths_are_diameters_in_the_order_of_the_points(
    tmp_path: Path, recorded: Callable[..., Path], radius: object, expected: list[float]
) -> None:
    curves = CurveSet("hair", (3, 2), radius)  # type: ignore[arg-type]
    np.testing.assert_allclose(curves.widths(), expected)
    path = recorded(tmp_path / "hair.usda", [(curves, waving_strands)], meters_per_unit=0.01)
    assert check_stage(path) == []
    stage = Usd.Stage.Open(str(path))
    written = UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/hair"))
    np.testing.assert_allclose(written.GetWidthsAttr().Get(), 100 * np.array(expected), rtol=1e-6)
    assert written.GetWidthsInterpolation() == ("constant" if len(expected) == 1 else "vertex")


@pytest.mark.parametrize(
    ("arguments", "key", "words"),
    [
        ({"nodes": (1, 4)}, "nodes", "at least 2 nodes along each strand"),
        ({"nodes": (2, 4), "closed": True}, "nodes", "3 of a closed one"),
        ({"nodes": (4, 0)}, "nodes", "1 strand"),
        ({"nodes": (4,)}, "nodes", "Use"),
        ({"radius": 0.0}, "radius", "is not a radius"),
        ({"radius": float("nan")}, "radius", "is not a radius"),
        ({"radius": [0.1, 0.2, 0.3]}, "radius", r"shape \[4, 1\], \[2\] or \[4, 2\]"),
        ({"radius": "thick"}, "radius", "neither a number nor an array"),
        ({"roughness": -1.0}, "roughness", "outside 0 to 1"),
    ],
)
def test_refused_descriptions(arguments: dict, key: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        CurveSet("a", **({"nodes": (4, 2), "radius": 0.1} | arguments))
    assert [mistake.key for mistake in caught.value.mistakes] == [key]
