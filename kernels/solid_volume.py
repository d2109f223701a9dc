"""Words of what keeps the cells of a solid from turning inside out (design 1.3): a barrier in their signed volume.

Squared lengths do not tell a cell from its mirror image, the determinant of its mean edges does. With the sums y1, y2,
y3 of the four edges along each axis, four times the mean edges,

    J = y1.(y2 x y3) / its value at rest
    W = kappa V (1 - J)^3/J   for J < 1, else nothing

It has no stress and no stiffness at rest, so that E and nu stay what they are. It grows as 1/J, and from J <= `LEAST`
on it is infinite, so that a line search refuses to go there.

Its Hessian is the Gauss-Newton part, W'' of J times the square of J's gradient: the rest is indefinite, and small where
the barrier is steep.
"""

import functools
import math
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import lanes

LEAST = 1e-4
"""J from which on the energy is infinite; float32 tells J to 1e-7."""
VOLUME_COMPONENTS = 3
"""Of a cell: kappa V; 1 over y1.(y2 x y3) at rest; 1. All three are 0 where there is no cell."""


@functools.cache
def solid_volume(width: int, real: Any) -> SimpleNamespace:
    """Device functions for one lane width and precision; `volume` are the arrays of `VOLUME_COMPONENTS`."""
    words = lanes(width, real)
    L, V = words.L, words.V
    load1, load3, dot3, cross3 = words.load1, words.load3, words.dot3, words.cross3
    mul, div, at_least, above, splat = words.mul, words.div, words.at_least, words.above, words.splat
    one, two, least, infinite = real(1.0), real(2.0), real(LEAST), real(math.inf)

    @wp.func
    def edge_sums(r: wp.array3d(dtype=real), i: int, j: int, u: int):
        """y1, y2, y3."""
        r000, r100 = load3(r, 0, i, j), load3(r, 0, i + u, j)
        r010, r110 = load3(r, 0, i + 1, j), load3(r, 0, i + u + 1, j)
        r001, r101 = load3(r, 0, i, j + 1), load3(r, 0, i + u, j + 1)
        r011, r111 = load3(r, 0, i + 1, j + 1), load3(r, 0, i + u + 1, j + 1)
        return (
            ((r100 - r000) + (r110 - r010)) + ((r101 - r001) + (r111 - r011)),
            ((r010 - r000) + (r110 - r100)) + ((r011 - r001) + (r111 - r101)),
            ((r001 - r000) + (r101 - r100)) + ((r011 - r010) + (r111 - r110)),
        )

    @wp.func
    def normals(y1: V, y2: V, y3: V):
        """Derivatives of y1.(y2 x y3)."""
        return cross3(y2, y3), cross3(y3, y1), cross3(y1, y2)

    @wp.func
    def relative_volume(r: wp.array3d(dtype=real), volume: wp.array3d(dtype=real), i: int, j: int, u: int):
        """J, and 1 where there is no cell."""
        y1, y2, y3 = edge_sums(r, i, j, u)
        return mul(load1(volume, 1, i, j), dot3(y1, cross3(y2, y3))) + (splat(one) - load1(volume, 2, i, j))

    @wp.func
    def within(J: L):
        """J between `LEAST` and 1, where there is a barrier that can be divided by."""
        return (-one) * at_least((-one) * at_least(J, least), -one)

    @wp.func
    def barrier_energy(J: L, volume: wp.array3d(dtype=real), i: int, j: int):
        inside = within(J)
        less = splat(one) - inside
        w = mul(load1(volume, 0, i, j), div(mul(less, mul(less, less)), inside))
        return above(J, least, w, splat(infinite))

    @wp.func
    def push(J: L, volume: wp.array3d(dtype=real), i: int, j: int):
        """Derivative of the energy by y1.(y2 x y3): W' = -kappa V (1 - J)^2 (1 + 2 J)/J^2."""
        inside = within(J)
        slope = div(splat(one) - inside, inside)
        strength = mul(load1(volume, 0, i, j), load1(volume, 1, i, j))
        return mul(strength, mul(mul(slope, slope), splat(-one) - two * inside))

    @wp.func
    def hardness(J: L, volume: wp.array3d(dtype=real), i: int, j: int):
        """Second derivative: W'' = 2 kappa V (1 - J)(1 + J + J^2)/J^3."""
        inside, rest = within(J), load1(volume, 1, i, j)
        square = mul(inside, inside)
        bend = div(mul(splat(one) - inside, splat(one) + inside + square), mul(inside, square))
        return two * mul(mul(load1(volume, 0, i, j), mul(rest, rest)), bend)

    return SimpleNamespace(
        edge_sums=edge_sums,
        normals=normals,
        relative_volume=relative_volume,
        barrier_energy=barrier_energy,
        push=push,
        hardness=hardness,
    )
