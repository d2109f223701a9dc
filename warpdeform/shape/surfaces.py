"""Rest shapes of surfaces. Normals r_u x r_v of curved and closed ones point outwards."""

import math
from collections.abc import Sequence

import numpy as np

from warpdeform.errors import InputError, Mistake
from warpdeform.shape.checks import FEWEST_AROUND_POLES
from warpdeform.shape.numbers import checked_nodes, degrees, positive
from warpdeform.shape.rest import Array, RestShape, from_map

_LENGTH = "Use a length in m, for example 1.0."


def sheet(nodes: Sequence[int], size: Sequence[float] = (1.0, 1.0)) -> RestShape:
    """Flat sheet from (0, 0, 0) to (size[0], size[1], 0), u along x and v along y.

    Args:
        nodes: Nodes along u and v, each at least 2.
        size: Lengths along u and v [m].

    Raises:
        InputError: Bad `nodes` or `size`.
    """
    checked_nodes(nodes)
    lengths = positive("size", size, 2, "Use two lengths in m, for example [1.0, 1.0].")
    return from_map(lambda u, v: np.stack([u, v, 0.0 * u], axis=-1), nodes, ((0.0, lengths[0]), (0.0, lengths[1])))


def arc(nodes: Sequence[int], radius: float = 1.0, angle: float = 90.0, length: float = 1.0) -> RestShape:
    """Open patch of a cylinder about the y direction: an arch whose crown runs along the y axis, bulging upwards.

    Args:
        nodes: Nodes along u (the arc) and v (the axis), each at least 2.
        radius: Radius [m].
        angle: Opening angle [degrees], less than 360.
        length: Length along the axis [m].

    Raises:
        InputError: Bad `nodes` or sizes.
    """
    checked_nodes(nodes)
    r, width = positive("radius", radius, 1, _LENGTH)[0], positive("length", length, 1, _LENGTH)[0]
    half = 0.5 * r * math.radians(degrees("angle", angle, 360.0, "Use a tube, or less than 360."))

    def arch(u: Array, v: Array) -> Array:
        return np.stack([r * np.sin(u / r), v, r * np.cos(u / r) - r], axis=-1)

    return from_map(arch, nodes, ((-half, half), (0.0, width)))


def tube(nodes: Sequence[int], radius: float = 0.5, length: float = 1.0) -> RestShape:
    """Cylinder about the z axis from z = 0 to z = length, open at its ends; u around it (periodic), v along it.

    Args:
        nodes: Nodes along u, at least 3, and v, at least 2.
        radius: Radius [m].
        length: Length along the axis [m].

    Raises:
        InputError: Bad `nodes` or sizes.
    """
    checked_nodes(nodes, periodic=(True, False))
    r, height = positive("radius", radius, 1, _LENGTH)[0], positive("length", length, 1, _LENGTH)[0]

    def cylinder(u: Array, v: Array) -> Array:
        return np.stack([r * np.cos(u / r), r * np.sin(u / r), v], axis=-1)

    return from_map(cylinder, nodes, ((0.0, 2.0 * math.pi * r), (0.0, height)), (True, False))


def torus(nodes: Sequence[int], radius: float = 0.5, tube_radius: float = 0.2) -> RestShape:
    """Ring about the z axis; u around the ring and v around its tube, both periodic.

    Args:
        nodes: Nodes along u and v, each at least 3.
        radius: Radius of the circle that the tube follows [m].
        tube_radius: Radius of the tube [m], less than `radius`.

    Raises:
        InputError: Bad `nodes` or sizes.
    """
    checked_nodes(nodes, periodic=(True, True))
    a = positive("radius", radius, 1, _LENGTH)[0]
    b = positive("tube_radius", tube_radius, 1, "Use a length in m, for example 0.2.")[0]
    if b >= a:
        problem = f"must be less than the radius {a:g} m, or the torus meets itself"
        raise InputError(Mistake("tube_radius", tube_radius, problem, f"Use for example {0.4 * a:.3g}."))

    def doughnut(u: Array, v: Array) -> Array:
        out = a + b * np.cos(v / b)
        return np.stack([out * np.cos(u / a), out * np.sin(u / a), b * np.sin(v / b)], axis=-1)

    return from_map(doughnut, nodes, ((0.0, 2.0 * math.pi * a), (0.0, 2.0 * math.pi * b)), (True, True))


def sphere(nodes: Sequence[int], radius: float = 0.5) -> RestShape:
    """Closed sphere about the origin; u along the circles of latitude (periodic), v from south to north.

    The latitudes begin and end half a step beside the poles, where no node lies. The cells narrow towards them: with
    as many nodes along u as along v they are 2 pi / n times as wide there as they are long, with more even narrower.

    Args:
        nodes: Nodes along u, an even number of at least 6, and v, at least 2.
        radius: Radius [m].

    Raises:
        InputError: Bad `nodes` or `radius`.
    """
    around, count = checked_nodes(nodes, periodic=(True, False))
    r = positive("radius", radius, 1, _LENGTH)[0]
    if around % 2 or around < FEWEST_AROUND_POLES:
        fewest = f"an even number of at least {FEWEST_AROUND_POLES}"
        problem = f"must have {fewest} along u, so that every meridian goes on across the poles"
        remedy = f"Use for example [{max(around + around % 2, FEWEST_AROUND_POLES)}, {count}]."
        raise InputError(Mistake("nodes", list(nodes), problem, remedy))
    last = 0.5 * math.pi * r * (1.0 - 1.0 / count)

    def globe(u: Array, v: Array) -> Array:
        out = r * np.cos(v / r)
        return np.stack([out * np.cos(u / r), out * np.sin(u / r), r * np.sin(v / r)], axis=-1)

    return from_map(globe, nodes, ((0.0, 2.0 * math.pi * r), (-last, last)), (True, False), (True, True))
