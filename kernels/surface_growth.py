"""Surfaces whose rest shape changes: their coefficients and rest numbers from those of the shape that they start with.

The rest lengths along u and v are a and b times those at the start, with a = 1 + w (a_t - 1), b likewise: a_t, b_t hold
for the body at a time, w is the share that a place takes in it. G0 = diag(a, b) G0_start diag(a, b), so that

    squared lengths of u-edges and v-edges, m1.m2:    A1 -> a^2 A1,   A2 -> b^2 A2,   c -> a b c
    K, of energies over the area a b A of squared strains, A1 over a^2 A1 and so on:    K -> a b P K P

where P = diag(1/a^2, 1/b^2, 1/(a b)) over (A1, A2, c), likewise over their half-differences. Over q, of which s and t
are A1 + A2 and A1 - A2, P mixes s with t and u with v: p = (1/a^2 + 1/b^2)/2 and d = (1/a^2 - 1/b^2)/2.

Lines of the surface keep the angles by which they turn as they grow, and may be given curvatures kappa on top of it:

    b11 -> a b11 + w kappa_11 a^2 g11,   b22 -> b b22 + w kappa_22 b^2 g22,   b12 -> (a b)^1/2 b12 + w kappa_12 a b g12

with the squares g of what b divides by to be a curvature. K of b11, b22, b12 grows by the factors f_i f_j, where
f = (a b)^1/2 (1/a^2, 1/b^2, 1/(a b)): all of them are 1/s^2 where a = b = s, as bending a shell of one thickness to one
radius costs the same per area at any size. Mixed entries take f of either place, so that K stays positive.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes

# Entries of `rest`: what holds for the body.
SCALE_U = wp.constant(0)
SCALE_V = wp.constant(1)
KAPPA_U = wp.constant(2)
KAPPA_V = wp.constant(3)
KAPPA_TWIST = wp.constant(4)
REST_ENTRIES = 5
"""Numbers of `rest`: a_t, b_t, kappa_11, kappa_22, kappa_12 [1/m]."""


@functools.cache
def surface_growth(width: int, real: Any, orthogonal: bool) -> SimpleNamespace:
    """Kernels for one lane width, precision and kind of chart.

    Threads begin at row 0 and column 0, in the halo, which is kept in step with the rest of an array. `share` holds w
    at the cells or at the nodes, shape (1, rows, columns).

    Args:
        width: Lane width.
        real: ``wp.float32`` or ``wp.float64``.
        orthogonal: K has six entries, else fifteen (:mod:`warpdeform.kernels.surface`).
    """
    words = lanes(width, real)
    L = words.L
    load1, store1, mul, div, root, splat = (
        words.load1, words.store1, words.mul, words.div, words.root, words.splat,
    )  # fmt: skip
    half, one = real(0.5), real(1.0)
    module = kernel_module(f"surface_growth_{'orthogonal' if orthogonal else 'general'}", width, real)

    @wp.func
    def scales(rest: wp.array(dtype=real), share: wp.array3d(dtype=real), i: int, j: int):
        """a and b at a place."""
        w = load1(share, 0, i, j)
        return splat(one) + (rest[SCALE_U] - one) * w, splat(one) + (rest[SCALE_V] - one) * w

    @wp.func
    def mixed(p: L, d: L, x: L, y: L):
        return mul(p, x) + mul(d, y), mul(d, x) + mul(p, y)

    @wp.func
    def mixed_block(p: L, d: L, xx: L, xy: L, yy: L):
        """Upper triangle of a symmetric 2 x 2 matrix between two matrices with p on the diagonal and d beside it."""
        xx1, yx1 = mixed(p, d, xx, xy)
        xy1, yy1 = mixed(p, d, xy, yy)
        xx2, xy2 = mixed(p, d, xx1, xy1)
        return xx2, xy2, mul(d, yx1) + mul(p, yy1)

    @wp.kernel(module=module)
    def grow_membrane(
        rest: wp.array(dtype=real),
        share: wp.array3d(dtype=real),
        K: wp.array3d(dtype=real),
        K_out: wp.array3d(dtype=real),
    ):
        i, group = wp.tid()
        j = group * width
        a, b = scales(rest, share, i, j)
        area = mul(a, b)
        over_aa, over_bb, over_ab = div(splat(one), mul(a, a)), div(splat(one), mul(b, b)), div(splat(one), area)
        p, d = half * (over_aa + over_bb), half * (over_aa - over_bb)
        if wp.static(orthogonal):
            ss, st, tt = mixed_block(p, d, load1(K, 0, i, j), load1(K, 1, i, j), load1(K, 2, i, j))
            uu, uv, vv = mixed_block(p, d, load1(K, 4, i, j), load1(K, 5, i, j), load1(K, 4, i, j))
            store1(K_out, 0, i, j, mul(area, ss))
            store1(K_out, 1, i, j, mul(area, st))
            store1(K_out, 2, i, j, mul(area, tt))
            store1(K_out, 3, i, j, mul(over_ab, load1(K, 3, i, j)))
            store1(K_out, 4, i, j, mul(area, uu))
            store1(K_out, 5, i, j, mul(area, uv))
        else:
            ss, st, tt = mixed_block(p, d, load1(K, 0, i, j), load1(K, 1, i, j), load1(K, 5, i, j))
            uu, uv, vv = mixed_block(p, d, load1(K, 12, i, j), load1(K, 13, i, j), load1(K, 14, i, j))
            sc, tc = mixed(p, d, load1(K, 2, i, j), load1(K, 6, i, j))
            cu, cv = mixed(p, d, load1(K, 10, i, j), load1(K, 11, i, j))
            su1, tu1 = mixed(p, d, load1(K, 3, i, j), load1(K, 7, i, j))
            sv1, tv1 = mixed(p, d, load1(K, 4, i, j), load1(K, 8, i, j))
            su, sv = mixed(p, d, su1, sv1)
            tu, tv = mixed(p, d, tu1, tv1)
            store1(K_out, 0, i, j, mul(area, ss))
            store1(K_out, 1, i, j, mul(area, st))
            store1(K_out, 2, i, j, sc)
            store1(K_out, 3, i, j, mul(area, su))
            store1(K_out, 4, i, j, mul(area, sv))
            store1(K_out, 5, i, j, mul(area, tt))
            store1(K_out, 6, i, j, tc)
            store1(K_out, 7, i, j, mul(area, tu))
            store1(K_out, 8, i, j, mul(area, tv))
            store1(K_out, 9, i, j, mul(over_ab, load1(K, 9, i, j)))
            store1(K_out, 10, i, j, cu)
            store1(K_out, 11, i, j, cv)
            store1(K_out, 12, i, j, mul(area, uu))
            store1(K_out, 13, i, j, mul(area, uv))
            store1(K_out, 14, i, j, mul(area, vv))

    @wp.kernel(module=module)
    def grow_strains(
        rest: wp.array(dtype=real),
        share: wp.array3d(dtype=real),
        q0: wp.array3d(dtype=real),
        q0_out: wp.array3d(dtype=real),
    ):
        i, group = wp.tid()
        j = group * width
        a, b = scales(rest, share, i, j)
        p, d = half * (mul(a, a) + mul(b, b)), half * (mul(a, a) - mul(b, b))
        s, t = mixed(p, d, load1(q0, 0, i, j), load1(q0, 1, i, j))
        u, v = mixed(p, d, load1(q0, 3, i, j), load1(q0, 4, i, j))
        store1(q0_out, 0, i, j, s)
        store1(q0_out, 1, i, j, t)
        store1(q0_out, 2, i, j, mul(mul(a, b), load1(q0, 2, i, j)))
        store1(q0_out, 3, i, j, u)
        store1(q0_out, 4, i, j, v)

    @wp.func
    def factors(a: L, b: L):
        """f of b11 and b22."""
        middle = root(mul(a, b))
        return div(middle, mul(a, a)), div(middle, mul(b, b))

    @wp.kernel(module=module)
    def grow_bending(
        rest: wp.array(dtype=real),
        share: wp.array3d(dtype=real),
        KB: wp.array3d(dtype=real),
        KB_out: wp.array3d(dtype=real),
    ):
        """At the nodes."""
        i, group = wp.tid()
        j = group * width
        a, b = scales(rest, share, i, j)
        f11, f22 = factors(a, b)
        store1(KB_out, 0, i, j, mul(mul(f11, f11), load1(KB, 0, i, j)))
        store1(KB_out, 1, i, j, mul(mul(f11, f22), load1(KB, 1, i, j)))
        store1(KB_out, 2, i, j, mul(mul(f22, f22), load1(KB, 2, i, j)))

    @wp.kernel(module=module)
    def grow_twist(
        rest: wp.array(dtype=real),
        share: wp.array3d(dtype=real),
        K12: wp.array3d(dtype=real),
        K12_out: wp.array3d(dtype=real),
    ):
        """At the cells."""
        i, group = wp.tid()
        j = group * width
        a, b = scales(rest, share, i, j)
        store1(K12_out, 0, i, j, div(load1(K12, 0, i, j), mul(a, b)))

    @wp.func
    def grow_corner(
        rest: wp.array(dtype=real),
        share_nodes: wp.array3d(dtype=real),
        KC: wp.array3d(dtype=real),
        KC_out: wp.array3d(dtype=real),
        f12: L,
        corner: int,
        i: int,
        j: int,
        di: int,
        dj: int,
    ):
        a, b = scales(rest, share_nodes, i + di, j + dj)
        f11, f22 = factors(a, b)
        store1(KC_out, corner, i, j, mul(mul(f12, f11), load1(KC, corner, i, j)))
        store1(KC_out, 4 + corner, i, j, mul(mul(f12, f22), load1(KC, 4 + corner, i, j)))

    @wp.kernel(module=module)
    def grow_coupling(
        rest: wp.array(dtype=real),
        share_cells: wp.array3d(dtype=real),
        share_nodes: wp.array3d(dtype=real),
        KC: wp.array3d(dtype=real),
        KC_out: wp.array3d(dtype=real),
    ):
        """At the cells, which read the nodes of their corners: without the last row and lane group."""
        i, group = wp.tid()
        j = group * width
        a, b = scales(rest, share_cells, i, j)
        f12 = div(splat(one), root(mul(a, b)))
        grow_corner(rest, share_nodes, KC, KC_out, f12, 0, i, j, 0, 0)
        grow_corner(rest, share_nodes, KC, KC_out, f12, 1, i, j, 1, 0)
        grow_corner(rest, share_nodes, KC, KC_out, f12, 2, i, j, 0, 1)
        grow_corner(rest, share_nodes, KC, KC_out, f12, 3, i, j, 1, 1)

    @wp.kernel(module=module)
    def grow_curvature(
        rest: wp.array(dtype=real),
        share_cells: wp.array3d(dtype=real),
        share_nodes: wp.array3d(dtype=real),
        steps: wp.array3d(dtype=real),
        b0: wp.array3d(dtype=real),
        b0_out: wp.array3d(dtype=real),
    ):
        """b11 and b22 at the nodes, b12 at the cells; `steps` holds their g [m2], shape (3, rows, columns)."""
        i, group = wp.tid()
        j = group * width
        a, b = scales(rest, share_nodes, i, j)
        w = load1(share_nodes, 0, i, j)
        bent_u = mul(mul(w, mul(a, a)), load1(steps, 0, i, j))
        bent_v = mul(mul(w, mul(b, b)), load1(steps, 1, i, j))
        store1(b0_out, 0, i, j, mul(a, load1(b0, 0, i, j)) + rest[KAPPA_U] * bent_u)
        store1(b0_out, 1, i, j, mul(b, load1(b0, 1, i, j)) + rest[KAPPA_V] * bent_v)
        a, b = scales(rest, share_cells, i, j)
        area = mul(a, b)
        twisted = mul(mul(load1(share_cells, 0, i, j), area), load1(steps, 2, i, j))
        store1(b0_out, 2, i, j, mul(root(area), load1(b0, 2, i, j)) + rest[KAPPA_TWIST] * twisted)

    return SimpleNamespace(
        module=module,
        grow_membrane=grow_membrane,
        grow_strains=grow_strains,
        grow_bending=grow_bending,
        grow_twist=grow_twist,
        grow_coupling=grow_coupling,
        grow_curvature=grow_curvature,
    )
