"""Blocks of the projected Hessian of elastic curves: those of the nodes, for smoothers, and the band of a strand.

Compiled only where a preconditioner asks for them. Formulas and coefficients are those of
:mod:`warpdeform.kernels.curve`; the layout of the band is that of :mod:`warpdeform.kernels.strand`.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.curve import variant_name
from warpdeform.kernels.curve_geometry import curve_geometry
from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.strand import band_row


@functools.cache
def curve_blocks(width: int, real: Any, strains: int) -> SimpleNamespace:
    """Kernels ``block_nodes`` and ``band_nodes``; arguments as for :func:`warpdeform.kernels.curve.curve`."""
    words, shape = lanes(width, real), curve_geometry(width, real)
    V = words.V
    load1, load3, store1, store3, add6 = words.load1, words.load3, words.store1, words.store3, words.add6
    scale, mul, splat, outer, isotropic, vector = (
        words.scale,
        words.mul,
        words.splat,
        words.outer,
        words.isotropic,
        words.vector,
    )
    row_before, row_after = shape.row_before, shape.row_after
    zero, one = real(0.0), real(1.0)
    d = 4 if strains == 3 else 3
    row0, row1, row2, row3 = (band_row(d, c) for c in range(4))
    module = kernel_module(f"curve_blocks_{variant_name(strains)}", width, real)

    @wp.func
    def slope(slopes: wp.array3d(dtype=real), k: int, at: int, i: int, j: int):
        """Derivative of strain k of node i by the node before it (at = -1), by itself (0), by the node after it (1)."""
        wa, wb = load3(slopes, 6 * k, i, j), load3(slopes, 6 * k + 3, i, j)
        if at < 0:
            wb = V() - wa
        if at == 0:
            wb = wa - wb
        return wb

    @wp.kernel(module=module)
    def block_nodes(
        loop: int, stretch: wp.array3d(dtype=real), slopes: wp.array3d(dtype=real), blocks_out: wp.array3d(dtype=real)
    ):
        """With a material frame: as if the angles were held."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        before, after = row_before(i, loop), row_after(i, loop)
        w0, w1 = load3(stretch, 0, before, j), load3(stretch, 0, i, j)
        block = outer(w0, w0) + outer(w1, w1) + isotropic(load1(stretch, 3, before, j) + load1(stretch, 3, i, j))
        for k in range(strains):
            end, middle, start = slope(slopes, k, 1, before, j), slope(slopes, k, 0, i, j), slope(slopes, k, -1, after, j)
            block = block + (outer(end, end) + outer(middle, middle) + outer(start, start))
        add6(blocks_out, 0, i, j, block)

    @wp.func
    def store_rows(
        stretch: wp.array3d(dtype=real),
        slopes: wp.array3d(dtype=real),
        spins: wp.array3d(dtype=real),
        held: wp.array3d(dtype=real),
        before: int,
        far_before: int,
        i: int,
        j: int,
        c: int,
        row: int,
        band: wp.array3d(dtype=real),
    ):
        """Couplings of component c of a node with the two nodes before it, and with the angles that stand there."""
        w, tension = load3(stretch, 0, before, j), load1(stretch, 3, before, j)
        x, y, z = splat(zero), splat(zero), splat(zero)
        if c == 0:
            x = tension
        if c == 1:
            y = tension
        if c == 2:
            z = tension
        far, near = V(), V() - scale(w[c], w) - vector(x, y, z)
        far_angle, near_angle = splat(zero), splat(zero)
        for k in range(strains):
            end, middle = slope(slopes, k, 1, before, j), slope(slopes, k, 0, i, j)
            far = far + scale(end[c], slope(slopes, k, -1, before, j))
            near = near + scale(end[c], slope(slopes, k, 0, before, j)) + scale(middle[c], slope(slopes, k, -1, i, j))
            if wp.static(strains == 3):
                far_angle = far_angle + mul(end[c], load1(spins, 2 * k, before, j))
                near_angle = near_angle + mul(end[c], load1(spins, 2 * k + 1, before, j))
                near_angle = near_angle + mul(middle[c], load1(spins, 2 * k, i, j))
        store3(band, row, i, j, far)
        store3(band, row + d, i, j, near)
        if wp.static(strains == 3):
            store1(band, row + 3, i, j, mul(splat(one) - load1(held, 0, far_before, j), far_angle))
            store1(band, row + d + 3, i, j, mul(splat(one) - load1(held, 0, before, j), near_angle))

    @wp.kernel(module=module)
    def band_nodes(
        loop: int,
        stretch: wp.array3d(dtype=real),
        slopes: wp.array3d(dtype=real),
        spins: wp.array3d(dtype=real),
        held: wp.array3d(dtype=real),
        band_out: wp.array3d(dtype=real),
    ):
        """Everything but the 3 x 3 diagonal blocks; angles that are held have the row of the identity."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        before, after = row_before(i, loop), row_after(i, loop)
        far_before = row_before(before, loop)
        store_rows(stretch, slopes, spins, held, before, far_before, i, j, 0, row0, band_out)
        store_rows(stretch, slopes, spins, held, before, far_before, i, j, 1, row1, band_out)
        store_rows(stretch, slopes, spins, held, before, far_before, i, j, 2, row2, band_out)
        if wp.static(strains == 3):
            near, own, near_angle, own_angle = V(), V(), splat(zero), splat(zero)
            for k in range(strains):
                a, b, start = load1(spins, 2 * k, i, j), load1(spins, 2 * k + 1, i, j), load1(spins, 2 * k, after, j)
                near = near + scale(b, slope(slopes, k, -1, i, j))
                own = own + scale(b, slope(slopes, k, 0, i, j)) + scale(start, slope(slopes, k, -1, after, j))
                near_angle = near_angle + mul(a, b)
                own_angle = own_angle + (mul(b, b) + mul(start, start))
            free = splat(one) - load1(held, 0, i, j)
            store3(band_out, row3 + d, i, j, scale(free, near))
            store1(band_out, row3 + d + 3, i, j, mul(mul(free, splat(one) - load1(held, 0, before, j)), near_angle))
            store3(band_out, row3 + 2 * d, i, j, scale(free, own))
            store1(band_out, row3 + 2 * d + 3, i, j, mul(free, own_angle) + load1(held, 0, i, j))

    return SimpleNamespace(module=module, block_nodes=block_nodes, band_nodes=band_nodes)
