"""Counts what crosses in a USD file, frame by frame: meshes and curves, each with itself and with the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from warpdeform.crossings import closest, crossing_pairs
from warpdeform.errors import InputError, Mistake
from warpdeform.simplices import Simplices
from warpdeform.usd.opening import open_stage

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FrameCrossings:
    """One frame.

    Attributes:
        frame: Its time code.
        crossings: Edges and triangles without a common vertex that cross or touch.
        between: The same by the names of the prims of the edge and of the triangle.
        distance: Smallest distance of points and triangles, edges and edges that are no neighbours [m]; infinite above
            the longest edge of the first frame.
    """

    frame: float
    crossings: int
    between: dict[tuple[str, str], int]
    distance: float


@dataclass
class CrossingReport:
    """All frames of a file."""

    frames: list[FrameCrossings] = field(default_factory=list)

    @property
    def largest(self) -> int:
        """Most crossings of any frame."""
        return max((frame.crossings for frame in self.frames), default=0)

    @property
    def at_end(self) -> int:
        """Crossings of the last frame."""
        return self.frames[-1].crossings if self.frames else 0

    @property
    def smallest_distance(self) -> float:
        """Smallest distance of any frame [m]."""
        return min((frame.distance for frame in self.frames), default=np.inf)


class _Prim:
    """A mesh or curves, in metres and in the world."""

    def __init__(self, gprim: UsdGeom.PointBased, simplices: Simplices, metres: float) -> None:
        self.name = gprim.GetPrim().GetName()
        self.simplices, self._metres = simplices, metres
        self._points, self._place = gprim.GetPointsAttr(), UsdGeom.Xformable(gprim)
        self.deforms = self._points.GetNumTimeSamples() > 1

    def points(self, time: Usd.TimeCode) -> Array:
        local = np.array(self._points.Get(time), dtype=np.float64).reshape(-1, 3)
        matrix = np.array(self._place.ComputeLocalToWorldTransform(time))
        return np.asarray((local @ matrix[:3, :3] + matrix[3, :3]) * self._metres)


def count_crossings(path: str | Path) -> CrossingReport:
    """Count crossings, and measure the smallest distance, in every frame of a file.

    Prims for guidance only (the tetrahedra of solids) are left out, and so is what a prim that does not deform does to
    itself. Polygons are cut into triangles from their first corner on, curves are the segments between their points.

    Raises:
        InputError: The file cannot be opened, has nothing that deforms, or points that are not finite.
    """
    return CrossingReport(list(_frames(path)))


def _frames(path: str | Path) -> Iterator[FrameCrossings]:
    stage = open_stage(path, "file")
    prims = list(_prims(stage))
    if not any(prim.deforms for prim in prims):
        remedy = "Give a file that a simulation has written, with samples of points."
        raise InputError(Mistake("file", str(path), "has no mesh and no curve that deforms", remedy))
    simplices = Simplices.joined([prim.simplices for prim in prims])
    owner = np.repeat(np.arange(len(prims)), [prim.simplices.vertices for prim in prims])
    rigid = np.array([not prim.deforms for prim in prims])
    limit = 0.0
    for code in np.arange(stage.GetStartTimeCode(), stage.GetEndTimeCode() + 0.5):
        points = np.concatenate([prim.points(Usd.TimeCode(code)) for prim in prims])
        if not np.isfinite(points).all():
            raise InputError(Mistake("file", str(path), f"has points that are not finite at {code:g}", "Check it."))
        limit = limit or float(np.linalg.norm(np.diff(points[simplices.edges], axis=1), axis=-1).max())
        pairs = crossing_pairs(points, simplices)
        whose = np.stack([owner[simplices.edges[pairs[:, 0], 0]], owner[simplices.triangles[pairs[:, 1], 0]]], axis=1)
        whose = whose[~rigid[whose].all(axis=1)]
        between = Counter((prims[a].name, prims[b].name) for a, b in whose)
        near = closest(points, simplices, limit)
        yield FrameCrossings(float(code), len(whose), dict(between), near.distance)


def _prims(stage: Usd.Stage) -> Iterator[_Prim]:
    metres = UsdGeom.GetStageMetersPerUnit(stage)
    for prim in stage.Traverse():
        gprim = UsdGeom.PointBased(prim)
        if not gprim or gprim.ComputePurpose() == UsdGeom.Tokens.guide:
            continue
        size = len(gprim.GetPointsAttr().Get(Usd.TimeCode.EarliestTime()) or [])
        if prim.IsA(UsdGeom.Mesh):
            mesh = UsdGeom.Mesh(prim)
            counts, indices = (
                np.array(attribute.Get() or [], dtype=np.int64)
                for attribute in (mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr())
            )
            yield _Prim(gprim, Simplices.of_polygons(size, counts, indices), metres)
        elif prim.IsA(UsdGeom.BasisCurves):
            curves = UsdGeom.BasisCurves(prim)
            closed = curves.GetWrapAttr().Get() == UsdGeom.Tokens.periodic
            yield _Prim(gprim, Simplices.of_strands(list(curves.GetCurveVertexCountsAttr().Get()), closed), metres)
