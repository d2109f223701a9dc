"""The matrix of every strand of a curve, factorised and solved directly: one thread per lane group walks the rows.

A strand has d unknowns per node: the position, and with material frames the angle of the segment that begins there. It
couples each node with the two before and after it, so its matrix is a band. Row c of a node is stored as the components

    band_row(d, c) + 0 .. d - 1          couplings with the node before the one before
    band_row(d, c) + d .. 2d - 1         with the node before
    band_row(d, c) + 2d .. 2d + c        with the node itself, the diagonal last

of the component array `band`, and Cholesky's factor in its place, with the inverse of the diagonal. An angle couples
with nothing beyond the node before.

The last two nodes of a closed curve also couple with the first two. They are the border: eliminated after all others,
so that their rows, which reach along the whole strand, fill nothing but the array `border`: component n d + m is the
coupling of unknown n of the border, 0 .. 2d - 1, with unknown m of the node.

All of it is in double precision, whatever the precision of the body: strands are stiff against stretching and soft
against bending, so that single precision would leave no positive definite matrix of a long one.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes

PIVOT = 1.0e-14
"""Smallest pivot as a part of the diagonal entry: below it round-off decides."""


def band_row(unknowns: int, c: int) -> int:
    """Component where row c of a node begins; for c = unknowns the number of components."""
    return 2 * unknowns * c + c * (c + 1) // 2


@functools.cache
def strand(width: int, real: Any, unknowns: int, closed: bool) -> SimpleNamespace:
    """Kernels of the direct solve for one lane width and precision.

    Args:
        width: Lane width.
        real: ``wp.float32`` or ``wp.float64``.
        unknowns: Unknowns per node d: 3, or 4 with angles.
        closed: The last node is followed by the first.

    Returns:
        Kernels ``enter_nodes``, ``factorise`` and ``solve``.
    """
    words, double = lanes(width, real), lanes(width, wp.float64)
    read1, read3, write3 = words.read1, words.read3, words.write3
    L, load1, store1, store3, add1 = double.L, double.load1, double.store1, double.store3, double.add1
    load3, mul, div, root, splat = double.load3, double.mul, double.div, double.root, double.splat
    larger, at_least = double.larger, double.at_least
    zero, one, pivot, tiny = wp.float64(0.0), wp.float64(1.0), wp.float64(PIVOT), wp.float64(1.0e-60)
    d, d2 = unknowns, 2 * unknowns
    ends = 2 if closed else 0
    module = kernel_module(f"strand_{unknowns}{'_closed' if closed else ''}", width, real)

    @wp.func
    def row_of(c: int):
        return d2 * c + (c * (c + 1)) // 2

    @wp.func
    def first_of(c: int):
        """Where row c begins to be filled: an angle has no coupling with the node before the one before."""
        return wp.where(c == 3, d, 0)

    @wp.func
    def node_of(i: int, q: int):
        """Row of the node before the one before (q = 0), of the one before (1), of the node itself (2)."""
        return wp.max(i - 2 + q, 0)

    @wp.func
    def inverse_pivot(diagonal: L, less: L):
        return div(splat(one), at_least(larger(diagonal - less, pivot * diagonal), tiny))

    @wp.kernel(module=module)
    def enter_nodes(
        loop: int,
        free: wp.array3d(dtype=real),
        blocks: wp.array3d(dtype=real),
        band_out: wp.array3d(dtype=wp.float64),
    ):
        """Adds what acts on single nodes; pinned nodes get the rows and columns of the identity."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        before = wp.where(i == 1, loop, i - 1)
        f0 = read1(free, 0, wp.where(before == 1, loop, wp.max(before - 1, 0)), j)
        f1, f2 = read1(free, 0, before, j), read1(free, 0, i, j)
        for c in range(d):
            row, f = row_of(c), splat(one)
            if c < 3:
                f = f2
            for m in range(d):
                far, near, own = f, f, f
                if m < 3:
                    far, near, own = mul(f, f0), mul(f, f1), mul(f, f2)
                store1(band_out, row + m, i, j, mul(far, load1(band_out, row + m, i, j)))
                store1(band_out, row + d + m, i, j, mul(near, load1(band_out, row + d + m, i, j)))
                if m <= c:
                    x = load1(band_out, row + d2 + m, i, j)
                    if m == c and c < 3:
                        x = mul(f, x + read1(blocks, c, i, j)) + (splat(one) - f)
                    elif c < 3:
                        x = mul(f, x + read1(blocks, c + m + 2, i, j))
                    else:
                        x = mul(own, x)
                    store1(band_out, row + d2 + m, i, j, x)

    @wp.func
    def eliminate(band: wp.array3d(dtype=wp.float64), i: int, j: int, c: int):
        """Row c of a node: u_s = A_cs - sum over t < s of u_t L_st, L_cs = u_s / D_s, D_c = A_cc - sum of u_s L_cs."""
        row, first, less = row_of(c), first_of(c), splat(zero)
        for s in range(first, d2 + c):
            q = s // d
            node = node_of(i, q)
            # What unknown t is to row c of node i, t + (2 - q) d is to the row of unknown s.
            other = row_of(s - q * d) + (2 - q) * d
            u = load1(band, row + s, i, j)
            for t in range(first, s):
                u = u - mul(load1(band, row + t, i, j), load1(band, other + t, node, j))
            store1(band, row + s, i, j, u)
        for s in range(first, d2 + c):
            q = s // d
            m = s - q * d
            u = load1(band, row + s, i, j)
            x = mul(u, load1(band, row_of(m) + d2 + m, node_of(i, q), j))
            less = less + mul(u, x)
            store1(band, row + s, i, j, x)
        store1(band, row + d2 + c, i, j, inverse_pivot(load1(band, row + d2 + c, i, j), less))

    @wp.func
    def border_entry(n: int, e: int):
        """Component of the coupling of unknowns n and e <= n of the border, in the row of n's node."""
        return row_of(n % d) + d * (2 - n // d + e // d) + e % d

    @wp.func
    def enter_border(nodes: int, j: int, band: wp.array3d(dtype=wp.float64), border: wp.array3d(dtype=wp.float64)):
        """What couples the last two nodes with all others."""
        for c in range(d):
            for m in range(d):
                far, near = row_of(c) + m, row_of(c) + d + m
                # The last two nodes with those before them, then the first two with those they follow.
                add1(border, c * d + m, nodes - 3, j, load1(band, far, nodes - 1, j))
                add1(border, c * d + m, nodes - 2, j, load1(band, near, nodes - 1, j))
                add1(border, (d + c) * d + m, nodes - 2, j, load1(band, far, nodes, j))
                add1(border, m * d + c, 1, j, load1(band, far, 1, j))
                add1(border, (d + m) * d + c, 1, j, load1(band, near, 1, j))
                add1(border, (d + m) * d + c, 2, j, load1(band, far, 2, j))

    @wp.func
    def eliminate_border(nodes: int, j: int, band: wp.array3d(dtype=wp.float64), border: wp.array3d(dtype=wp.float64)):
        for n in range(d2):
            for i in range(1, nodes - 1):
                for m in range(d):
                    x, row = load1(border, n * d + m, i, j), row_of(m)
                    for t in range(first_of(m), d2 + m):
                        q = t // d
                        x = x - mul(load1(border, n * d + t - q * d, node_of(i, q), j), load1(band, row + t, i, j))
                    store1(border, n * d + m, i, j, mul(x, load1(band, row + d2 + m, i, j)))
        for n in range(d2):
            own = nodes - 1 + n // d
            for e in range(n + 1):
                node, total = nodes - 1 + e // d, splat(zero)
                for i in range(1, nodes - 1):
                    for m in range(d):
                        total = total + mul(load1(border, n * d + m, i, j), load1(border, e * d + m, i, j))
                for t in range(e):
                    total = total + mul(
                        load1(band, border_entry(n, t), own, j), load1(band, border_entry(e, t), node, j)
                    )
                at = border_entry(n, e)
                x = load1(band, at, own, j)
                if e < n:
                    store1(band, at, own, j, mul(x - total, load1(band, border_entry(e, e), node, j)))
                else:
                    store1(band, at, own, j, inverse_pivot(x, total))

    @wp.kernel(module=module)
    def factorise(nodes: int, band: wp.array3d(dtype=wp.float64), border: wp.array3d(dtype=wp.float64)):
        group = wp.tid()
        j = (group + 1) * width
        if wp.static(closed):
            enter_border(nodes, j, band, border)
        for i in range(1, nodes + 1 - ends):
            for c in range(d):
                eliminate(band, i, j, c)
        if wp.static(closed):
            eliminate_border(nodes, j, band, border)

    @wp.func
    def forwards_border(
        nodes: int,
        j: int,
        band: wp.array3d(dtype=wp.float64),
        border: wp.array3d(dtype=wp.float64),
        work: wp.array3d(dtype=wp.float64),
    ):
        for n in range(d2):
            own = nodes - 1 + n // d
            x = load1(work, n % d, own, j)
            for i in range(1, nodes - 1):
                for m in range(d):
                    x = x - mul(load1(border, n * d + m, i, j), load1(work, m, i, j))
            for e in range(n):
                x = x - mul(load1(band, border_entry(n, e), own, j), load1(work, e % d, nodes - 1 + e // d, j))
            store1(work, n % d, own, j, mul(x, load1(band, border_entry(n, n), own, j)))

    @wp.func
    def backwards_border(
        nodes: int,
        j: int,
        band: wp.array3d(dtype=wp.float64),
        border: wp.array3d(dtype=wp.float64),
        work: wp.array3d(dtype=wp.float64),
    ):
        for k in range(d2):
            n = d2 - 1 - k
            own = nodes - 1 + n // d
            x = mul(load1(work, n % d, own, j), load1(band, border_entry(n, n), own, j))
            store1(work, n % d, own, j, x)
            for e in range(n):
                add1(work, e % d, nodes - 1 + e // d, j, splat(zero) - mul(load1(band, border_entry(n, e), own, j), x))
            for i in range(1, nodes - 1):
                for m in range(d):
                    add1(work, m, i, j, splat(zero) - mul(load1(border, n * d + m, i, j), x))

    @wp.kernel(module=module)
    def solve(
        nodes: int,
        band: wp.array3d(dtype=wp.float64),
        border: wp.array3d(dtype=wp.float64),
        r: wp.array3d(dtype=real),
        work: wp.array3d(dtype=wp.float64),
        z_out: wp.array3d(dtype=real),
    ):
        """z = A^-1 r; no force acts on the angles."""
        group = wp.tid()
        j = (group + 1) * width
        for i in range(1, nodes + 1):
            store3(work, 0, i, j, read3(r, 0, i, j))
            if wp.static(d == 4):
                store1(work, 3, i, j, splat(zero))
        for i in range(1, nodes + 1 - ends):
            for c in range(d):
                x, row = load1(work, c, i, j), row_of(c)
                for t in range(first_of(c), d2 + c):
                    q = t // d
                    x = x - mul(load1(band, row + t, i, j), load1(work, t - q * d, node_of(i, q), j))
                store1(work, c, i, j, mul(x, load1(band, row + d2 + c, i, j)))
        if wp.static(closed):
            forwards_border(nodes, j, band, border, work)
            backwards_border(nodes, j, band, border, work)
        for k in range(ends, nodes):
            i = nodes - k
            for n in range(d):
                c = d - 1 - n
                row = row_of(c)
                x = mul(load1(work, c, i, j), load1(band, row + d2 + c, i, j))
                store1(work, c, i, j, x)
                for t in range(first_of(c), d2 + c):
                    q = t // d
                    add1(work, t - q * d, node_of(i, q), j, splat(zero) - mul(load1(band, row + t, i, j), x))
        for i in range(1, nodes + 1):
            write3(z_out, 0, i, j, load3(work, 0, i, j))

    return SimpleNamespace(module=module, enter_nodes=enter_nodes, factorise=factorise, solve=solve)
