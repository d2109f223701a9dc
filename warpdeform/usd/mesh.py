"""Meshes of obstacles, read from USD files."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from warpdeform.errors import InputError, Mistake
from warpdeform.usd.opening import open_stage


def warp_asset(name: str) -> Path:
    """Path of a mesh that Warp's wheel carries, such as "bunny", found without importing Warp.

    Raises:
        InputError: No mesh of that name; the remedy lists those there are.
    """
    spec = importlib.util.find_spec("warp")
    folder = Path(spec.origin or "").parent / "examples" / "assets" if spec else Path()
    path = folder / f"{name}.usd"
    if spec and path.is_file():
        return path
    known = ", ".join(sorted(found.stem for found in folder.glob("*.usd"))) if spec else "none, as Warp is missing"
    raise InputError(Mistake("asset", name, "is no mesh of Warp's examples", f"There are: {known}."))


def read_mesh(
    path: str | Path, prim: str | None = None, *, up_axis: str = "Z", key: str = "mesh"
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Read a polygon mesh as triangles, in metres, turned so that the stage's up axis is `up_axis`.

    The mesh is taken as its polygons are (subdivision is ignored), at the earliest time of its samples, with all
    transforms above it. Polygons become fans of triangles that start at their first corner.

    Args:
        path: A .usd, .usda, .usdc or .usdz file.
        prim: Path of the Mesh prim; `None` takes the only mesh of the stage.
        up_axis: The up axis of the result, "Y" or "Z".
        key: The key that mistakes are reported under.

    Returns:
        Vertices [m], shape (n, 3), and triangles, counter-clockwise from outside where the mesh is, shape (m, 3).

    Raises:
        InputError: Missing or unreadable file, no mesh or several, bad indices, numbers that are not finite.
    """

    def refuse(problem: str, remedy: str) -> InputError:
        return InputError(Mistake(key, str(path), problem, remedy))

    stage = open_stage(path, key)
    mesh = _find(stage, prim, refuse)
    where = f"the mesh {mesh.GetPath()}"
    time = Usd.TimeCode.EarliestTime()
    points = _array(mesh.GetPointsAttr().Get(time), np.float64).reshape(-1, 3)
    counts = _array(mesh.GetFaceVertexCountsAttr().Get(time), np.int64)
    indices = _array(mesh.GetFaceVertexIndicesAttr().Get(time), np.int64)
    if not len(points) or not len(counts):
        raise refuse(f"{where} has no points or no faces", "Choose a mesh that has both.")
    if (counts < 3).any() or counts.sum() != len(indices):
        raise refuse(f"{where} has face counts that do not fit its {len(indices)} indices", "Repair the mesh.")
    if indices.min() < 0 or indices.max() >= len(points):
        bad = int(indices[(indices < 0) | (indices >= len(points))][0])
        raise refuse(f"{where} refers to vertex {bad}, but has vertices 0 to {len(points) - 1}", "Repair the mesh.")
    matrix = np.array(mesh.ComputeLocalToWorldTransform(time), dtype=np.float64)
    vertices = (points @ matrix[:3, :3] + matrix[3, :3]) * UsdGeom.GetStageMetersPerUnit(stage)
    if not np.isfinite(vertices).all():
        raise refuse(f"{where} has points that are not finite", "Repair the mesh.")
    faces = _triangles(counts, indices, _array(mesh.GetHoleIndicesAttr().Get(time), np.int64))
    left_handed = mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded
    if left_handed != bool(np.linalg.det(matrix[:3, :3]) < 0.0):
        faces = faces[:, ::-1]
    return _turned(vertices, UsdGeom.GetStageUpAxis(stage), up_axis), np.ascontiguousarray(faces)


def _find(stage: Usd.Stage, prim: str | None, refuse: Callable[[str, str], InputError]) -> UsdGeom.Mesh:
    found = [p for p in stage.Traverse(Usd.TraverseInstanceProxies()) if p.IsA(UsdGeom.Mesh)]
    paths = [str(p.GetPath()) for p in found]
    if not found:
        raise refuse("holds no Mesh prim", "Choose a file with a polygon mesh.")
    if prim is None:
        if len(found) > 1:
            raise refuse(f"holds {len(found)} meshes", f"Say which by its prim path: {_some(paths)}.")
        return UsdGeom.Mesh(found[0])
    if prim not in paths:
        raise refuse(f"holds no Mesh prim at {prim}", f"Use {_some(paths)}.")
    return UsdGeom.Mesh(found[paths.index(prim)])


def _some(paths: list[str], limit: int = 8) -> str:
    more = f", and {len(paths) - limit} more" if len(paths) > limit else ""
    return ", ".join(paths[:limit]) + more


def _array(values: object, dtype: type[np.generic]) -> NDArray[Any]:
    return np.array([] if values is None else values, dtype=dtype)


def _triangles(counts: NDArray[np.int64], indices: NDArray[np.int64], holes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Fans of triangles, shape (m, 3), of polygons given by their corner counts; faces that are holes are left out."""
    starts = np.cumsum(counts) - counts
    kept = np.ones(len(counts), dtype=bool)
    kept[holes[(holes >= 0) & (holes < len(counts))]] = False
    starts, fans = starts[kept], counts[kept] - 2
    first = np.repeat(starts, fans)
    step = np.arange(len(first)) - np.repeat(np.cumsum(fans) - fans, fans)
    return np.stack([indices[first], indices[first + step + 1], indices[first + step + 2]], axis=1)


def _turned(vertices: NDArray[np.float64], given: str, wanted: str) -> NDArray[np.float64]:
    """Turn points about the x axis from one up axis to another."""
    x, y, z = vertices.T
    if given == wanted:
        return vertices
    return np.stack([x, -z, y] if wanted == "Z" else [x, z, -y], axis=1)
