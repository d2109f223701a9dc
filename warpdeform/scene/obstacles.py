"""From the table of an obstacle to the obstacle."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpdeform.obstacle import SIZES, Obstacle
from warpdeform.scene.collect import Collector, look
from warpdeform.scene.keys import Path
from warpdeform.scene.tracks import obstacle_track, quaternion
from warpdeform.track import Track, multiply, rotation_to

_UP = {"Z": (0.0, 0.0, 1.0), "Y": (0.0, 1.0, 0.0)}


def make_obstacle(table: Any, index: int, up_axis: str, collector: Collector) -> Obstacle | None:
    """Make an obstacle; None, and mistakes in the collector, if something of it was refused.

    Args:
        table: Its table, of the kind that it names.
        index: Which one it is in the file.
        up_axis: The axis that points up, "Y" or "Z".
        collector: Takes the mistakes.
    """
    at: Path = ("obstacle", index)
    arguments: dict[str, Any] = {
        "kind": table.kind,
        "name": table.name or table.kind,
        "sizes": {size: getattr(table, size) for size in SIZES[table.kind]},
        "track": _track(table, at, up_axis, collector),
        "friction": table.friction,
        "design_speed": table.design_speed,
        "gap": table.gap,
        **look(table, at, collector),
    }
    mesh = None
    if table.kind == "mesh":
        mesh = _mesh(table, at, up_axis, collector)
        if mesh is None:
            arguments.update(kind="sphere", sizes={"radius": 1.0})
        else:
            arguments.update(thickness=table.thickness, vertices=mesh[0], faces=mesh[1])
    with collector.at(at):
        obstacle = Obstacle(**arguments)
        return obstacle if table.kind == obstacle.kind else None
    return None


def _track(table: Any, at: Path, up_axis: str, collector: Collector) -> Track:
    rotation = quaternion(table.rotation)
    if table.kind == "plane":
        with collector.at(at):
            rotation = multiply(rotation, rotation_to(table.normal or _UP[up_axis]))
    with collector.at((*at, "path")):
        return obstacle_track(table.path, table.position, rotation)
    return Track.fixed()


def _mesh(
    table: Any, at: Path, up_axis: str, collector: Collector
) -> tuple[NDArray[np.float64], NDArray[np.integer]] | None:
    """Vertices [m] and triangles of a mesh obstacle: of a file, or of an asset of Warp if it has no suffix."""
    from warpdeform.usd.mesh import read_mesh, warp_asset  # USD is loaded only where it is needed

    scale = np.broadcast_to(np.asarray(table.scale, dtype=np.float64), (3,))
    if not (scale > 0).all():
        collector.refuse((*at, "scale"), table.scale, "must be positive", "Use for example 1.0.")
    with collector.at(at, {"asset": (*at, "mesh")}):
        file = collector.file.parent / FilePath(table.mesh).expanduser()
        path = file if file.suffix else warp_asset(table.mesh)
        vertices, faces = read_mesh(path, table.prim, up_axis=up_axis)
        return vertices * scale, faces
    return None
