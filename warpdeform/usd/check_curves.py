"""Checks of curves: vertex counts and widths."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from warpdeform.usd.check_points import PointsCheck


class CurvesCheck(PointsCheck):
    """The checks of one prim of curves."""

    def constant(self) -> list[Usd.Attribute]:
        return [self.prim.GetCurveVertexCountsAttr()]

    def topology(self) -> bool:
        counts = np.array(self.prim.GetCurveVertexCountsAttr().Get() or [], dtype=np.int64)
        least = 3 if self.prim.GetWrapAttr().Get() == UsdGeom.Tokens.periodic else 2
        sound = len(counts) > 0 and counts.min() >= least and counts.sum() == self.size
        return self.expect(sound, "the curves do not fit the points")

    def margin(self, time: Usd.TimeCode) -> float:
        widths = self._widths(time)
        return 0.5 * float(widths.max(initial=0.0, where=np.isfinite(widths)))

    def sample(self, points: NDArray[np.float64], time: Usd.TimeCode, where: str) -> None:
        if not self.prim.GetWidthsAttr().HasAuthoredValue():
            return
        curves = self.prim
        widths = self._widths(time)
        interpolation = curves.GetWidthsInterpolation()
        sizes = {
            UsdGeom.Tokens.uniform: curves.ComputeUniformDataSize,
            UsdGeom.Tokens.varying: curves.ComputeVaryingDataSize,
            UsdGeom.Tokens.vertex: curves.ComputeVertexDataSize,
        }
        right = sizes[interpolation](time) if interpolation in sizes else 1
        detail = ", ".join(filter(None, (f"{len(widths)} and not {right}", where)))
        if self.expect(len(widths) == right, f"there are not as many widths as are {interpolation}", detail):
            good = np.isfinite(widths).all() and (widths > 0.0).all()
            self.expect(good, "widths are not finite and above 0", where)

    def _widths(self, time: Usd.TimeCode) -> NDArray[np.float64]:
        return np.array(self.prim.GetWidthsAttr().Get(time) or [], dtype=np.float64)
