"""Curves as USD BasisCurves: ropes, hair, fringes; many strands of one body are one prim."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpdeform.errors import Mistake
from warpdeform.usd.description import BodyDescription, BodySamples, Vectors

if TYPE_CHECKING:
    from pxr import Sdf, UsdGeom

    from warpdeform.usd.stage import StageUnits, StaticStage


@dataclass(frozen=True, eq=False)
class CurveSet(BodyDescription):
    """Strands as they appear in a USD file: linear BasisCurves with round sections, one strand after the other.

    Node i of strand s, at [i, s] of the samples, is the point s * n + i. Blender reads the curves and their widths, but
    no material on them: it must be given there.

    Attributes:
        nodes: Nodes of a strand, and strands.
        radius: Radius of the section, m: a number, or an array that broadcasts to `nodes`: (n, 1) along the strands,
            (strands,) by strand.
        closed: Whether the last node of each strand is joined to its first.
    """

    radius: ArrayLike
    closed: bool = False

    def mistakes(self) -> list[Mistake]:
        """What is wrong with the nodes or the radius."""
        least = 3 if self.closed else 2
        if len(self.nodes) != 2 or self.nodes[0] < least or self.nodes[1] < 1:
            problem = "a curve needs at least 2 nodes along each strand, 3 of a closed one, and 1 strand"
            return [Mistake("nodes", self.nodes, problem, f"Use {[least, 1]} or more.")]
        try:
            radii = np.broadcast_to(np.asarray(self.radius, dtype=np.float64), self.nodes)
        except (TypeError, ValueError):
            problem = f"is neither a number nor an array for {self.nodes[0]} nodes of {self.nodes[1]} strands"
            remedy = f"Use one radius, or radii of shape {[self.nodes[0], 1]}, {[self.nodes[1]]} or {[*self.nodes]}."
            return [Mistake("radius", self.radius, problem, remedy)]
        bad = ~((radii > 0.0) & (radii < np.inf))
        if bad.any():
            return [Mistake("radius", radii[bad][0], "is not a radius", "Use metres above 0, for example 0.001.")]
        return []

    def widths(self) -> NDArray[np.float64]:
        """Diameters, m: one where all are the same, else one for each point, strand after strand."""
        radii = np.broadcast_to(np.asarray(self.radius, dtype=np.float64), self.nodes).T.reshape(-1)
        return 2.0 * (radii[:1] if (radii == radii[0]).all() else radii)

    def define(self, static: StaticStage, units: StageUnits) -> BodySamples:
        """Define the curves: counts, widths and material now, samples later."""
        count, strands = self.nodes
        widths = self.widths() * units.per_meter
        curves = static.lines(static.new_path(self.name), np.full(strands, count), widths, self.closed)
        static.paint(curves, self.name, self.color, self.roughness)
        return _CurveSamples(static, curves, float(widths.max()))


class _CurveSamples:
    """Points, velocities and extent of strands."""

    def __init__(self, static: StaticStage, curves: UsdGeom.BasisCurves, width: float) -> None:
        self._moving, self._width = static.animate(curves), width

    def sample(self, points: Vectors, velocities: Vectors) -> Mapping[Sdf.Path, Vectors]:
        moved, speeds = (np.ascontiguousarray(nodes.swapaxes(0, 1)).reshape(-1, 3) for nodes in (points, velocities))
        return self._moving.sample(moved, speeds, margin=0.5 * self._width)
