"""The matrix of every strand of a curve, factorised and solved directly: one thread per lane group walks the rows.

A strand's unknowns are the positions x of its nodes and, with material frames, the angles t of the segments that begin
there, one after the other: x1 t1 x2 t2 ... Each x couples with those of the two nodes before it, so the matrix A is a
band. The component array `band` holds its rows (:mod:`warpdeform.kernels.strand_words`), at first those of A and then,
in their place, those of A = L D L'.

The last two nodes of a closed curve also couple with the first two. They are the border, eliminated after all others
(:mod:`warpdeform.kernels.strand_border`).

All of it is in double precision, whatever the precision of the body: strands are stiff against stretching and soft
against bending, and single precision would leave no positive definite matrix of a long one.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.strand_border import strand_border
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


@functools.cache
def strand(width: int, real: Any, angled: bool, closed: bool) -> SimpleNamespace:
    """Kernels ``factorise`` and ``solve`` for one lane width and precision.

    Args:
        width: Lane width.
        real: ``wp.float32`` or ``wp.float64``.
        angled: The angles of the segments are unknowns.
        closed: The last node is followed by the first.
    """
    words, double, system = lanes(width, real), lanes(width, wp.float64), strand_words(width, angled)
    border_of = strand_border(width, angled)
    enter_border, eliminate_border = border_of.enter, border_of.eliminate
    forwards_border, backwards_border = border_of.forwards, border_of.backwards
    read3, read6, write3 = words.read3, words.read6, words.write3
    V, load1, load3, load6 = double.V, double.load1, double.load3, double.load6
    store1, store3, store6, splat, vector = double.store1, double.store3, double.store6, double.splat, double.vector
    dot3, scale, scale6, mul, outer = double.dot3, double.scale, double.scale6, double.mul, double.outer
    symmetric = double.symmetric
    factor6, solve6, inverse_pivot = system.factor6, system.solve6, system.inverse_pivot
    near, far, before_angle, transposed = system.near, system.far, system.before_angle, system.transposed
    zero = wp.float64(0.0)
    ends = 2 if closed else 0
    module = kernel_module(f"strand{'_angled' if angled else ''}{'_closed' if closed else ''}", width, real)
    # Loops over the border's unknowns, one in another, would be a hundred copies of their bodies.
    module.options["max_unroll"] = 6

    @wp.func
    def row(band: wp.array3d(dtype=wp.float64), i: int, j: int, c: int):
        """Row c of A at x_i times the inverse of L': its parts at x_i-2, t_i-2, x_i-1, t_i-1."""
        i2 = wp.max(i - 2, 0)
        t2, t1 = splat(zero), splat(zero)
        x2 = load3(band, FAR + 3 * c, i, j)
        if wp.static(angled):
            t2 = load1(band, FAR_ANGLE + c, i, j) - dot3(load3(band, ANGLE_OWN, i2, j), x2)
        x1 = load3(band, NEAR + 3 * c, i, j) - near(band, i - 1, j, x2, t2)
        if wp.static(angled):
            t1 = load1(band, NEAR_ANGLE + c, i, j) - before_angle(band, i - 1, j, x2, t2, x1)
        return x2, t2, x1, t1

    @wp.func
    def eliminate_position(band: wp.array3d(dtype=wp.float64), i: int, j: int):
        i2 = wp.max(i - 2, 0)
        d2, d1 = load6(band, OWN, i2, j), load6(band, OWN, i - 1, j)
        ax2, at2, ax1, at1 = row(band, i, j, 0)
        bx2, bt2, bx1, bt1 = row(band, i, j, 1)
        cx2, ct2, cx1, ct1 = row(band, i, j, 2)
        al2, bl2, cl2 = solve6(d2, ax2), solve6(d2, bx2), solve6(d2, cx2)
        al1, bl1, cl1 = solve6(d1, ax1), solve6(d1, bx1), solve6(d1, cx1)
        ab, ac, bc = dot3(ax2, bl2) + dot3(ax1, bl1), dot3(ax2, cl2) + dot3(ax1, cl1), dot3(bx2, cl2) + dot3(bx1, cl1)
        less = symmetric(
            vector(dot3(ax2, al2) + dot3(ax1, al1), ab, ac),
            vector(ab, dot3(bx2, bl2) + dot3(bx1, bl1), bc),
            vector(ac, bc, dot3(cx2, cl2) + dot3(cx1, cl1)),
        )
        if wp.static(angled):
            t2, t1 = vector(at2, bt2, ct2), vector(at1, bt1, ct1)
            e2, e1 = load1(band, ANGLE, i2, j), load1(band, ANGLE, i - 1, j)
            less = less + (scale6(e2, outer(t2, t2)) + scale6(e1, outer(t1, t1)))
            store3(band, FAR_ANGLE, i, j, scale(e2, t2))
            store3(band, NEAR_ANGLE, i, j, scale(e1, t1))
        store3(band, FAR, i, j, al2)
        store3(band, FAR + 3, i, j, bl2)
        store3(band, FAR + 6, i, j, cl2)
        store3(band, NEAR, i, j, al1)
        store3(band, NEAR + 3, i, j, bl1)
        store3(band, NEAR + 6, i, j, cl1)
        store6(band, OWN, i, j, factor6(load6(band, OWN, i, j), less))

    @wp.func
    def eliminate_angle(band: wp.array3d(dtype=wp.float64), i: int, j: int):
        e1 = load1(band, ANGLE, i - 1, j)
        x1 = load3(band, ANGLE_NEAR, i, j)
        t1 = load1(band, ANGLE_ANGLE, i, j) - dot3(load3(band, ANGLE_OWN, i - 1, j), x1)
        x = load3(band, ANGLE_OWN, i, j) - near(band, i, j, x1, t1)
        l1, l0 = solve6(load6(band, OWN, i - 1, j), x1), solve6(load6(band, OWN, i, j), x)
        less = dot3(x1, l1) + mul(e1, mul(t1, t1)) + dot3(x, l0)
        store3(band, ANGLE_NEAR, i, j, l1)
        store1(band, ANGLE_ANGLE, i, j, mul(e1, t1))
        store3(band, ANGLE_OWN, i, j, l0)
        store1(band, ANGLE, i, j, inverse_pivot(load1(band, ANGLE, i, j), less))

    @wp.kernel(module=module)
    def factorise(
        nodes: int,
        blocks: wp.array3d(dtype=real),
        band: wp.array3d(dtype=wp.float64),
        border: wp.array3d(dtype=wp.float64),
        corner: wp.array3d(dtype=wp.float64),
    ):
        """Adds what acts on single nodes to the band and factorises it."""
        group = wp.tid()
        j = (group + 1) * width
        for i in range(1, nodes + 1):
            store6(band, OWN, i, j, load6(band, OWN, i, j) + read6(blocks, 0, i, j))
        if wp.static(closed):
            enter_border(nodes, j, band, border, corner)
        for i in range(1, nodes + 1 - ends):
            eliminate_position(band, i, j)
            if wp.static(angled):
                eliminate_angle(band, i, j)
        if wp.static(closed):
            eliminate_border(nodes, j, band, border, corner)

    @wp.kernel(module=module)
    def solve(
        nodes: int,
        band: wp.array3d(dtype=wp.float64),
        border: wp.array3d(dtype=wp.float64),
        corner: wp.array3d(dtype=wp.float64),
        r: wp.array3d(dtype=real),
        work: wp.array3d(dtype=wp.float64),
        z_out: wp.array3d(dtype=real),
    ):
        """z = A^-1 r; no force acts on the angles."""
        group = wp.tid()
        j = (group + 1) * width
        x1, x2, t1, t2 = V(), V(), splat(zero), splat(zero)
        for i in range(1, nodes + 1):
            x, t = read3(r, 0, i, j), splat(zero)
            if i <= nodes - ends:
                x = x - near(band, i, j, x1, t1) - far(band, i, j, x2, t2)
                if wp.static(angled):
                    t = t - before_angle(band, i, j, x1, t1, x)
            store3(work, 0, i, j, x)
            if wp.static(angled):
                store1(work, 3, i, j, t)
            x2 = V() + x1
            x1 = V() + x
            t2 = splat(zero) + t1
            t1 = splat(zero) + t
        if wp.static(closed):
            forwards_border(nodes, j, band, border, corner, work)
            write3(z_out, 0, nodes, j, load3(work, 0, nodes, j))
            write3(z_out, 0, nodes - 1, j, load3(work, 0, nodes - 1, j))
        # From here on 1 and 2 are the nodes behind; there is nothing behind the last one.
        x1, x2, t1 = V(), V(), splat(zero)
        for k in range(ends, nodes):
            i = nodes - k
            i2 = wp.min(i + 2, nodes + 1)
            if wp.static(closed):
                backwards_border(i, j, border, corner, work)
            x = solve6(load6(band, OWN, i, j), load3(work, 0, i, j))
            x = x - transposed(band, NEAR, i + 1, j, x1) - transposed(band, FAR, i2, j, x2)
            if wp.static(angled):
                t = mul(load1(band, ANGLE, i, j), load1(work, 3, i, j))
                t = t - dot3(load3(band, NEAR_ANGLE, i + 1, j), x1) - dot3(load3(band, FAR_ANGLE, i2, j), x2)
                t = t - mul(load1(band, ANGLE_ANGLE, i + 1, j), t1)
                x = x - scale(t1, load3(band, ANGLE_NEAR, i + 1, j)) - scale(t, load3(band, ANGLE_OWN, i, j))
                t1 = splat(zero) + t
            write3(z_out, 0, i, j, x)
            x2 = V() + x1
            x1 = V() + x

    return SimpleNamespace(module=module, factorise=factorise, solve=solve)
