"""Rest shapes of curves: one strand, and many copies of it."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpdeform.errors import InputError, Mistake
from warpdeform.shape.numbers import checked_nodes, positive
from warpdeform.shape.rest import Array, RestShape, from_map

_LENGTH = "Use a length in m, for example 1.0."


def line(nodes: Sequence[int], length: float = 1.0) -> RestShape:
    """Straight strand from (0, 0, 0) to (length, 0, 0).

    Args:
        nodes: Nodes along it, one number of at least 2.
        length: Length [m].

    Raises:
        InputError: Bad `nodes` or `length`.
    """
    checked_nodes(nodes, "curve")
    end = positive("length", length, 1, _LENGTH)[0]
    return from_map(lambda u: np.stack([u, 0.0 * u, 0.0 * u], axis=-1), nodes, ((0.0, end),))


def helix(nodes: Sequence[int], radius: float = 0.1, pitch: float = 0.1, turns: float = 5.0) -> RestShape:
    """Coil about the x axis, right-handed, from (0, radius, 0) towards positive x.

    Args:
        nodes: Nodes along it, one number, at least 3 for each turn and one more.
        radius: Radius [m].
        pitch: Way along the axis in one turn [m].
        turns: Turns.

    Raises:
        InputError: Bad `nodes` or sizes.
    """
    (count,) = checked_nodes(nodes, "curve")
    r = positive("radius", radius, 1, _LENGTH)[0]
    rise = positive("pitch", pitch, 1, "Use a length in m, for example 0.1.")[0] / (2.0 * math.pi)
    times = positive("turns", turns, 1, "Use a number of turns, for example 5.")[0]
    if count - 1 < 3.0 * times:
        problem, enough = f"are too few for {times:g} turns, each of at least 3 edges", math.ceil(12.0 * times) + 1
        raise InputError(Mistake("nodes", nodes, problem, f"Use for example [{enough}]."))
    angle = 2.0 * math.pi * times
    speed = math.hypot(r, rise)

    def coil(u: Array) -> Array:
        t = u / speed
        return np.stack([rise * t, r * np.cos(t), r * np.sin(t)], axis=-1)

    return from_map(coil, nodes, ((0.0, speed * angle),))


def ring(nodes: Sequence[int], radius: float = 1.0) -> RestShape:
    """Closed circle about the z axis in the xy plane, from (radius, 0, 0) towards positive y.

    Args:
        nodes: Nodes around it, one number of at least 3.
        radius: Radius [m].

    Raises:
        InputError: Bad `nodes` or `radius`.
    """
    checked_nodes(nodes, "curve", (True,))
    r = positive("radius", radius, 1, _LENGTH)[0]

    def circle(u: Array) -> Array:
        return np.stack([r * np.cos(u / r), r * np.sin(u / r), 0.0 * u], axis=-1)

    return from_map(circle, nodes, ((0.0, 2.0 * math.pi * r),), (True,))


def strands(curve: RestShape, roots: ArrayLike, normals: ArrayLike | None = None) -> RestShape:
    """Copies of a strand: hair, fringes, ropes side by side, as one body.

    Args:
        curve: A curve of one strand.
        roots: Where the origin of each copy lies [m], shape (k, 3).
        normals: Direction that the x axis of each copy is turned to, the shortest way, shape (k, 3) or (3,) for all;
            None leaves them as they are.

    Raises:
        InputError: Another kind of shape, or arrays of the wrong shape, not finite, or directions of length zero.
    """
    if curve.kind != "curve" or curve.nodes[1] != 1:
        problem = f"must be a curve of one strand, not a {curve.kind} of {' x '.join(map(str, curve.nodes))} nodes"
        raise InputError(Mistake("curve", None, problem, "Use for example line([32], 0.3)."))
    at = _vectors("roots", roots)
    copies = np.broadcast_to(curve.positions, (curve.nodes[0], len(at), 3))
    if normals is not None:
        directions = _vectors("normals", normals)
        if len(directions) not in (1, len(at)):
            problem = f"must be one direction, or one for each of {len(at)} roots"
            raise InputError(Mistake("normals", directions.shape, problem, "Use for example [[0, 0, 1]]."))
        lengths = np.linalg.norm(directions, axis=1, keepdims=True)
        if not lengths.all():
            raise InputError(Mistake("normals", [0, 0, 0], "has length zero", "Use for example [0, 0, 1]."))
        copies = np.einsum("sab,nsb->nsa", _turns(np.broadcast_to(directions / lengths, at.shape)), copies)
    return RestShape(copies + at, curve.spacing, curve.periodic, "curve")


def root_line(count: int, length: float) -> Array:
    """Roots evenly spaced from (0, 0, 0) to (0, length, 0): a fringe [m], shape (count, 3)."""
    return root_grid((1, count), (1.0, length)) if count > 1 else np.zeros((1, 3))


def root_grid(counts: Sequence[int], size: Sequence[float]) -> Array:
    """Roots evenly spaced over the rectangle from (0, 0, 0) to (size[0], size[1], 0) [m], shape (product, 3)."""
    x, y = (np.linspace(0.0, extent, count) for extent, count in zip(size, counts, strict=True))
    points = np.stack(np.meshgrid(x, y, [0.0], indexing="ij"), axis=-1)
    return np.asarray(points.reshape(-1, 3), dtype=np.float64)


def _turns(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotations that turn the x axis to unit vectors, shape (k, 3), the shortest way: shape (k, 3, 3)."""
    c, y, z = directions.T
    # The half turn about z stands in for the shortest way from x to -x, of which there are many.
    across = np.where(c > -1.0 + 1e-12, 1.0 / np.maximum(1.0 + c, 1e-12), 0.0)
    back = c <= -1.0 + 1e-12
    rows = [[c, -y, -z], [y, 1.0 - across * y * y, -across * y * z], [z, -across * y * z, 1.0 - across * z * z]]
    turns = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    turns[back] = np.diag([-1.0, -1.0, 1.0])
    return turns


def _vectors(key: str, values: ArrayLike) -> Array:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.zeros(0)
    array = array[None] if array.shape == (3,) else array
    if isinstance(values, str) or not isinstance(values, Iterable) or array.ndim != 2 or array.shape[1] != 3:
        raise InputError(Mistake(key, values, "must be a list of vectors", "Use for example [[0, 0, 1]]."))
    if not len(array) or not np.isfinite(array).all():
        raise InputError(Mistake(key, values, "must be finite vectors, at least one", "Use for example [[0, 0, 1]]."))
    return array
