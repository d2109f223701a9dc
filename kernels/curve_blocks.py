"""Blocks of the projected Hessian of elastic curves: those on the diagonal, and the whole band of a strand.

Compiled only where a preconditioner asks for them. Formulas and coefficients are those of
:mod:`warpdeform.kernels.curve`; the layout of the band is that of :mod:`warpdeform.kernels.strand`. The band is summed
up in double precision, whatever the precision of the slopes: in single precision what stretches a strand would round
off what bends it, and the sum of squares would not be positive any more.
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
    load1, load3, add6 = words.load1, words.load3, words.add6
    outer, isotropic = words.outer, words.isotropic
    row_before, row_after = shape.row_before, shape.row_after
    double = lanes(width, wp.float64)
    D, add1, mul, scale, splat, vector = double.V, double.add1, double.mul, double.scale, double.splat, double.vector
    read1, read3 = words.read1, words.read3
    zero, one = wp.float64(0.0), wp.float64(1.0)
    d = 4 if strains == 3 else 3
    angle_row = band_row(d, 3)
    module = kernel_module(f"curve_blocks_{variant_name(strains)}", width, real)

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
            end, start = load3(slopes, 6 * k + 3, before, j), load3(slopes, 6 * k, after, j)
            middle = load3(slopes, 6 * k, i, j) - load3(slopes, 6 * k + 3, i, j)
            block = block + (outer(end, end) + outer(middle, middle) + outer(start, start))
        add6(blocks_out, 0, i, j, block)

    @wp.func
    def by_start(slopes: wp.array3d(dtype=real), k: int, i: int, j: int):
        """Derivative of strain k of a node by the node before it."""
        return D() - read3(slopes, 6 * k, i, j)

    @wp.func
    def by_middle(slopes: wp.array3d(dtype=real), k: int, i: int, j: int):
        """Derivative of strain k of a node by itself."""
        return read3(slopes, 6 * k, i, j) - read3(slopes, 6 * k + 3, i, j)

    @wp.func
    def by_end(slopes: wp.array3d(dtype=real), k: int, i: int, j: int):
        """Derivative of strain k of a node by the node after it."""
        return read3(slopes, 6 * k + 3, i, j)

    @wp.func
    def by_a(spins: wp.array3d(dtype=real), k: int, i: int, j: int):
        """Derivative of strain k of a node by the angle of its edge a; by that of edge b it is the spin itself."""
        spin = read1(spins, k, i, j)
        if k == 2:
            spin = splat(zero) - spin
        return spin

    @wp.func
    def tensed(stretch: wp.array3d(dtype=real), i: int, j: int, c: int):
        """Row c of the block of a segment."""
        w, tension = read3(stretch, 0, i, j), read1(stretch, 3, i, j)
        x, y, z = splat(zero), splat(zero), splat(zero)
        if c == 0:
            x = tension
        if c == 1:
            y = tension
        if c == 2:
            z = tension
        return scale(w[c], w) + vector(x, y, z)

    @wp.func
    def free_of(held: wp.array3d(dtype=real), i: int, j: int):
        return splat(one) - read1(held, 0, i, j)

    @wp.func
    def add_angle(
        slopes: wp.array3d(dtype=real),
        spins: wp.array3d(dtype=real),
        held: wp.array3d(dtype=real),
        before: int,
        i: int,
        after: int,
        j: int,
        band: wp.array3d(dtype=wp.float64),
    ):
        """The row of the angle of segment i, which node i has as that of its edge b, the next node as that of its a."""
        near, own, near_angle, own_angle = D(), D(), splat(zero), splat(zero)
        for k in range(strains):
            b, a_next = read1(spins, k, i, j), by_a(spins, k, after, j)
            near = near + scale(b, by_start(slopes, k, i, j))
            own = own + scale(b, by_middle(slopes, k, i, j)) + scale(a_next, by_start(slopes, k, after, j))
            near_angle = near_angle + mul(by_a(spins, k, i, j), b)
            own_angle = own_angle + (mul(b, b) + mul(a_next, a_next))
        free = free_of(held, i, j)
        for m in range(3):
            add1(band, angle_row + d + m, i, j, mul(free, near[m]))
            add1(band, angle_row + 2 * d + m, i, j, mul(free, own[m]))
        add1(band, angle_row + d + 3, i, j, mul(mul(free, free_of(held, before, j)), near_angle))
        add1(band, angle_row + 2 * d + 3, i, j, mul(free, own_angle) + read1(held, 0, i, j))

    @wp.kernel(module=module)
    def band_nodes(
        loop: int,
        stretch: wp.array3d(dtype=real),
        slopes: wp.array3d(dtype=real),
        spins: wp.array3d(dtype=real),
        held: wp.array3d(dtype=real),
        band_out: wp.array3d(dtype=wp.float64),
    ):
        """Angles that are held have the rows of the identity."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        before, after = row_before(i, loop), row_after(i, loop)
        for c in range(3):
            row = (2 * d) * c + (c * (c + 1)) // 2
            own, far = tensed(stretch, before, j, c), D()
            near = D() - own
            own = own + tensed(stretch, i, j, c)
            far_angle, near_angle = splat(zero), splat(zero)
            for k in range(strains):
                end, middle, start = by_end(slopes, k, before, j), by_middle(slopes, k, i, j), by_start(slopes, k, after, j)
                far = far + scale(end[c], by_start(slopes, k, before, j))
                near = near + scale(end[c], by_middle(slopes, k, before, j))
                near = near + scale(middle[c], by_start(slopes, k, i, j))
                own = own + (scale(end[c], end) + scale(middle[c], middle) + scale(start[c], start))
                if wp.static(strains == 3):
                    far_angle = far_angle + mul(end[c], by_a(spins, k, before, j))
                    near_angle = near_angle + mul(end[c], read1(spins, k, before, j))
                    near_angle = near_angle + mul(middle[c], by_a(spins, k, i, j))
            for m in range(3):
                add1(band_out, row + m, i, j, far[m])
                add1(band_out, row + d + m, i, j, near[m])
                if m <= c:
                    add1(band_out, row + 2 * d + m, i, j, own[m])
            if wp.static(strains == 3):
                far_before = row_before(before, loop)
                add1(band_out, row + 3, i, j, mul(free_of(held, far_before, j), far_angle))
                add1(band_out, row + d + 3, i, j, mul(free_of(held, before, j), near_angle))
        if wp.static(strains == 3):
            add_angle(slopes, spins, held, before, i, after, j, band_out)

    return SimpleNamespace(module=module, block_nodes=block_nodes, band_nodes=band_nodes)
