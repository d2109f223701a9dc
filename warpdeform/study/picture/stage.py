"""Read what a USD file shows at one time code: meshes and native solids in the world, Z up, in metres."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpdeform.errors import InputError, Mistake
from warpdeform.study.picture import shapes
from warpdeform.study.picture.drawing import Drawing, Floats, Ints, Item

if TYPE_CHECKING:
    from pxr import Usd

CLOTH_COLORS = ((0.45, 0.07, 0.06), (0.05, 0.17, 0.38), (0.62, 0.36, 0.07), (0.09, 0.27, 0.20))
"""Linear RGB of bodies that bring no displayColor, in turn."""
OBSTACLE_COLOR = (0.42, 0.41, 0.39)


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
        moving = [prim for prim in prims if prim.IsA(UsdGeom.Mesh) and _has_samples(UsdGeom.Mesh(prim))]
        bodies = moving or [prim for prim in prims if prim.IsA(UsdGeom.Mesh)]
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
            item = _read_item(prim, matrix, time_code, role)
            if item is not None:
                if not np.isfinite(item.points).all():
                    raise self._refused(
                        item.name, None, f"has points that are not finite at frame {time_code.GetValue():g}",
                        "Draw an earlier frame, or find out why the simulation failed.",
                    )  # fmt: skip
                items.append(item)
        if not items:
            raise InputError(
                Mistake("result", self.path, "holds nothing to draw", "It needs a visible mesh or solid with points.")
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


def _has_samples(mesh: Any) -> bool:
    return bool(mesh.GetPointsAttr().GetNumTimeSamples())


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


def _read_item(prim: Usd.Prim, matrix: Floats, time_code: Usd.TimeCode, body: int | None) -> Item | None:
    """The triangles of one prim in the world; None for a kind that is not drawn.

    Args:
        prim: A Gprim.
        matrix: Local to world, for row vectors, shape (4, 4).
        time_code: When.
        body: Its number among the bodies; None for an obstacle.
    """
    from pxr import UsdGeom

    if prim.IsA(UsdGeom.Mesh):
        surface, colors = _read_mesh(UsdGeom.Mesh(prim), time_code)
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
