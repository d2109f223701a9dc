"""How the nodes of a grid are joined: faces of surfaces, sides and tetrahedra of solids, texture coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int32]


def cell_counts(nodes: Sequence[int], periodic: Sequence[bool]) -> tuple[int, ...]:
    """Cells along each axis: as many as nodes where the index wraps, else one less."""
    return tuple(n if wraps else n - 1 for n, wraps in zip(nodes, periodic, strict=True))


def quad_indices(nodes: Sequence[int], periodic: Sequence[bool] = (False, False)) -> Ints:
    """Corners of the quads of a grid, counter-clockwise seen from the side that r_u x r_v points to.

    Node (i, j) is the point i * nv + j. A quad begins at its node (i, j), so that the diagonal between its first and
    its third corner runs the way in which both indices grow.

    Returns:
        Corners, shape (cells, 4).
    """
    (nu, nv), (cu, cv) = nodes, cell_counts(nodes, periodic)
    i, j = np.meshgrid(np.arange(cu), np.arange(cv), indexing="ij")
    i1, j1 = (i + 1) % nu, (j + 1) % nv
    corners = [i * nv + j, i1 * nv + j, i1 * nv + j1, i * nv + j1]
    return np.stack(corners, axis=-1).reshape(-1, 4).astype(np.int32)


def texture_coordinates(
    nodes: Sequence[int], periodic: Sequence[bool] = (False, False)
) -> tuple[NDArray[np.float32], Ints]:
    """Texture coordinates that run from 0 to 1 along u and v, with a seam where an axis closes.

    Returns:
        Values, shape ((cu + 1) (cv + 1), 2), and the value of each quad's corners, shape (cells, 4).
    """
    cu, cv = cell_counts(nodes, periodic)
    s, t = np.meshgrid(np.arange(cu + 1) / cu, np.arange(cv + 1) / cv, indexing="ij")
    return np.stack([s, t], axis=-1).reshape(-1, 2).astype(np.float32), quad_indices((cu + 1, cv + 1))


def cap_faces(count: int) -> list[Ints]:
    """Cut a ring into quads between its two halves, with a triangle at the end where the number of points is odd.

    Renderers do not agree on how a polygon of many corners is cut, least of all when it is not flat; and a fan would
    meet in one node of the ring.

    Args:
        count: Points of the ring, at least 3.

    Returns:
        Faces that run around the ring as its points do: quads, shape (k, 4), and triangles, shape (0 or 1, 3).
    """
    k = np.arange((count - 1) // 2)
    quads = np.stack([k, k + 1, count - 2 - k, count - 1 - k], axis=-1).astype(np.int32)
    if count % 2 == 0:
        return [quads, np.zeros((0, 3), np.int32)]
    return [quads[:-1], quads[-1:, [0, 1, 3]]]


def flattened(faces: Sequence[Ints]) -> tuple[Ints, Ints]:
    """Corner counts of faces given in groups (k, corners), and all their corners one after the other."""
    counts = np.repeat([group.shape[1] for group in faces], [len(group) for group in faces]).astype(np.int32)
    return counts, np.concatenate([group.reshape(-1) for group in faces])


@dataclass(frozen=True)
class Side:
    """One side of a block of nodes, a grid of its own.

    Attributes:
        nodes: Numbers of its nodes, shape (n1, n2); r_1 x r_2 points out of the block.
        periodic: Axes of the side whose index wraps.
    """

    nodes: NDArray[np.int64]
    periodic: tuple[bool, bool]


def block_sides(nodes: Sequence[int], periodic: Sequence[bool], turned: bool = False) -> list[Side]:
    """The sides of a block where it does not wrap: first and last of u, of v, of w.

    Args:
        nodes: Nodes along u, v and w; node (i, j, k) has the number (i * nv + j) * nw + k.
        periodic: Axes whose index wraps: they have no sides.
        turned: Whether (u, v, w) is left-handed.
    """
    numbers = np.arange(np.prod(nodes)).reshape(nodes)
    sides = []
    for axis in range(3):
        if periodic[axis]:
            continue
        across = ((axis + 1) % 3, (axis + 2) % 3)
        for last in (False, True):
            first, second = across if last != turned else across[::-1]
            grid = numbers.transpose(axis, first, second)[-1 if last else 0]
            sides.append(Side(np.ascontiguousarray(grid), (bool(periodic[first]), bool(periodic[second]))))
    return sides


def block_tetrahedra(nodes: Sequence[int], periodic: Sequence[bool], turned: bool = False) -> Ints:
    """Six tetrahedra per cell, one for each order in which the three axes lead from a cell's first node to its last.

    All share the cell's diagonal, and the diagonals of its faces are those of its neighbours' too, over a seam as well
    (with five to a cell every second one would have to be mirrored, which an odd periodic axis does not allow).

    Args:
        nodes: Nodes along u, v and w, as for `block_sides`.
        periodic: Axes whose index wraps.
        turned: Whether (u, v, w) is left-handed.

    Returns:
        Node numbers, shape (6 cells, 4); (r1 - r0) . ((r2 - r0) x (r3 - r0)) > 0, as USD wants it.
    """
    cells = cell_counts(nodes, periodic)
    start = np.stack(np.meshgrid(*(np.arange(count) for count in cells), indexing="ij"), axis=-1).reshape(-1, 3)
    found = []
    for order in permutations(range(3)):
        steps = np.zeros((4, 3), dtype=np.int64)
        for k, axis in enumerate(order, start=1):
            steps[k:, axis] += 1
        even = np.linalg.det(np.eye(3)[list(order)]) > 0.0
        if even == turned:
            steps = steps[[0, 2, 1, 3]]
        found.append(np.ravel_multi_index(tuple(np.moveaxis((start[:, None] + steps) % nodes, -1, 0)), tuple(nodes)))
    return np.stack(found, axis=1).reshape(-1, 4).astype(np.int32)
