"""Round tubes around curves of straight segments."""

from __future__ import annotations

import numpy as np

from warpdeform.study.picture.drawing import Floats, Ints


def tubes(paths: Floats, radii: Floats, sides: int, *, closed: bool) -> tuple[Floats, Ints, Floats, Ints]:
    """Triangles of tubes around curves of as many nodes each, with flat ends where the curves are open.

    Args:
        paths: Nodes of the curves, shape (k, n, 3).
        radii: Radius at each node, shape (k, n).
        sides: Corners of a circle.
        closed: Whether the curves close.

    Returns:
        Vertices (m, 3), triangles, unit normals, and the node of each vertex, counted through all curves.
    """
    count, n = paths.shape[:2]
    tangents, first = _frames(paths, closed)
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    second = np.cross(tangents, first)
    normals = first[:, :, None] * np.cos(angle)[:, None] + second[:, :, None] * np.sin(angle)[:, None]
    points = paths[:, :, None] + radii[:, :, None, None] * normals
    lower = np.arange(count * n * sides).reshape(count, n, sides)
    upper = np.roll(lower, -1, axis=1)
    if closed:
        # coming round, the frame is turned against the first one: each corner goes on to the nearest
        back = np.arctan2(np.sum(first[:, 0] * second[:, -1], axis=1), np.sum(first[:, 0] * first[:, -1], axis=1))
        shift = np.rint(back / (2.0 * np.pi) * sides).astype(np.int64)
        upper[:, -1] = np.take_along_axis(upper[:, -1], (np.arange(sides) - shift[:, None]) % sides, axis=1)
    else:
        lower, upper = lower[:, :-1], upper[:, :-1]
    quads = np.stack([lower, np.roll(lower, -1, axis=2), np.roll(upper, -1, axis=2), upper], axis=-1).reshape(-1, 4)
    vertices, facings = [points.reshape(-1, 3)], [normals.reshape(-1, 3)]
    triangles = [quads[:, :3], quads[:, [0, 2, 3]]]
    nodes = np.arange(count * n).reshape(count, n)
    owners = [np.repeat(nodes.reshape(-1), sides)]
    for end, out in () if closed else ((0, -tangents[:, 0]), (-1, tangents[:, -1])):
        disc = sum(len(part) for part in vertices) + np.arange(count * sides).reshape(count, sides)
        fan = np.stack([np.repeat(disc[:, :1], sides - 2, axis=1), disc[:, 1:-1], disc[:, 2:]], axis=-1).reshape(-1, 3)
        triangles.append(fan if end else fan[:, ::-1])
        vertices.append(points[:, end].reshape(-1, 3))
        facings.append(np.repeat(out, sides, axis=0))
        owners.append(np.repeat(nodes[:, end], sides))
    return np.concatenate(vertices), np.concatenate(triangles), np.concatenate(facings), np.concatenate(owners)


def _frames(paths: Floats, closed: bool) -> tuple[Floats, Floats]:
    """At each node, the mean direction of the segments beside it and a unit vector across, both (k, n, 3).

    The vector across is carried from node to node by projection, so that triangles do not wind around the tube.
    """
    ahead = _units(np.roll(paths, -1, axis=1) - paths, np.array([0.0, 0.0, 1.0]))
    if not closed:
        ahead[:, -1] = ahead[:, -2]
    behind = np.roll(ahead, 1, axis=1)
    if not closed:
        behind[:, 0] = ahead[:, 0]
    tangents = _units(ahead + behind, ahead)
    across = np.empty_like(paths)
    last = np.eye(3)[np.abs(tangents[:, 0]).argmin(axis=1)]
    for node in range(paths.shape[1]):
        tangent = tangents[:, node]
        flat = last - np.sum(last * tangent, axis=1, keepdims=True) * tangent
        last = across[:, node] = _units(flat, np.cross(tangent, np.roll(tangent, 1, axis=1)))
    return tangents, across


def _units(vectors: Floats, instead: Floats) -> Floats:
    """Vectors scaled to length 1; those of no length are replaced first."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    vectors = np.where(length > 1e-12, vectors, instead)
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)
