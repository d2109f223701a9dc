"""Solids in USD: the skin as a mesh that is seen, and all nodes as a mesh of tetrahedra beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from warpdeform.errors import Mistake
from warpdeform.usd.description import BodyDescription, BodySamples, Vectors, grid_mistakes
from warpdeform.usd.geometry import enclosed_volume, vertex_normals
from warpdeform.usd.topology import Ints, Side, block_sides, block_tetrahedra, quad_indices, texture_coordinates

if TYPE_CHECKING:
    from pxr import Sdf

    from warpdeform.usd.stage import StageUnits, StaticStage

CELLS_SUFFIX = "_tetrahedra"
"""The mesh of tetrahedra is called as the body and this."""


@dataclass(frozen=True, eq=False)
class SolidBlock(BodyDescription):
    """A block of nodes as it appears in a USD file: its skin as a Mesh, and a TetMesh with the purpose `guide`.

    The skin has the nodes at its sides alone, in their order. The sides are shaded smooth, each for itself, so that the
    edges of the block stay edges; each has the whole texture.

    Attributes:
        nodes: Nodes along u, v and w.
        periodic: Axes whose index wraps: there the block has no side. A ring has one such axis.
        turned: Whether (u, v, w) is left-handed; `outward` finds it out.
    """

    periodic: tuple[bool, bool, bool] = (False, False, False)
    turned: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "periodic", tuple(bool(p) for p in self.periodic))
        super().__post_init__()

    def mistakes(self) -> list[Mistake]:
        """What is wrong with the grid."""
        if self.periodic == (True, True, True):
            problem = "leaves the solid without a border, which cannot lie in space"
            return [Mistake("periodic", self.periodic, problem, "Let at least one axis end.")]
        return grid_mistakes("solid", self.nodes, self.periodic, 3)

    def outward(self, positions: NDArray[np.floating]) -> Self:
        """The block with its skin looking outwards at these positions, shape (nu, nv, nw, 3)."""
        corners = self.skin().reshape(-1)
        if enclosed_volume(positions.reshape(-1, 3), np.full(len(corners) // 4, 4), corners) >= 0.0:
            return self
        return replace(self, turned=not self.turned)

    def sides(self) -> list[Side]:
        """The sides that make the skin."""
        return block_sides(self.nodes, self.periodic, self.turned)

    def skin(self) -> NDArray[np.int64]:
        """Quads of the skin, side after side, by node numbers of the block: shape (quads, 4)."""
        return np.concatenate([side.nodes.reshape(-1)[_quads(side)] for side in self.sides()])

    def texture(self) -> tuple[NDArray[np.float32], Ints]:
        """Texture coordinates, shape (k, 2), and the number of that of each face corner of the skin."""
        values, corners, first = [], [], 0
        for side in self.sides():
            own, quads = texture_coordinates(side.nodes.shape, side.periodic)
            values.append(own)
            corners.append(quads.reshape(-1) + first)
            first += len(own)
        return np.concatenate(values), np.concatenate(corners).astype(np.int32)

    def define(self, static: StaticStage, units: StageUnits) -> BodySamples:
        """Define both meshes: topology, texture coordinates and material now, samples later."""
        return _SolidSamples(self, static)


class _SolidSamples:
    """Points, velocities and extents of the skin and of the tetrahedra, and the normals of the skin's face corners."""

    def __init__(self, block: SolidBlock, static: StaticStage) -> None:
        self._sides = [(side, _quads(side)) for side in block.sides()]
        skin = block.skin()
        self._nodes, corners = np.unique(skin, return_inverse=True)
        mesh = static.polygons(static.new_path(block.name), np.full(len(skin), 4), corners)
        mesh.CreateDoubleSidedAttr(False)
        static.texture(mesh, *block.texture())
        static.paint(mesh, block.name, block.color, block.roughness)
        self._skin = static.animate(mesh)
        self._normals = static.animate_normals(mesh, "faceVarying")

        tetrahedra = block_tetrahedra(block.nodes, block.periodic, block.turned)
        surface = skin[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)  # along the diagonals of the tetrahedra's faces
        path = static.new_path(block.name + CELLS_SUFFIX)
        self._cells = static.animate(static.tetrahedra(path, tetrahedra, surface, block.color))

    def sample(self, points: Vectors, velocities: Vectors) -> Mapping[Sdf.Path, Vectors]:
        points, velocities = points.reshape(-1, 3), velocities.reshape(-1, 3)
        normals = [
            vertex_normals(points[side.nodes], side.periodic).reshape(-1, 3)[quads.reshape(-1)]
            for side, quads in self._sides
        ]
        return {
            **self._skin.sample(points[self._nodes], velocities[self._nodes]),
            self._normals: np.concatenate(normals),
            **self._cells.sample(points, velocities),
        }


def _quads(side: Side) -> Ints:
    return quad_indices(side.nodes.shape, side.periodic)
