"""Geometry of polygon meshes and grids: normals, areas, enclosed volumes and extents."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def vertex_normals(
    points: NDArray[np.float32], periodic: Sequence[bool] = (False, False), caps: Sequence[bool] = (False, False)
) -> NDArray[np.float32]:
    """Unit normals at the nodes: the area vectors of the quads around a node, added up and scaled to length 1.

    The area vector of a quad is half the cross product of its diagonals, whatever its shape. Where the area vectors
    cancel (a sheet folded flat at the node) the normal is that of one of the quads, so it is always a unit vector.
    A cap counts as the triangles between its ring and the ring's centre, enlarged to the size of the quads on the
    ring's other side: on a ball whose rings stand half a step from the poles the normals then point outwards.

    Args:
        points: Node positions, shape (nu, nv, 3).
        periodic: Axes whose index wraps.
        caps: Whether the ring of nodes at the start and at the end of the open axis is closed by a cap.

    Returns:
        Normals on the side of r_u x r_v, shape (nu, nv, 3).
    """
    if any(caps) and periodic[0]:
        normals = vertex_normals(points.transpose(1, 0, 2), (periodic[1], periodic[0]), caps)
        return np.negative(normals.transpose(1, 0, 2))
    r = np.ascontiguousarray(np.moveaxis(points, 2, 0), dtype=np.float32)
    for axis, wraps in enumerate(periodic, start=1):
        if wraps:
            r = np.concatenate([r, r.take([0], axis=axis)], axis=axis)
    first = r[:, 1:, 1:] - r[:, :-1, :-1]
    second = r[:, :-1, 1:] - r[:, 1:, :-1]
    nu, nv = points.shape[:2]
    # quads around a node: one ring of zeros (open), of a cap's triangles or of wrapped quads (periodic) frames them
    areas = np.zeros((3, nu + 1, nv + 1), np.float32)
    inner = areas[:, 1 : 1 + first.shape[1], 1 : 1 + first.shape[2]]
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(first[b], second[c], out=inner[a])
        inner[a] -= first[c] * second[b]
    for end, capped in enumerate(caps):
        if capped:
            arms = r[:, -end] - points[-end].mean(axis=0, dtype=np.float32)[:, None]
            fan = np.cross(arms[:, :-1], arms[:, 1:], axis=0) * np.float32(-1.0 if end else 1.0)
            beside, own = _length(inner[:, -end]).sum(), _length(fan).sum()
            areas[:, -end, 1:] = fan * (beside / own if own > 0.0 else 0.0)
    if periodic[0]:
        areas[:, 0, :] = areas[:, -1, :]
    if periodic[1]:
        areas[:, :, 0] = areas[:, :, -1]
    around = [areas[:, di : di + nu, dj : dj + nv] for di in (0, 1) for dj in (0, 1)]
    normals = around[0] + around[1] + around[2] + around[3]
    length, largest = _length(normals), _length(areas).max()
    cancelled = length <= np.float32(1e-6) * largest
    if cancelled.any():
        _fill_cancelled(normals, length, cancelled, around)
    normals /= length
    return np.ascontiguousarray(np.moveaxis(normals, 0, 2))


def creased_normals(
    vertices: NDArray[np.floating], faces: NDArray[np.integer], crease: float = 45.0
) -> NDArray[np.float32]:
    """Normals of a triangle mesh that are smooth, except across edges sharper than `crease`.

    The normal of a face at a corner adds up the area vectors of those faces around the vertex that lie within `crease`.

    Args:
        vertices: Vertices, shape (n, 3); faces that touch share them.
        faces: Triangles, shape (m, 3).
        crease: Angle between faces that counts as an edge, degrees.

    Returns:
        Unit normals of the face corners, shape (3 m, 3).
    """
    a, b, c = (vertices[faces[:, k]].astype(np.float64) for k in range(3))
    areas = np.cross(b - a, c - a)
    sizes = np.linalg.norm(areas, axis=1, keepdims=True)
    units = np.where(sizes > 0.0, areas / np.where(sizes > 0.0, sizes, 1.0), (0.0, 0.0, 1.0))
    corners = faces.reshape(-1)
    order = np.argsort(corners, kind="stable")
    degree = np.bincount(corners, minlength=len(vertices))
    start = np.cumsum(degree) - degree
    # all pairs of corners (first, second) that share a vertex
    pairs = degree[corners]
    first = np.repeat(np.arange(len(corners)), pairs)
    second = order[start[corners[first]] + np.arange(len(first)) - np.repeat(np.cumsum(pairs) - pairs, pairs)]
    smooth = np.einsum("ij,ij->i", units[first // 3], units[second // 3]) > np.cos(np.radians(crease))
    first, second = first[smooth], second[smooth]
    columns = [np.bincount(first, weights=areas[second // 3, k], minlength=len(corners)) for k in range(3)]
    normals = np.stack(columns, axis=1)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    good = length > 0.0
    return np.where(good, normals / np.where(good, length, 1.0), np.repeat(units, 3, axis=0)).astype(np.float32)


def face_areas(
    points: NDArray[np.floating], counts: NDArray[np.integer], indices: NDArray[np.integer]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Area vectors and centres of polygons.

    Args:
        points: Points, shape (n, 3).
        counts: Corners of each face, shape (m,).
        indices: Points of the corners, face after face.

    Returns:
        Area vectors (on the side from which the corners run counter-clockwise) and mean corners, both (m, 3).
    """
    corners = points[indices].astype(np.float64)
    starts = np.cumsum(counts) - counts
    centres = np.add.reduceat(corners, starts) / counts[:, None]
    arms = corners - np.repeat(centres, counts, axis=0)
    return 0.5 * np.add.reduceat(np.cross(arms, arms[next_corners(counts)]), starts), centres


def next_corners(counts: NDArray[np.integer]) -> NDArray[np.int64]:
    """The corner that follows each corner around its face, of faces with so many corners."""
    ends = np.cumsum(counts)
    following = np.arange(1, int(ends[-1]) + 1)
    following[ends - 1] = ends - counts
    return following


def enclosed_volume(points: NDArray[np.floating], counts: NDArray[np.integer], indices: NDArray[np.integer]) -> float:
    """Volume inside a closed mesh, negative where its faces look inwards; the arguments are those of `face_areas`."""
    areas, centres = face_areas(points, counts, indices)
    return float(np.sum(areas * (centres - points.mean(axis=0, dtype=np.float64)))) / 3.0


def extent(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Smallest and largest coordinates of points (..., 3), shape (2, 3)."""
    columns = [points[..., k] for k in range(3)]  # one at a time: twenty times faster than along the first axis
    return np.array([[column.min() for column in columns], [column.max() for column in columns]], dtype=np.float32)


def _length(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Lengths of component vectors (3, ...)."""
    return np.asarray(np.sqrt(np.einsum("k...,k...->...", vectors, vectors)), dtype=np.float32)


def _fill_cancelled(
    normals: NDArray[np.float32],
    length: NDArray[np.float32],
    cancelled: NDArray[np.bool_],
    around: list[NDArray[np.float32]],
) -> None:
    """Give nodes whose area vectors cancel the normal of their largest quad, or +Z where all quads are degenerate."""
    i, j = np.nonzero(cancelled)
    candidates = np.stack([area[:, i, j] for area in around]).astype(np.float64)  # (4, 3, k)
    sizes = np.linalg.norm(candidates, axis=1)
    best = sizes.argmax(axis=0)
    columns = np.arange(len(i))
    chosen, size = candidates[best, :, columns], sizes[best, columns]
    degenerate = size < 1e-30
    chosen[degenerate], size[degenerate] = (0.0, 0.0, 1.0), 1.0
    normals[:, i, j] = (chosen / size[:, None]).T
    length[i, j] = 1.0
