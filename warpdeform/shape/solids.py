"""Rest shapes of solids; u, v and w turn like x, y and z."""

import math
from collections.abc import Sequence

import numpy as np

from warpdeform.errors import InputError, Mistake
from warpdeform.shape.numbers import checked_nodes, degrees, positive
from warpdeform.shape.rest import Array, RestShape, from_map

_LENGTH = "Use a length in m, for example 1.0."
_SIZE = "Use three lengths in m, for example [1.0, 0.2, 0.2]."


def block(nodes: Sequence[int], size: Sequence[float] = (1.0, 1.0, 1.0)) -> RestShape:
    """Block from (0, 0, 0) to (size[0], size[1], size[2]), u along x, v along y and w along z.

    Args:
        nodes: Nodes along u, v and w, each at least 2.
        size: Lengths along u, v and w [m].

    Raises:
        InputError: Bad `nodes` or `size`.
    """
    checked_nodes(nodes, "solid")
    lengths = positive("size", size, 3, _SIZE)
    return from_map(lambda u, v, w: np.stack([u, v, w], axis=-1), nodes, [(0.0, length) for length in lengths])


def bent_block(nodes: Sequence[int], size: Sequence[float] = (1.0, 0.2, 0.2), angle: float = 90.0) -> RestShape:
    """Block that is bent about the y direction, bulging upwards; halfway up it is as long as it would be straight.

    Args:
        nodes: Nodes along u (the arc), v (along y) and w (outwards), each at least 2.
        size: Lengths along u, v and w [m].
        angle: Opening angle [degrees], less than 360.

    Raises:
        InputError: Bad `nodes`, `size` or `angle`, or a block too thick to be bent so far.
    """
    checked_nodes(nodes, "solid")
    lengths = positive("size", size, 3, _SIZE)
    opening = math.radians(degrees("angle", angle, 360.0, "Use a pipe, or less than 360."))
    r = lengths[0] / opening
    if 0.5 * lengths[2] >= r:
        problem = f"bends a block of thickness {lengths[2]:g} m about a radius of {r:.3g} m, less than half of it"
        raise InputError(Mistake("angle", angle, problem, "Use a smaller angle, or a thinner block."))

    def arch(u: Array, v: Array, w: Array) -> Array:
        return np.stack([(r + w) * np.sin(u / r), v, (r + w) * np.cos(u / r) - r], axis=-1)

    half = [0.5 * lengths[0], 0.5 * lengths[2]]
    return from_map(arch, nodes, ((-half[0], half[0]), (0.0, lengths[1]), (-half[1], half[1])))


def pipe(nodes: Sequence[int], radius: float = 0.5, length: float = 1.0, thickness: float = 0.1) -> RestShape:
    """Tube with a solid wall about the z axis; u around it (periodic), v along it, w outwards.

    Args:
        nodes: Nodes along u, at least 3, v and w, each at least 2.
        radius: Radius halfway through the wall [m].
        length: Length along the axis [m].
        thickness: Thickness of the wall [m], less than twice the radius.

    Raises:
        InputError: Bad `nodes` or sizes.
    """
    checked_nodes(nodes, "solid", (True, False, False))
    r, height = positive("radius", radius, 1, _LENGTH)[0], positive("length", length, 1, _LENGTH)[0]
    wall = positive("thickness", thickness, 1, "Use a length in m, for example 0.1.")[0]
    if wall >= 2.0 * r:
        problem = f"must be less than twice the radius {r:g} m, which leaves a hole"
        raise InputError(Mistake("thickness", thickness, problem, f"Use for example {0.2 * r:.3g}."))

    def cylinder(u: Array, v: Array, w: Array) -> Array:
        return np.stack([(r + w) * np.cos(u / r), (r + w) * np.sin(u / r), v], axis=-1)

    extent = ((0.0, 2.0 * math.pi * r), (0.0, height), (-0.5 * wall, 0.5 * wall))
    return from_map(cylinder, nodes, extent, (True, False, False))
