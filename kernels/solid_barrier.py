"""What keeps the cells of a solid from turning inside out (design 1.3): a barrier in their signed volume.

Squared lengths do not tell a cell from its mirror image, the determinant of its mean edges does. With the sums y1, y2,
y3 of the four edges along each axis, four times the mean edges,

    J = y1.(y2 x y3) / its value at rest
    W = kappa V (1 - J)^3/J   for J < 1, else nothing

It has no stress and no stiffness at rest, so that E and nu stay what they are. It grows as 1/J, and from J <= `LEAST`
on it is infinite, so that a line search refuses to go there.

The Hessian is the Gauss-Newton part, W'' of J times the square of J's gradient: the rest is indefinite, and small where
the barrier is steep.
"""

import functools
import math
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.transfer import transfer_tables, transfers

LEAST = 1e-4
"""J from which on the energy is infinite; float32 tells J to 1e-7."""
FLUX_COMPONENTS = 9
"""Derivatives of a cell's energy by y1, y2, y3."""
CELL_COMPONENTS = 3
"""Of a cell: kappa V; 1 over y1.(y2 x y3) at rest; 1, where there is none all three are 0."""


@functools.cache
def solid_barrier(width: int, real: Any) -> SimpleNamespace:
    """Kernels ``press_cells``, ``product_cells``, ``gather``, ``energy_cells``, ``block_nodes``, ``average_stiffness``.

    Args:
        width: Lane width.
        real: ``wp.float32`` or ``wp.float64``.
    """
    words, moves, Tables = lanes(width, real), transfers(width, real), transfer_tables(real)
    L, V = words.L, words.V
    load1, load3, store1, store3 = words.load1, words.load3, words.store1, words.store3
    add3, add6, sum_lanes, above = words.add3, words.add6, words.sum_lanes, words.above
    dot3, cross3, scale, scale6, outer = words.dot3, words.cross3, words.scale, words.scale6, words.outer
    mul, div, at_least, splat, carried = words.mul, words.div, words.at_least, words.splat, moves.carried
    one, two = real(1.0), real(2.0)
    least, infinite = real(LEAST), real(math.inf)
    module = kernel_module("solid_barrier", width, real)

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
    def relative_volume(y1: V, y2: V, y3: V, cells: wp.array3d(dtype=real), i: int, j: int):
        """J, and 1 where there is no cell."""
        return mul(load1(cells, 1, i, j), dot3(y1, cross3(y2, y3))) + (splat(one) - load1(cells, 2, i, j))

    @wp.func
    def within(J: L):
        """J between `LEAST` and 1, where there is a barrier that can be divided by."""
        return (-one) * at_least((-one) * at_least(J, least), -one)

    @wp.kernel(module=module)
    def press_cells(
        first: int,
        u: int,
        r: wp.array3d(dtype=real),
        cells: wp.array3d(dtype=real),
        stiffness_out: wp.array3d(dtype=real),
        flux_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        y1, y2, y3 = edge_sums(r, i, j, u)
        J = within(relative_volume(y1, y2, y3, cells, i, j))
        # W' = -kappa V (1 - J)^2 (1 + 2 J)/J^2,  W'' = 2 kappa V (1 - J)(1 + J + J^2)/J^3
        slope, per_volume = div(splat(one) - J, J), load1(cells, 1, i, j)
        strength = mul(load1(cells, 0, i, j), per_volume)
        bend = div(mul(slope, splat(one) + J + mul(J, J)), mul(J, J))
        store1(stiffness_out, 0, i, j, two * mul(mul(strength, per_volume), bend))
        pressure = mul(strength, mul(mul(slope, slope), splat(-one) - two * J))
        store3(flux_out, 0, i, j, scale(pressure, cross3(y2, y3)))
        store3(flux_out, 3, i, j, scale(pressure, cross3(y3, y1)))
        store3(flux_out, 6, i, j, scale(pressure, cross3(y1, y2)))

    @wp.kernel(module=module)
    def product_cells(
        first: int,
        u: int,
        r: wp.array3d(dtype=real),
        stiffness: wp.array3d(dtype=real),
        p: wp.array3d(dtype=real),
        flux_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        y1, y2, y3 = edge_sums(r, i, j, u)
        p1, p2, p3 = edge_sums(p, i, j, u)
        a1, a2, a3 = cross3(y2, y3), cross3(y3, y1), cross3(y1, y2)
        change = mul(load1(stiffness, 0, i, j), dot3(a1, p1) + dot3(a2, p2) + dot3(a3, p3))
        store3(flux_out, 0, i, j, scale(change, a1))
        store3(flux_out, 3, i, j, scale(change, a2))
        store3(flux_out, 6, i, j, scale(change, a3))

    @wp.func
    def square_sum(a: wp.array3d(dtype=real), c: int, i: int, j: int, bi: int, bj: int, ci: int, cj: int):
        """Sum over the four cells on one side of a node."""
        return (load3(a, c, i, j) + load3(a, c, i - bi, j - bj)) + (
            load3(a, c, i - ci, j - cj) + load3(a, c, i - bi - ci, j - bj - cj)
        )

    @wp.kernel(module=module)
    def gather(first: int, u: int, flux: wp.array3d(dtype=real), force_out: wp.array3d(dtype=real)):
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        f = square_sum(flux, 0, i - u, j, 1, 0, 0, 1) - square_sum(flux, 0, i, j, 1, 0, 0, 1)
        f = f + (square_sum(flux, 3, i - 1, j, u, 0, 0, 1) - square_sum(flux, 3, i, j, u, 0, 0, 1))
        f = f + (square_sum(flux, 6, i, j - 1, u, 0, 1, 0) - square_sum(flux, 6, i, j, u, 0, 1, 0))
        add3(force_out, 0, i, j, f)

    @wp.kernel(module=module)
    def energy_cells(
        first: int,
        u: int,
        r: wp.array3d(dtype=real),
        cells: wp.array3d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        y1, y2, y3 = edge_sums(r, i, j, u)
        J = relative_volume(y1, y2, y3, cells, i, j)
        inside = within(J)
        less = splat(one) - inside
        w = mul(load1(cells, 0, i, j), div(mul(less, mul(less, less)), inside))
        partials_out[i, j] = partials_out[i, j] + sum_lanes(above(J, least, w, splat(infinite)))

    @wp.kernel(module=module)
    def block_nodes(
        first: int,
        u: int,
        r: wp.array3d(dtype=real),
        stiffness: wp.array3d(dtype=real),
        blocks_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        for a in range(2):
            for b in range(2):
                for c in range(2):
                    # The node is corner (a, b, c) of the cell.
                    ci, cj = i - u * a - b, j - c
                    y1, y2, y3 = edge_sums(r, ci, cj, u)
                    h = real(2 * a - 1) * cross3(y2, y3) + real(2 * b - 1) * cross3(y3, y1)
                    h = h + real(2 * c - 1) * cross3(y1, y2)
                    add6(blocks_out, 0, i, j, scale6(load1(stiffness, 0, ci, cj), outer(h, h)))

    @wp.kernel(module=module)
    def average_stiffness(
        stiffness: wp.array3d(dtype=real), tables: Tables, growth: real, stiffness_out: wp.array3d(dtype=real)
    ):
        """Mean over the fine cells of a coarse cell, whose volume has grown by `growth`."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store1(stiffness_out, 0, i, j, mul(splat(one / growth), carried(stiffness, 0, tables, i, j)))

    return SimpleNamespace(
        module=module,
        press_cells=press_cells,
        product_cells=product_cells,
        gather=gather,
        energy_cells=energy_cells,
        block_nodes=block_nodes,
        average_stiffness=average_stiffness,
    )
