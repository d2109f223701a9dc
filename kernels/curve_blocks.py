"""Blocks of the projected Hessian of elastic curves: those on the diagonal, and the whole band of a strand.

Compiled only where a preconditioner asks for them. Formulas and coefficients are those of
:mod:`warpdeform.kernels.curve`; the band lies as :mod:`warpdeform.kernels.strand_words` tells. It is summed up in
double precision, whatever the precision of the slopes: in single precision what stretches a strand would round off what
bends it, and the sum of squares would not be positive any more.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.curve import variant_name
from warpdeform.kernels.curve_geometry import curve_geometry
from warpdeform.kernels.lanes import kernel_module, lanes
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
)


@functools.cache
def curve_blocks(width: int, real: Any, strains: int) -> SimpleNamespace:
    """Kernels ``block_nodes``, ``band_nodes`` and, with frames, ``band_angles``.

    Arguments as for :func:`warpdeform.kernels.curve.curve`.
    """
    words, shape = lanes(width, real), curve_geometry(width, real)
    load1, load3, add6 = words.load1, words.load3, words.add6
    outer_real, isotropic_real = words.outer, words.isotropic
    row_before, row_after = shape.row_before, shape.row_after
    double = lanes(width, wp.float64)
    D, mul, scale, splat = double.V, double.mul, double.scale, double.splat
    store1, store3, store6 = double.store1, double.store3, double.store6
    outer, isotropic, vector = double.outer, double.isotropic, double.vector
    read1, read3 = words.read1, words.read3
    zero, one = wp.float64(0.0), wp.float64(1.0)
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
        block = (
            outer_real(w0, w0)
            + outer_real(w1, w1)
            + isotropic_real(load1(stretch, 3, before, j) + load1(stretch, 3, i, j))
        )
        for k in range(strains):
            end, start = load3(slopes, 6 * k + 3, before, j), load3(slopes, 6 * k, after, j)
            middle = load3(slopes, 6 * k, i, j) - load3(slopes, 6 * k + 3, i, j)
            block = block + (outer_real(end, end) + outer_real(middle, middle) + outer_real(start, start))
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
    def free_of(held: wp.array3d(dtype=real), i: int, j: int):
        return splat(one) - read1(held, 0, i, j)

    @wp.kernel(module=module)
    def band_nodes(
        loop: int,
        stretch: wp.array3d(dtype=real),
        slopes: wp.array3d(dtype=real),
        free: wp.array3d(dtype=real),
        band_out: wp.array3d(dtype=wp.float64),
    ):
        """The positions; pinned nodes are coupled with nothing."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        before, after = row_before(i, loop), row_after(i, loop)
        w0, w1 = read3(stretch, 0, before, j), read3(stretch, 0, i, j)
        s0, s1 = read1(stretch, 3, before, j), read1(stretch, 3, i, j)
        own = outer(w0, w0) + outer(w1, w1) + isotropic(s0 + s1)
        minus = D() - w0
        none = splat(zero)
        near0 = scale(w0[0], minus) - vector(s0, none, none)
        near1 = scale(w0[1], minus) - vector(none, s0, none)
        near2 = scale(w0[2], minus) - vector(none, none, s0)
        far0, far1, far2 = D(), D(), D()
        for k in range(strains):
            end, middle, start = by_end(slopes, k, before, j), by_middle(slopes, k, i, j), by_start(slopes, k, after, j)
            own = own + (outer(end, end) + outer(middle, middle) + outer(start, start))
            x = by_middle(slopes, k, before, j)
            y = by_start(slopes, k, i, j)
            near0 = near0 + (scale(end[0], x) + scale(middle[0], y))
            near1 = near1 + (scale(end[1], x) + scale(middle[1], y))
            near2 = near2 + (scale(end[2], x) + scale(middle[2], y))
            x = by_start(slopes, k, before, j)
            far0 = far0 + scale(end[0], x)
            far1 = far1 + scale(end[1], x)
            far2 = far2 + scale(end[2], x)
        f = read1(free, 0, i, j)
        f1 = mul(f, read1(free, 0, before, j))
        f2 = mul(f, read1(free, 0, row_before(before, loop), j))
        store3(band_out, FAR, i, j, scale(f2, far0))
        store3(band_out, FAR + 3, i, j, scale(f2, far1))
        store3(band_out, FAR + 6, i, j, scale(f2, far2))
        store3(band_out, NEAR, i, j, scale(f1, near0))
        store3(band_out, NEAR + 3, i, j, scale(f1, near1))
        store3(band_out, NEAR + 6, i, j, scale(f1, near2))
        store6(band_out, OWN, i, j, own)

    @wp.kernel(module=module)
    def band_angles(
        loop: int,
        slopes: wp.array3d(dtype=real),
        spins: wp.array3d(dtype=real),
        held: wp.array3d(dtype=real),
        free: wp.array3d(dtype=real),
        band_out: wp.array3d(dtype=wp.float64),
    ):
        """The angles; those that are held have the rows and columns of the identity.

        Segment i is edge b of node i and edge a of the node after it.
        """
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        before, after = row_before(i, loop), row_after(i, loop)
        far, near, back, own = D(), D(), D(), D()
        both, single = splat(zero), splat(zero)
        for k in range(3):
            end, middle = by_end(slopes, k, before, j), by_middle(slopes, k, i, j)
            a, b, a_next = by_a(spins, k, i, j), read1(spins, k, i, j), by_a(spins, k, after, j)
            far = far + scale(by_a(spins, k, before, j), end)
            near = near + scale(read1(spins, k, before, j), end) + scale(a, middle)
            back = back + scale(b, by_start(slopes, k, i, j))
            own = own + scale(b, middle) + scale(a_next, by_start(slopes, k, after, j))
            both = both + mul(a, b)
            single = single + (mul(b, b) + mul(a_next, a_next))
        f, g, g1 = read1(free, 0, i, j), free_of(held, i, j), free_of(held, before, j)
        store3(band_out, FAR_ANGLE, i, j, scale(mul(f, free_of(held, row_before(before, loop), j)), far))
        store3(band_out, NEAR_ANGLE, i, j, scale(mul(f, g1), near))
        store3(band_out, ANGLE_NEAR, i, j, scale(mul(g, read1(free, 0, before, j)), back))
        store3(band_out, ANGLE_OWN, i, j, scale(mul(g, f), own))
        store1(band_out, ANGLE_ANGLE, i, j, mul(mul(g, g1), both))
        store1(band_out, ANGLE, i, j, mul(g, single) + splat(one) - g)

    kernels = {"block_nodes": block_nodes, "band_nodes": band_nodes}
    if strains == 3:
        kernels["band_angles"] = band_angles
    return SimpleNamespace(module=module, **kernels)
