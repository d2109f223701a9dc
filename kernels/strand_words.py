"""Words of the direct solve along strands: where the band lies, its blocks, a step of a substitution.

The rows of node i, in the notation of :mod:`warpdeform.kernels.strand`. FAR and NEAR are blocks, one row of three
components after another; OWN is a symmetric block, factorised an LDL' of its own; of the rest each is a vector over the
components of x, or a number.

    FAR           x_i with x_i-2              FAR_ANGLE     x_i with t_i-2
    NEAR          x_i with x_i-1              NEAR_ANGLE    x_i with t_i-1
    OWN           x_i with itself
    ANGLE_NEAR    t_i with x_i-1              ANGLE_ANGLE   t_i with t_i-1
    ANGLE_OWN     t_i with x_i                ANGLE         t_i with itself; factorised, the inverse
"""

import functools
from types import SimpleNamespace

import warp as wp

from warpdeform.kernels.lanes import lanes

FAR = wp.constant(0)
NEAR = wp.constant(9)
OWN = wp.constant(18)
FAR_ANGLE = wp.constant(24)
NEAR_ANGLE = wp.constant(27)
ANGLE_NEAR = wp.constant(30)
ANGLE_OWN = wp.constant(33)
ANGLE_ANGLE = wp.constant(36)
ANGLE = wp.constant(37)

PIVOT = 1.0e-14
"""Smallest pivot as a part of the diagonal entry: below it round-off decides."""


def band_components(angled: bool) -> int:
    """Components of the band, with or without angles."""
    return 38 if angled else 24


@functools.cache
def strand_words(width: int, angled: bool) -> SimpleNamespace:
    """Device functions for one lane width, with or without angles. x1 and t1 belong to the node before, x2 and t2 to
    the one before that.
    """
    double = lanes(width, wp.float64)
    L, V, S = double.L, double.V, double.S
    load1, load3, splat, vector = double.load1, double.load3, double.splat, double.vector
    dot3, scale, mul, div, symmetric = double.dot3, double.scale, double.mul, double.div, double.symmetric
    larger, at_least = double.larger, double.at_least
    one, pivot, tiny = wp.float64(1.0), wp.float64(PIVOT), wp.float64(1.0e-60)

    @wp.func
    def inverse_pivot(diagonal: L, less: L):
        return div(splat(one), at_least(larger(diagonal - less, pivot * diagonal), tiny))

    @wp.func
    def factor6(s: S, less: S):
        """Factors of s - less: inverses of D in the diagonal, L beside it. An inverse would lose what is soft in it."""
        a, b, c = s[3] - less[3], s[4] - less[4], s[5] - less[5]
        x = inverse_pivot(s[0], less[0])
        xy, xz = mul(x, a), mul(x, b)
        y = inverse_pivot(s[1], less[1] + mul(xy, a))
        left = c - mul(xy, b)
        yz = mul(y, left)
        z = inverse_pivot(s[2], less[2] + mul(xz, b) + mul(yz, left))
        return symmetric(vector(x, xy, xz), vector(xy, y, yz), vector(xz, yz, z))

    @wp.func
    def solve6(f: S, v: V):
        """The inverse of a factorised block times v."""
        v1 = v[1] - mul(f[3], v[0])
        v2 = v[2] - mul(f[4], v[0]) - mul(f[5], v1)
        z = mul(f[2], v2)
        y = mul(f[1], v1) - mul(f[5], z)
        return vector(mul(f[0], v[0]) - mul(f[3], y) - mul(f[4], z), y, z)

    @wp.func
    def block(band: wp.array3d(dtype=wp.float64), at: int, i: int, j: int, x: V):
        """A block times x."""
        return vector(
            dot3(load3(band, at, i, j), x), dot3(load3(band, at + 3, i, j), x), dot3(load3(band, at + 6, i, j), x)
        )

    @wp.func
    def transposed(band: wp.array3d(dtype=wp.float64), at: int, i: int, j: int, x: V):
        """The transpose of a block times x."""
        return (
            scale(x[0], load3(band, at, i, j))
            + scale(x[1], load3(band, at + 3, i, j))
            + scale(x[2], load3(band, at + 6, i, j))
        )

    @wp.func
    def near(band: wp.array3d(dtype=wp.float64), i: int, j: int, x1: V, t1: L):
        """What the rows of L of x_i make of the node before."""
        x = block(band, NEAR, i, j, x1)
        if wp.static(angled):
            x = x + scale(t1, load3(band, NEAR_ANGLE, i, j))
        return x

    @wp.func
    def far(band: wp.array3d(dtype=wp.float64), i: int, j: int, x2: V, t2: L):
        """What they make of the node before that."""
        x = block(band, FAR, i, j, x2)
        if wp.static(angled):
            x = x + scale(t2, load3(band, FAR_ANGLE, i, j))
        return x

    @wp.func
    def before_angle(band: wp.array3d(dtype=wp.float64), i: int, j: int, x1: V, t1: L, x: V):
        """What the row of L of t_i makes of the node before and of x_i."""
        t = dot3(load3(band, ANGLE_NEAR, i, j), x1) + mul(load1(band, ANGLE_ANGLE, i, j), t1)
        return t + dot3(load3(band, ANGLE_OWN, i, j), x)

    return SimpleNamespace(
        inverse_pivot=inverse_pivot,
        factor6=factor6,
        solve6=solve6,
        transposed=transposed,
        near=near,
        far=far,
        before_angle=before_angle,
    )
