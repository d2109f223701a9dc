"""The mesh that a parameter grid is drawn as: quads, texture coordinates, vertex normals and extents."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpdeform.errors import InputError, Mistake


@dataclass(frozen=True)
class SurfaceMesh:
    """A surface as it appears in a USD file: node (i, j) of the grid is the point i * nv + j of the mesh.

    Attributes:
        name: Name of the body; the prim's name follows it.
        nodes: Nodes along u and v.
        periodic: Axes whose index wraps.
        color: Diffuse colour, linear RGB, each 0 to 1.
        roughness: Roughness of the material, 0 (mirror) to 1 (matt).
        thickness: Thickness of the surface, m; 0 = unknown.
    """

    name: str
    nodes: tuple[int, int]
    periodic: tuple[bool, bool] = (False, False)
    color: tuple[float, float, float] = (0.55, 0.13, 0.1)
    roughness: float = 0.7
    thickness: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", tuple(int(n) for n in self.nodes))
        object.__setattr__(self, "periodic", tuple(bool(p) for p in self.periodic))
        object.__setattr__(self, "color", tuple(float(c) for c in self.color))
        mistakes = []
        if len(self.nodes) != 2 or any(n < (3 if p else 2) for n, p in zip(self.nodes, self.periodic, strict=True)):
            problem = "a surface needs at least 2 nodes along each axis, 3 along a periodic one"
            mistakes.append(Mistake("nodes", self.nodes, problem, "Use [2, 2] or more."))
        if len(self.color) != 3 or not np.all(np.isfinite(self.color)) or min(self.color) < 0.0:
            mistakes.append(Mistake("color", self.color, "is not a colour", "Use three numbers from 0 to 1."))
        if not 0.0 <= self.roughness <= 1.0:
            mistakes.append(Mistake("roughness", self.roughness, "is outside 0 to 1", "Use 0 (mirror) to 1 (matt)."))
        if not 0.0 <= self.thickness < np.inf:
            mistakes.append(Mistake("thickness", self.thickness, "is not a length", "Use metres, 0 when unknown."))
        if mistakes:
            raise InputError(mistakes)

    @property
    def cells(self) -> tuple[int, int]:
        """Quads along u and v."""
        (nu, nv), (wrap_u, wrap_v) = self.nodes, self.periodic
        return (nu if wrap_u else nu - 1, nv if wrap_v else nv - 1)

    @property
    def closed(self) -> bool:
        """Whether the surface has no border."""
        return all(self.periodic)


def quad_indices(mesh: SurfaceMesh) -> NDArray[np.int32]:
    """Corners of the quads, shape (cells, 4), counter-clockwise seen from the side that r_u x r_v points to."""
    (nu, nv), (cu, cv) = mesh.nodes, mesh.cells
    i, j = np.meshgrid(np.arange(cu), np.arange(cv), indexing="ij")
    i1, j1 = (i + 1) % nu, (j + 1) % nv
    corners = [i * nv + j, i1 * nv + j, i1 * nv + j1, i * nv + j1]
    return np.stack(corners, axis=-1).reshape(-1, 4).astype(np.int32)


def texture_coordinates(mesh: SurfaceMesh) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Texture coordinates that run from 0 to 1 along u and v, with a seam where an axis closes.

    Returns:
        Values, shape ((cu + 1) (cv + 1), 2), and the value of each face corner, shape (4 cells,).
    """
    cu, cv = mesh.cells
    s, t = np.meshgrid(np.arange(cu + 1) / cu, np.arange(cv + 1) / cv, indexing="ij")
    seamed = SurfaceMesh("seamed", (cu + 1, cv + 1))
    return np.stack([s, t], axis=-1).reshape(-1, 2).astype(np.float32), quad_indices(seamed).reshape(-1)


def vertex_normals(points: NDArray[np.float32], periodic: tuple[bool, bool] = (False, False)) -> NDArray[np.float32]:
    """Unit normals at the nodes: the area vectors of the quads around a node, added up and scaled to length 1.

    The area vector of a quad is half the cross product of its diagonals, whatever its shape. Where the area vectors
    cancel (a sheet folded flat at the node) the normal is that of one of the quads, so it is always a unit vector.

    Args:
        points: Node positions, shape (nu, nv, 3).
        periodic: Axes whose index wraps.

    Returns:
        Normals on the side of r_u x r_v, shape (nu, nv, 3).
    """
    r = np.ascontiguousarray(np.moveaxis(points, 2, 0), dtype=np.float32)
    for axis, wraps in enumerate(periodic, start=1):
        if wraps:
            r = np.concatenate([r, r.take([0], axis=axis)], axis=axis)
    first = r[:, 1:, 1:] - r[:, :-1, :-1]
    second = r[:, :-1, 1:] - r[:, 1:, :-1]
    nu, nv = points.shape[:2]
    # quads around a node: one ring of zeros (open) or of wrapped quads (periodic) frames the cells
    areas = np.zeros((3, nu + 1, nv + 1), np.float32)
    inner = areas[:, 1 : 1 + first.shape[1], 1 : 1 + first.shape[2]]
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(first[b], second[c], out=inner[a])
        inner[a] -= first[c] * second[b]
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


def extent(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Smallest and largest coordinates of points (..., 3), shape (2, 3)."""
    columns = [points[..., k] for k in range(3)]  # one at a time: twenty times faster than along the first axis
    return np.array([[column.min() for column in columns], [column.max() for column in columns]], dtype=np.float32)


def _length(vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Lengths of component vectors (3, ...)."""
    return np.asarray(np.sqrt(np.einsum("kij,kij->ij", vectors, vectors)), dtype=np.float32)


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
