"""Obstacles as USD prims: native shapes where USD has them, meshes for the torus and for triangle meshes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom

from warpdeform.obstacle import Obstacle
from warpdeform.usd.geometry import creased_normals, extent, vertex_normals
from warpdeform.usd.stage import StageUnits, StaticStage, vector_array
from warpdeform.usd.topology import quad_indices

PLANE_WIDTH = 20.0
"""Width at which the infinite plane is drawn, m."""
_TORUS_NODES = (96, 32)
_NATIVE: dict[str, Any] = {
    "plane": UsdGeom.Plane,
    "sphere": UsdGeom.Sphere,
    "box": UsdGeom.Cube,
    "capsule": UsdGeom.Capsule,
    "cylinder": UsdGeom.Cylinder,
    "cone": UsdGeom.Cone,
}
"""USD's shapes; their conventions and the names of their lengths are those of the obstacles."""


class ObstacleSamples:
    """An obstacle's prim and, while it moves, the poses of every frame."""

    def __init__(self, static: StaticStage, obstacle: Obstacle, units: StageUnits) -> None:
        """Define the prim.

        Args:
            static: The stage to define it in.
            obstacle: The obstacle.
            units: Units of the stage.
        """
        path = static.new_path(obstacle.name)
        gprim = _define(static, path, obstacle, units.per_meter)
        static.paint(gprim, obstacle.name, obstacle.color, obstacle.roughness)
        self._track, self._per_meter = obstacle.track, units.per_meter
        self._rotation: NDArray[np.float64] | None = None
        translate, orient = gprim.AddTranslateOp().GetAttr(), gprim.AddOrientOp().GetAttr()
        if obstacle.kind == "box":
            lengths = np.asarray(obstacle.sizes["size"], dtype=np.float64) * units.per_meter
            gprim.AddScaleOp().Set(Gf.Vec3f(*lengths.tolist()))
        self._paths: tuple[Sdf.Path, Sdf.Path] | None = None
        if obstacle.track.static:
            for attribute, value in zip((translate, orient), self._pose(0.0), strict=True):
                attribute.Set(value)
        else:
            self._paths = (static.mark_sampled(translate), static.mark_sampled(orient))

    def sample(self, time: float) -> dict[Sdf.Path, object]:
        """The values of the sampled attributes at `time` [s]; none for an obstacle that never moves."""
        return dict(zip(self._paths, self._pose(time), strict=True)) if self._paths else {}

    def _pose(self, time: float) -> tuple[Gf.Vec3d, Gf.Quatf]:
        """The pose in the units of the file; of a rotation's two quaternions the one next to the last one."""
        position, rotation = self._track.pose(time)
        if self._rotation is not None and float(self._rotation @ rotation) < 0.0:
            rotation = -rotation
        self._rotation = rotation
        x, y, z, w = (float(value) for value in rotation)
        return Gf.Vec3d(*(float(p) * self._per_meter for p in position)), Gf.Quatf(w, Gf.Vec3f(x, y, z))


def _define(static: StaticStage, path: Sdf.Path, obstacle: Obstacle, scale: float) -> UsdGeom.Gprim:
    """Define the prim of an obstacle about its own origin; `scale` is the number of units per metre."""
    if obstacle.kind == "torus":
        return _torus(static, path, obstacle, scale)
    if obstacle.kind == "mesh":
        return _mesh(static, path, obstacle, scale)
    shape = _NATIVE[obstacle.kind].Define(static.stage, path)
    prim = shape.GetPrim()
    if obstacle.kind == "plane":
        lengths = {"width": PLANE_WIDTH * scale, "length": PLANE_WIDTH * scale}
    elif obstacle.kind == "box":
        lengths = {"size": 1.0}  # stretched by the scale of its pose
    else:
        lengths = {key: _size(obstacle, key) * scale for key in obstacle.sizes}
    for key, length in lengths.items():
        prim.GetAttribute(key).Set(length)
    if prim.HasAttribute("axis"):
        prim.GetAttribute("axis").Set(UsdGeom.Tokens.z)
    shape.CreateExtentAttr(UsdGeom.Boundable.ComputeExtentFromPlugins(shape, Usd.TimeCode.Default()))
    return shape


def _torus(static: StaticStage, path: Sdf.Path, obstacle: Obstacle, scale: float) -> UsdGeom.Gprim:
    periodic = (True, True)
    u, v = (np.linspace(0.0, 2.0 * np.pi, n, endpoint=False) for n in _TORUS_NODES)
    u, v = np.meshgrid(u, v, indexing="ij")
    tube = _size(obstacle, "tube_radius") * scale
    ring = _size(obstacle, "radius") * scale + tube * np.cos(v)
    points = np.stack([ring * np.cos(u), ring * np.sin(u), tube * np.sin(v)], axis=-1).astype(np.float32)
    quads = quad_indices(_TORUS_NODES, periodic)
    mesh = static.polygons(path, np.full(len(quads), 4, np.int32), quads)
    _shape_mesh(mesh, points, vertex_normals(points, periodic), UsdGeom.Tokens.vertex)
    return mesh


def _mesh(static: StaticStage, path: Sdf.Path, obstacle: Obstacle, scale: float) -> UsdGeom.Gprim:
    assert obstacle.vertices is not None
    assert obstacle.faces is not None
    points = (obstacle.vertices * scale).astype(np.float32)
    mesh = static.polygons(path, np.full(len(obstacle.faces), 3, np.int32), obstacle.faces)
    mesh.CreateDoubleSidedAttr(obstacle.thickness > 0.0)
    _shape_mesh(mesh, points, creased_normals(points, obstacle.faces), UsdGeom.Tokens.faceVarying)
    return mesh


def _shape_mesh(
    mesh: UsdGeom.Mesh, points: NDArray[np.float32], normals: NDArray[np.float32], interpolation: str
) -> None:
    mesh.CreatePointsAttr(vector_array(points))
    mesh.CreateNormalsAttr(vector_array(normals))
    mesh.SetNormalsInterpolation(interpolation)
    mesh.CreateExtentAttr(vector_array(extent(points)))


def _size(obstacle: Obstacle, key: str) -> float:
    return float(np.max(np.asarray(obstacle.sizes[key], dtype=np.float64)))
