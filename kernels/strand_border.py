"""The border of a closed strand's matrix: its last two nodes, which couple with the first two as well.

Border unknown n is component n of x_n-1 (n = 0, 1, 2), with angles t_n-1 (3), then the same of the last node. Its row
reaches along the strand, stored in the array `border` as rows of x and t at every other node; what the border's
unknowns have with each other is the lower triangle in `corner`, factorised densely.
"""

import functools
from types import SimpleNamespace

import warp as wp

from warpdeform.kernels.lanes import lanes
from warpdeform.kernels.strand_words import (
    ANGLE,
    ANGLE_ANGLE,
    ANGLE_NEAR,
    ANGLE_OWN,
    FAR,
    FAR_ANGLE,
    NEAR,
    NEAR_ANGLE,
    OWN,
    strand_words,
)


def border_components(angled: bool) -> int:
    """Components of the border, with or without angles."""
    return 32 if angled else 18


def corner_components(angled: bool) -> int:
    """Components of the corner: a triangle, and two vectors."""
    return 36 + 16 if angled else 21 + 12


@functools.cache
def strand_border(width: int, angled: bool) -> SimpleNamespace:
    """Device functions ``enter``, ``eliminate``, ``forwards`` and ``backwards`` for one lane width."""
    double, system = lanes(width, wp.float64), strand_words(width, angled)
    V, load1, load3, load6 = double.V, double.load1, double.load3, double.load6
    store1, store3, add1, add3 = double.store1, double.store3, double.add1, double.add3
    dot3, scale, mul, splat = double.dot3, double.scale, double.mul, double.splat
    inverse_pivot, solve6, near, far = system.inverse_pivot, system.solve6, system.near, system.far
    before_angle = system.before_angle
    zero = wp.float64(0.0)
    h = 4 if angled else 3
    count = 2 * h
    diagonal_at = count * (count + 1) // 2
    side_at = diagonal_at + count

    @wp.func
    def entry(n: int, e: int):
        """Component of the corner for unknowns n and e <= n."""
        return (n * (n + 1)) // 2 + e

    @wp.func
    def clear(band: wp.array3d(dtype=wp.float64), i: int, j: int, both: bool):
        """No coupling with the node before the one before, nor with the one before."""
        for c in range(9):
            store1(band, FAR + c, i, j, splat(zero))
            if both:
                store1(band, NEAR + c, i, j, splat(zero))
        if wp.static(angled):
            for c in range(3):
                store1(band, FAR_ANGLE + c, i, j, splat(zero))
                if both:
                    store1(band, NEAR_ANGLE + c, i, j, splat(zero))
                    store1(band, ANGLE_NEAR + c, i, j, splat(zero))
            if both:
                store1(band, ANGLE_ANGLE, i, j, splat(zero))

    @wp.func
    def enter(
        nodes: int,
        j: int,
        band: wp.array3d(dtype=wp.float64),
        border: wp.array3d(dtype=wp.float64),
        corner: wp.array3d(dtype=wp.float64),
    ):
        """Moves what couples with the last two nodes out of the band."""
        last = nodes - 2
        for i in range(1, last + 1):
            for n in range(count * h):
                store1(border, n, i, j, splat(zero))
        for c in range(3):
            # The last two nodes with those before them.
            add3(border, c * h, last - 1, j, load3(band, FAR + 3 * c, nodes - 1, j))
            add3(border, c * h, last, j, load3(band, NEAR + 3 * c, nodes - 1, j))
            add3(border, (h + c) * h, last, j, load3(band, FAR + 3 * c, nodes, j))
            for m in range(3):
                # The first two nodes with those that they follow.
                add1(border, m * h + c, 1, j, load1(band, FAR + 3 * c + m, 1, j))
                add1(border, (h + m) * h + c, 1, j, load1(band, NEAR + 3 * c + m, 1, j))
                add1(border, (h + m) * h + c, 2, j, load1(band, FAR + 3 * c + m, 2, j))
                store1(corner, entry(h + c, m), 0, j, load1(band, NEAR + 3 * c + m, nodes, j))
            for m in range(c + 1):
                at = OWN + c + m + 2
                if m == c:
                    at = OWN + c
                store1(corner, entry(c, m), 0, j, load1(band, at, nodes - 1, j))
                store1(corner, entry(h + c, h + m), 0, j, load1(band, at, nodes, j))
            if wp.static(angled):
                add1(border, c * h + 3, last - 1, j, load1(band, FAR_ANGLE + c, nodes - 1, j))
                add1(border, c * h + 3, last, j, load1(band, NEAR_ANGLE + c, nodes - 1, j))
                add1(border, (h + c) * h + 3, last, j, load1(band, FAR_ANGLE + c, nodes, j))
                add1(border, 3 * h + c, last, j, load1(band, ANGLE_NEAR + c, nodes - 1, j))
                add1(border, 3 * h + c, 1, j, load1(band, FAR_ANGLE + c, 1, j))
                add1(border, (h + 3) * h + c, 1, j, load1(band, NEAR_ANGLE + c, 1, j))
                add1(border, (h + 3) * h + c, 2, j, load1(band, FAR_ANGLE + c, 2, j))
                add1(border, (h + c) * h + 3, 1, j, load1(band, ANGLE_NEAR + c, 1, j))
                store1(corner, entry(3, c), 0, j, load1(band, ANGLE_OWN + c, nodes - 1, j))
                store1(corner, entry(h + 3, h + c), 0, j, load1(band, ANGLE_OWN + c, nodes, j))
                store1(corner, entry(h + c, 3), 0, j, load1(band, NEAR_ANGLE + c, nodes, j))
                store1(corner, entry(h + 3, c), 0, j, load1(band, ANGLE_NEAR + c, nodes, j))
        if wp.static(angled):
            add1(border, 3 * h + 3, last, j, load1(band, ANGLE_ANGLE, nodes - 1, j))
            add1(border, (h + 3) * h + 3, 1, j, load1(band, ANGLE_ANGLE, 1, j))
            store1(corner, entry(3, 3), 0, j, load1(band, ANGLE, nodes - 1, j))
            store1(corner, entry(h + 3, h + 3), 0, j, load1(band, ANGLE, nodes, j))
            store1(corner, entry(h + 3, 3), 0, j, load1(band, ANGLE_ANGLE, nodes, j))
        clear(band, 1, j, True)
        clear(band, 2, j, False)
        clear(band, nodes - 1, j, True)
        clear(band, nodes, j, True)

    @wp.func
    def eliminate(
        nodes: int,
        j: int,
        band: wp.array3d(dtype=wp.float64),
        border: wp.array3d(dtype=wp.float64),
        corner: wp.array3d(dtype=wp.float64),
    ):
        """The border's rows times the inverse of L', and what D leaves of the corner, factorised."""
        for n in range(count):
            store1(corner, diagonal_at + n, 0, j, load1(corner, entry(n, n), 0, j))
            x1, x2, t1, t2 = V(), V(), splat(zero), splat(zero)
            for i in range(1, nodes - 1):
                x = load3(border, n * h, i, j) - near(band, i, j, x1, t1) - far(band, i, j, x2, t2)
                store3(border, n * h, i, j, x)
                t2 = splat(zero) + t1
                if wp.static(angled):
                    t1 = load1(border, n * h + 3, i, j) - before_angle(band, i, j, x1, t1, x)
                    store1(border, n * h + 3, i, j, t1)
                x2 = V() + x1
                x1 = V() + x
        for i in range(1, nodes - 1):
            factors = load6(band, OWN, i, j)
            for e in range(count):
                w = solve6(factors, load3(border, e * h, i, j))
                for n in range(e, count):
                    add1(corner, entry(n, e), 0, j, splat(zero) - dot3(load3(border, n * h, i, j), w))
                if wp.static(angled):
                    wt = mul(load1(band, ANGLE, i, j), load1(border, e * h + 3, i, j))
                    for n in range(e, count):
                        add1(corner, entry(n, e), 0, j, splat(zero) - mul(load1(border, n * h + 3, i, j), wt))
        for e in range(count):
            whole = load1(corner, diagonal_at + e, 0, j)
            inverse = inverse_pivot(whole, whole - load1(corner, entry(e, e), 0, j))
            for n in range(e + 1, count):
                factor = mul(inverse, load1(corner, entry(n, e), 0, j))
                for m in range(e + 1, n + 1):
                    add1(corner, entry(n, m), 0, j, splat(zero) - mul(factor, load1(corner, entry(m, e), 0, j)))
            for n in range(e + 1, count):
                store1(corner, entry(n, e), 0, j, mul(inverse, load1(corner, entry(n, e), 0, j)))
            store1(corner, entry(e, e), 0, j, inverse)

    @wp.func
    def forwards(
        nodes: int,
        j: int,
        band: wp.array3d(dtype=wp.float64),
        border: wp.array3d(dtype=wp.float64),
        corner: wp.array3d(dtype=wp.float64),
        work: wp.array3d(dtype=wp.float64),
    ):
        """Solves for the border, after the substitution along all other nodes; the last two nodes of `work`."""
        for n in range(count):
            store1(corner, side_at + n, 0, j, load1(work, n % h, nodes - 1 + n // h, j))
        for i in range(1, nodes - 1):
            w, wt = solve6(load6(band, OWN, i, j), load3(work, 0, i, j)), splat(zero)
            if wp.static(angled):
                wt = mul(load1(band, ANGLE, i, j), load1(work, 3, i, j))
            for n in range(count):
                less = dot3(load3(border, n * h, i, j), w)
                if wp.static(angled):
                    less = less + mul(load1(border, n * h + 3, i, j), wt)
                add1(corner, side_at + n, 0, j, splat(zero) - less)
        for n in range(count):
            for e in range(n):
                less = mul(load1(corner, entry(n, e), 0, j), load1(corner, side_at + e, 0, j))
                add1(corner, side_at + n, 0, j, splat(zero) - less)
        for k in range(count):
            n = count - 1 - k
            x = mul(load1(corner, entry(n, n), 0, j), load1(corner, side_at + n, 0, j))
            for e in range(n + 1, count):
                x = x - mul(load1(corner, entry(e, n), 0, j), load1(corner, side_at + e, 0, j))
            store1(corner, side_at + n, 0, j, x)
            store1(work, n % h, nodes - 1 + n // h, j, x)

    @wp.func
    def backwards(
        i: int,
        j: int,
        border: wp.array3d(dtype=wp.float64),
        corner: wp.array3d(dtype=wp.float64),
        work: wp.array3d(dtype=wp.float64),
    ):
        """Takes what the border does to a node off its right-hand side."""
        for n in range(count):
            x = splat(zero) - load1(corner, side_at + n, 0, j)
            add3(work, 0, i, j, scale(x, load3(border, n * h, i, j)))
            if wp.static(angled):
                add1(work, 3, i, j, mul(x, load1(border, n * h + 3, i, j)))

    return SimpleNamespace(enter=enter, eliminate=eliminate, forwards=forwards, backwards=backwards)
