"""Read what a USD file shows at one time code: meshes, curves and native solids in the world, Z up, in metres."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpdeform.errors import InputError, Mistake
from warpdeform.study.picture.drawing import Drawing, Floats, Item
from warpdeform.study.picture.gprims import read_item

if TYPE_CHECKING:
    from pxr import Usd


class StageReader:
    """A USD file, opened once, of which any frame can be drawn.

    Args:
        path: A .usd, .usda, .usdc or .usdz file.

    Raises:
        InputError: No such file, or no USD in it.
    """

    def __init__(self, path: str | Path) -> None:
        from warpdeform.usd.opening import open_stage

        self.path = str(path)
        self.stage: Usd.Stage = open_stage(path, "result")

    def time_codes(self) -> tuple[float, float] | None:
        """First and last time code; None where nothing is sampled over time."""
        stage = self.stage
        return (stage.GetStartTimeCode(), stage.GetEndTimeCode()) if stage.HasAuthoredTimeCodeRange() else None

    def draw(self, frame: float | None = None) -> Drawing:
        """Read one frame.

        Args:
            frame: Time code, whole or between two samples; None for the last.

        Raises:
            InputError: A frame outside the file, nothing in it to draw, or points that are not finite.
        """
        from pxr import Usd, UsdGeom

        time_code = self._time_code(frame)
        cache = UsdGeom.XformCache(time_code)
        to_world = _to_z_up_metres(self.stage)
        prims = [prim for prim in self.stage.Traverse(Usd.PrimDefaultPredicate) if _is_drawn(prim, time_code)]
        of_points = [prim for prim in prims if prim.IsA(UsdGeom.PointBased)]
        bodies = [prim for prim in of_points if _has_samples(UsdGeom.PointBased(prim))] or of_points
        items: list[Item] = []
        ground: float | None = None
        for prim in prims:
            matrix = np.array(cache.GetLocalToWorldTransform(prim)) @ to_world
            if prim.IsA(UsdGeom.Plane):
                height = _ground_height(UsdGeom.Plane(prim), matrix, time_code)
                if height is not None:
                    ground = height if ground is None else max(ground, height)
                    continue
            role = bodies.index(prim) if prim in bodies else None
            item = read_item(prim, matrix, time_code, role)
            if item is not None:
                if not np.isfinite(item.points).all():
                    raise self._refused(
                        item.name, None, f"has points that are not finite at frame {time_code.GetValue():g}",
                        "Draw an earlier frame, or find out why the simulation failed.",
                    )  # fmt: skip
                items.append(item)
        if not items:
            raise InputError(
                Mistake("result", self.path, "holds nothing to draw", "It needs a visible mesh, curve or solid.")
            )
        return Drawing(tuple(items), ground, time_code.GetValue())

    def _time_code(self, frame: float | None) -> Usd.TimeCode:
        from pxr import Usd

        span = self.time_codes()
        if span is None:
            return Usd.TimeCode.Default() if frame is None else Usd.TimeCode(frame)
        if frame is None:
            return Usd.TimeCode(span[1])
        if not span[0] <= frame <= span[1]:
            raise self._refused(
                "frame", frame, "is not in the file", f"Use {span[0]:g} (the first) to {span[1]:g} (the last)."
            )
        return Usd.TimeCode(frame)

    def _refused(self, key: str, value: object, problem: str, remedy: str) -> InputError:
        return InputError(Mistake(key, value, problem, remedy, self.path))


def _is_drawn(prim: Usd.Prim, time_code: Usd.TimeCode) -> bool:
    from pxr import UsdGeom

    if not prim.IsA(UsdGeom.Gprim):
        return False
    seen = UsdGeom.Imageable(prim)
    return bool(
        seen.ComputeVisibility(time_code) != UsdGeom.Tokens.invisible
        and seen.ComputePurpose() in (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
    )


def _has_samples(prim: Any) -> bool:
    return bool(prim.GetPointsAttr().GetNumTimeSamples())


def _to_z_up_metres(stage: Usd.Stage) -> Floats:
    """Matrix (4, 4), for row vectors, from the stage's axes and units to Z up and metres."""
    from pxr import UsdGeom

    scale = UsdGeom.GetStageMetersPerUnit(stage)
    matrix = np.diag([scale, scale, scale, 1.0])
    if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y:
        matrix = matrix @ np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
    return matrix


def _ground_height(plane: Any, matrix: Floats, time_code: Usd.TimeCode) -> float | None:
    """Height of a plane that faces up, else None (then it is drawn as the rectangle that it is)."""
    normal = np.roll([0.0, 0.0, 1.0], {"X": 1, "Y": 2, "Z": 0}[plane.GetAxisAttr().Get(time_code)]) @ matrix[:3, :3]
    return float(matrix[3, 2]) if normal[2] > 0.9995 * np.linalg.norm(normal) else None
