"""Read one prim of a stage as triangles: meshes, tubes around curves, and native solids."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from warpdeform.study.picture import shapes
from warpdeform.study.picture.drawing import Floats, Ints, Item
from warpdeform.study.picture.tubes import tubes

if TYPE_CHECKING:
    from pxr import Usd

CLOTH_COLORS = ((0.45, 0.07, 0.06), (0.05, 0.17, 0.38), (0.62, 0.36, 0.07), (0.09, 0.27, 0.20))
"""Linear RGB of bodies that bring no displayColor, in turn."""
OBSTACLE_COLOR = (0.42, 0.41, 0.39)
UNKNOWN_WIDTH = 0.005
"""Width of curves that bring none, as a share of the diagonal of their box."""
MOST_TUBE_CORNERS = 200_000
"""Tubes have fewer sides, down to 5, where they would have more corners than this."""


def read_item(prim: Usd.Prim, matrix: Floats, time_code: Usd.TimeCode, body: int | None) -> Item | None:
    """The triangles of one prim in the world; None for a kind that is not drawn.

    Args:
        prim: A Gprim.
        matrix: Local to world, for row vectors, shape (4, 4).
        time_code: When.
        body: Its number among the bodies; None for an obstacle.
    """
    from pxr import UsdGeom

    thin = False
    if prim.IsA(UsdGeom.Mesh):
        surface, colors = _read_mesh(UsdGeom.Mesh(prim), time_code)
        thin = body is not None and _is_thin(UsdGeom.Mesh(prim))
    elif prim.IsA(UsdGeom.BasisCurves):
        surface, colors = _read_curves(UsdGeom.BasisCurves(prim), time_code)
    else:
        surface, colors = _read_solid(prim, time_code), _display_color(prim, time_code)
    if surface is None:
        return None
    points, triangles, normals = surface
    points = points @ matrix[:3, :3] + matrix[3, :3]
    if normals is not None:
        normals = normals @ np.linalg.inv(matrix[:3, :3]).T
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    if np.linalg.det(matrix[:3, :3]) < 0.0:
        triangles = triangles[:, ::-1]
    look = _preview_surface(prim)
    if colors is None:
        fallback = OBSTACLE_COLOR if body is None else CLOTH_COLORS[body % len(CLOTH_COLORS)]
        colors = np.array([look.get("diffuseColor", fallback)], dtype=np.float64)
    return Item(
        name=str(prim.GetPath()),
        role="obstacle" if body is None else "body",
        thin=thin,
        points=points,
        triangles=triangles,
        normals=normals,
        colors=np.clip(np.broadcast_to(colors, points.shape), 0.0, 1.0),
        roughness=float(look.get("roughness", 0.6 if body is None else 0.8)),
        metallic=float(look.get("metallic", 0.0)),
    )


def _read_solid(prim: Usd.Prim, time_code: Usd.TimeCode) -> tuple[Floats, Ints, Floats | None] | None:
    """Triangles of a native solid in its own frame; None for a kind that is not drawn."""

    def value(name: str) -> Any:
        return prim.GetAttribute(name).Get(time_code)

    kind = prim.GetTypeName()
    if kind == "Sphere":
        return shapes.sphere(value("radius"))
    if kind == "Cube":
        return shapes.cube(value("size"))
    if kind == "Cylinder":
        return shapes.along(shapes.cylinder(value("radius"), value("height")), value("axis"))
    if kind == "Capsule":
        return shapes.along(shapes.capsule(value("radius"), value("height")), value("axis"))
    if kind == "Cone":
        return shapes.along(shapes.cone(value("radius"), value("height")), value("axis"))
    if kind == "Plane":
        return shapes.along(shapes.plane(value("width"), value("length")), value("axis"))
    return None


def _read_mesh(mesh: Any, time_code: Usd.TimeCode) -> tuple[tuple[Floats, Ints, Floats | None] | None, Floats | None]:
    """Triangles and colours of a mesh; its vertices are split where a value differs from face to face."""
    from pxr import UsdGeom

    points = np.array(mesh.GetPointsAttr().Get(time_code) or np.zeros((0, 3)), dtype=np.float64)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get(time_code) or [], dtype=np.int64)
    indices = np.array(mesh.GetFaceVertexIndicesAttr().Get(time_code) or [], dtype=np.int64)
    if len(points) == 0 or len(counts) == 0:
        return None, None
    corners = _fan(counts)
    if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
        corners = corners[:, ::-1]
    normals, normals_at = _mesh_normals(mesh, time_code)
    colors, colors_at = _primvar(mesh.GetPrim(), "displayColor", time_code)
    layout = (len(points), counts, indices)
    if "faceVarying" in (normals_at, colors_at) or "uniform" in (normals_at, colors_at):
        normals, colors = _at_corners(normals, normals_at, layout), _at_corners(colors, colors_at, layout)
        return (points[indices], corners, normals), colors
    return (points, indices[corners], normals if normals_at in ("vertex", "varying") else None), colors


def _is_thin(mesh: Any) -> bool:
    """Whether a mesh is a sheet: it is seen from both sides, or does not say."""
    double_sided = mesh.GetDoubleSidedAttr()
    return not double_sided.HasAuthoredValue() or bool(double_sided.Get())


def _read_curves(
    curves: Any, time_code: Usd.TimeCode
) -> tuple[tuple[Floats, Ints, Floats | None] | None, Floats | None]:
    """Tubes around curves, and the colours of their vertices; cubic ones are drawn as their control polygons."""
    from pxr import UsdGeom

    points = np.array(curves.GetPointsAttr().Get(time_code) or np.zeros((0, 3)), dtype=np.float64)
    counts = np.array(curves.GetCurveVertexCountsAttr().Get(time_code) or [], dtype=np.int64)
    if len(points) == 0 or len(counts) == 0:
        return None, None
    widths = np.array(curves.GetWidthsAttr().Get(time_code) or [], dtype=np.float64)
    if len(widths) == 0:
        widths = np.array([UNKNOWN_WIDTH * float(np.linalg.norm(np.ptp(points, axis=0)))])
    radii = 0.5 * _along_curves(widths, curves.GetWidthsInterpolation(), counts)
    colors, where = _primvar(curves.GetPrim(), "displayColor", time_code)
    colors = None if colors is None else _along_curves(colors, where, counts)
    closed = curves.GetWrapAttr().Get(time_code) == UsdGeom.Tokens.periodic
    sides = int(np.clip(MOST_TUBE_CORNERS // len(points), 5, 24))
    starts = np.cumsum(counts) - counts
    parts, first = [], 0
    for count in np.unique(counts[counts > 1]):  # all curves of as many points at once
        nodes = starts[counts == count][:, None] + np.arange(count)
        vertices, triangles, normals, owners = tubes(points[nodes], radii[nodes], sides, closed=closed and count > 2)
        parts.append((vertices, triangles + first, normals, nodes.reshape(-1)[owners]))
        first += len(vertices)
    if not parts:
        return None, None
    vertices, triangles, normals, owners = (np.concatenate(part) for part in zip(*parts, strict=True))
    return (vertices, triangles, normals), None if colors is None else colors[owners]


def _along_curves(values: Floats, where: str, counts: Ints) -> Floats:
    """Values at the points of curves, from wherever they live."""
    if where == "constant":
        return np.repeat(values[:1], counts.sum(), axis=0)
    return np.repeat(values, counts, axis=0) if where == "uniform" else values


def _fan(counts: Ints) -> Ints:
    """Corner numbers of triangles that fan out from each face's first corner, shape (m, 3)."""
    start = np.cumsum(counts) - counts
    fans = [
        np.stack([start[counts >= size], start[counts >= size] + size - 2, start[counts >= size] + size - 1], axis=-1)
        for size in range(3, int(counts.max()) + 1)
    ]
    return np.concatenate(fans or [np.zeros((0, 3), dtype=np.int64)])


def _mesh_normals(mesh: Any, time_code: Usd.TimeCode) -> tuple[Floats | None, str]:
    """Normals and where they live; the primvar wins over the attribute, as USD has it."""
    values, where = _primvar(mesh.GetPrim(), "normals", time_code)
    if values is not None:
        return values, where
    authored = mesh.GetNormalsAttr().Get(time_code)
    if not authored:
        return None, "vertex"
    return np.array(authored, dtype=np.float64), str(mesh.GetNormalsInterpolation())


def _primvar(prim: Usd.Prim, name: str, time_code: Usd.TimeCode) -> tuple[Floats | None, str]:
    from pxr import UsdGeom

    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar(name)
    values = primvar.ComputeFlattened(time_code) if primvar and primvar.HasValue() else None
    if not values:
        return None, "constant"
    return np.array(values, dtype=np.float64), str(primvar.GetInterpolation())


def _at_corners(values: Floats | None, where: str, layout: tuple[int, Ints, Ints]) -> Floats | None:
    """Values at the corners of the faces, from wherever they live."""
    if values is None or where in ("faceVarying", "constant"):
        return values
    return np.repeat(values, layout[1], axis=0) if where == "uniform" else values[layout[2]]


def _display_color(prim: Usd.Prim, time_code: Usd.TimeCode) -> Floats | None:
    colors, _ = _primvar(prim, "displayColor", time_code)
    return None if colors is None else colors[:1]


def _preview_surface(prim: Usd.Prim) -> dict[str, Any]:
    """Plain values of the bound UsdPreviewSurface; empty where none is bound."""
    from pxr import UsdShade

    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    shader = material.ComputeSurfaceSource()[0] if material else None
    if not shader or shader.GetShaderId() != "UsdPreviewSurface":
        return {}
    found = {name: shader.GetInput(name) for name in ("diffuseColor", "roughness", "metallic")}
    return {name: entry.Get() for name, entry in found.items() if entry and entry.Get() is not None}
