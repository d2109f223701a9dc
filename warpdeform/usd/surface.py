"""Surfaces as USD meshes: sheets, tubes, tori, and balls of latitudes and longitudes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from warpdeform.errors import Mistake
from warpdeform.topology import Ints, cap_faces, cell_counts, flattened, quad_indices, texture_coordinates
from warpdeform.usd.description import BodyDescription, BodySamples, Vectors, grid_mistakes
from warpdeform.usd.geometry import enclosed_volume, vertex_normals

if TYPE_CHECKING:
    from pxr import Sdf, UsdGeom

    from warpdeform.usd.stage import StageUnits, StaticStage


@dataclass(frozen=True, eq=False)
class SurfaceMesh(BodyDescription):
    """A surface as it appears in a USD file: node (i, j) of the grid is the point i * nv + j of a Mesh.

    Where it has a border it is drawn from both sides.

    Attributes:
        periodic: Axes whose index wraps.
        thickness: Thickness of the surface, m; 0 = unknown.
        caps: Whether faces close the ring of nodes at the start and at the end of the open axis: poles of a ball, ends
            of a can. They have the texture's border rows, drawn together, and belong to no cell of the grid.
        turned: Whether the faces look to the side that r_u x r_v points away from; `outward` finds it out.
    """

    periodic: tuple[bool, bool] = (False, False)
    thickness: float = 0.0
    caps: tuple[bool, bool] = (False, False)
    turned: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "periodic", tuple(bool(p) for p in self.periodic))
        object.__setattr__(self, "caps", tuple(bool(c) for c in self.caps))
        super().__post_init__()

    def mistakes(self) -> list[Mistake]:
        """What is wrong with the grid, the thickness or the caps."""
        mistakes = grid_mistakes("surface", self.nodes, self.periodic, 2)
        if not 0.0 <= self.thickness < np.inf:
            mistakes.append(Mistake("thickness", self.thickness, "is not a length", "Use metres, 0 when unknown."))
        if len(self.caps) != 2 or (any(self.caps) and sum(self.periodic) != 1):
            problem = "close the rings at the ends of an axis, around which the other one must be periodic"
            mistakes.append(Mistake("caps", self.caps, problem, "Use [false, false] for other surfaces."))
        return mistakes

    @property
    def closed(self) -> bool:
        """Whether the surface has no border."""
        return all(self.periodic) or all(self.caps)

    def outward(self, positions: NDArray[np.floating]) -> Self:
        """The surface with its faces looking out of what it encloses at these positions, shape (nu, nv, 3)."""
        if not self.closed or enclosed_volume(positions.reshape(-1, 3), *flattened(self.faces())) >= 0.0:
            return self
        return replace(self, turned=not self.turned)

    def faces(self) -> list[Ints]:
        """Corners of the faces in groups of as many corners, each (k, corners): quads of the grid, then the caps."""
        return self._facing([quad_indices(self.nodes, self.periodic), *self._caps(self.nodes)])

    def texture(self) -> tuple[NDArray[np.float32], Ints]:
        """Texture coordinates, shape (k, 2), and the number of that of each face corner."""
        values, corners = texture_coordinates(self.nodes, self.periodic)
        cu, cv = cell_counts(self.nodes, self.periodic)
        return values, flattened(self._facing([corners, *self._caps((cu + 1, cv + 1))]))[1]

    def define(self, static: StaticStage, units: StageUnits) -> BodySamples:
        """Define the mesh: topology, texture coordinates and material now, samples later."""
        mesh = static.polygons(static.new_path(self.name), *flattened(self.faces()))
        mesh.CreateDoubleSidedAttr(not self.closed)
        static.texture(mesh, *self.texture())
        static.paint(mesh, self.name, self.color, self.roughness)
        if self.thickness:
            static.note(mesh, "thickness", self.thickness * units.per_meter)
        return _SurfaceSamples(self, static, mesh)

    def _caps(self, values: tuple[int, ...]) -> list[Ints]:
        """Faces of the caps, of a grid of so many values along u and v."""
        if not any(self.caps):
            return []
        around, numbers = self.periodic.index(True), np.arange(np.prod(values), dtype=np.int32).reshape(values)
        faces = []
        for end, capped in zip((0, -1), self.caps, strict=True):
            ring = numbers[:, end] if around == 0 else numbers[end]
            for corners in cap_faces(self.nodes[around]) if capped else []:
                # A cap runs against the cells beside it: along v at the start of u, against u at the start of v.
                faces.append(ring[corners] if (around == 1) == (end == 0) else ring[corners[:, ::-1]])
        return faces

    def _facing(self, faces: list[Ints]) -> list[Ints]:
        return [corners[:, ::-1] for corners in faces] if self.turned else faces


class _SurfaceSamples:
    """Points, velocities, extent and vertex normals of a surface."""

    def __init__(self, surface: SurfaceMesh, static: StaticStage, mesh: UsdGeom.Mesh) -> None:
        self._surface = surface
        self._moving = static.animate(mesh)
        self._normals = static.animate_normals(mesh, "vertex")

    def sample(self, points: Vectors, velocities: Vectors) -> Mapping[Sdf.Path, Vectors]:
        normals = vertex_normals(points, self._surface.periodic, self._surface.caps)
        if self._surface.turned:
            np.negative(normals, out=normals)
        moving = self._moving.sample(points.reshape(-1, 3), velocities.reshape(-1, 3))
        return {**moving, self._normals: normals.reshape(-1, 3)}
