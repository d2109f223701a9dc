"""Checks of polygon meshes: faces, normals, and the side that a closed mesh shows."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from warpdeform.usd.check_points import Findings, PointsCheck
from warpdeform.usd.geometry import face_areas, next_corners


class MeshCheck(PointsCheck):
    """The checks of one mesh."""

    def __init__(self, mesh: UsdGeom.Mesh, codes: list[float], findings: Findings) -> None:
        super().__init__(mesh, codes, findings)
        self.counts = np.array(mesh.GetFaceVertexCountsAttr().Get() or [], dtype=np.int64)
        self.indices = np.array(mesh.GetFaceVertexIndicesAttr().Get() or [], dtype=np.int64)
        self.reversed = mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded

    def constant(self) -> list[Usd.Attribute]:
        return [self.prim.GetFaceVertexCountsAttr(), self.prim.GetFaceVertexIndicesAttr()]

    def topology(self) -> bool:
        sound = len(self.counts) > 0 and self.counts.min() >= 3 and self.counts.sum() == len(self.indices)
        sound = sound and self.indices.min() >= 0 and self.indices.max() < self.size
        return self.expect(sound, "the faces do not fit the points")

    def sample(self, points: NDArray[np.float64], time: Usd.TimeCode, where: str) -> None:
        areas, centres = face_areas(points, self.counts, self.indices)
        if self.reversed:
            areas = -areas
        if self._closed:
            volume = float(np.sum(areas * (centres - points.mean(axis=0)))) / 3.0
            self.expect(volume > 0.0, "the mesh is closed, but its faces look inwards", where)
        if self.prim.GetNormalsAttr().HasAuthoredValue():
            self._normals(len(points), areas, time, where)

    def _normals(self, points: int, areas: NDArray[np.float64], time: Usd.TimeCode, where: str) -> None:
        """Check normals against the winding."""
        normals = self.vectors(self.prim.GetNormalsAttr(), time, where)
        if normals is None:
            return
        if self.prim.GetNormalsInterpolation() in (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying):
            if not self.expect(len(normals) == points, "there are not as many normals as points", where):
                return
            at_corners = normals[self.indices]
        else:
            at_corners = normals
            complete = len(normals) == len(self.indices)
            if not self.expect(complete, "there are not as many normals as face corners", where):
                return
        unit = np.abs(np.linalg.norm(normals, axis=1) - 1.0) < 1e-3
        self.expect(unit.all(), "normals do not have length 1", where)
        against = np.einsum("ij,ij->i", at_corners, np.repeat(areas, self.counts, axis=0)) < 0.0
        self.expect(against.mean() < 0.1, "normals lie on the other side than the winding", where)

    @cached_property
    def _closed(self) -> bool:
        """Whether every edge belongs to exactly two faces."""
        edges = np.sort(np.stack([self.indices, self.indices[next_corners(self.counts)]], axis=1), axis=1)
        return bool((np.unique(edges, axis=0, return_counts=True)[1] == 2).all())
