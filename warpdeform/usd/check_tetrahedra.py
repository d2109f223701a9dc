"""Checks of meshes of tetrahedra: corners, surface, and volumes at every sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from warpdeform.usd.check_points import Findings, PointsCheck


class TetrahedraCheck(PointsCheck):
    """The checks of one mesh of tetrahedra."""

    def __init__(self, mesh: UsdGeom.TetMesh, codes: list[float], findings: Findings) -> None:
        super().__init__(mesh, codes, findings)
        self.corners = np.array(mesh.GetTetVertexIndicesAttr().Get() or [], dtype=np.int64).reshape(-1, 4)
        self.surface = np.array(mesh.GetSurfaceFaceVertexIndicesAttr().Get() or [], dtype=np.int64).reshape(-1, 3)
        self.reversed = mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded

    def constant(self) -> list[Usd.Attribute]:
        return [self.prim.GetTetVertexIndicesAttr(), self.prim.GetSurfaceFaceVertexIndicesAttr()]

    def topology(self) -> bool:
        sound = len(self.corners) > 0 and _within(self.corners, self.size)
        if not self.expect(sound, "the tetrahedra do not fit the points"):
            return False
        return self.expect(_within(self.surface, self.size), "the surface faces do not fit the points")

    def sample(self, points: NDArray[np.float64], time: Usd.TimeCode, where: str) -> None:
        first, *others = points[self.corners].swapaxes(0, 1)
        a, b, c = (other - first for other in others)
        volumes = np.einsum("ij,ij->i", a, np.cross(b, c)) * (-1.0 if self.reversed else 1.0)
        inverted = int((volumes <= 0.0).sum())
        detail = f"{inverted} of {len(volumes)}" + (f", {where}" if where else "")
        self.expect(not inverted, "tetrahedra are inverted", detail)


def _within(indices: NDArray[np.int64], size: int) -> bool:
    return not len(indices) or bool(indices.min() >= 0 and indices.max() < size)
