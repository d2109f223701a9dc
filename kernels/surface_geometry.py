"""Words of the surface kernels: differences across a cell, tangents at a node, normals and Christoffel symbols.

The formulas are those of :mod:`warpdeform.kernels.surface`.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import lanes


@functools.cache
def geometry(width: int, real: Any, orthogonal: bool) -> SimpleNamespace:
    """Device functions for one lane width, precision and kind of chart.

    Args:
        width: Lane width.
        real: ``wp.float32`` or ``wp.float64``.
        orthogonal: K has only the entries ss, st, tt, cc, uu = vv, uv (six components); else its upper triangle, row by
            row (fifteen components).
    """
    words = lanes(width, real)
    L, V = words.L, words.V
    load1, load3, store1, along_u = words.load1, words.load3, words.store1, words.along_u
    dot3, cross3, scale, mul, div = words.dot3, words.cross3, words.scale, words.mul, words.div
    root, at_least, splat = words.root, words.at_least, words.splat
    half, one = real(0.5), real(1.0)

    @wp.func
    def diagonals(r: wp.array3d(dtype=real), i: int, j: int):
        """D, E and x of the cell at (i, j)."""
        r00, r10 = load3(r, 0, i, j), load3(r, 0, i + 1, j)
        r01, r11 = load3(r, 0, i, j + 1), load3(r, 0, i + 1, j + 1)
        return r11 - r00, r10 - r01, (r11 - r10) - (r01 - r00)

    @wp.func
    def stress(K: wp.array3d(dtype=real), i: int, j: int, s: L, t: L, c: L, u: L, v: L):
        """K times (s, t, c, u, v)."""
        if wp.static(orthogonal):
            k01, k33, k34 = load1(K, 1, i, j), load1(K, 4, i, j), load1(K, 5, i, j)
            return (
                mul(load1(K, 0, i, j), s) + mul(k01, t),
                mul(k01, s) + mul(load1(K, 2, i, j), t),
                mul(load1(K, 3, i, j), c),
                mul(k33, u) + mul(k34, v),
                mul(k34, u) + mul(k33, v),
            )
        else:
            k01, k02, k03, k04 = load1(K, 1, i, j), load1(K, 2, i, j), load1(K, 3, i, j), load1(K, 4, i, j)
            k12, k13, k14 = load1(K, 6, i, j), load1(K, 7, i, j), load1(K, 8, i, j)
            k23, k24, k34 = load1(K, 10, i, j), load1(K, 11, i, j), load1(K, 13, i, j)
            return (
                mul(load1(K, 0, i, j), s) + mul(k01, t) + mul(k02, c) + mul(k03, u) + mul(k04, v),
                mul(k01, s) + mul(load1(K, 5, i, j), t) + mul(k12, c) + mul(k13, u) + mul(k14, v),
                mul(k02, s) + mul(k12, t) + mul(load1(K, 9, i, j), c) + mul(k23, u) + mul(k24, v),
                mul(k03, s) + mul(k13, t) + mul(k23, c) + mul(load1(K, 12, i, j), u) + mul(k34, v),
                mul(k04, s) + mul(k14, t) + mul(k24, c) + mul(k34, u) + mul(load1(K, 14, i, j), v),
            )

    @wp.func
    def cell_flux(d: V, e: V, x: V, ss: L, st: L, sc: L, su: L, sv: L):
        """Derivatives of a cell's energy by D, E and x, or their changes with the changes of its stresses."""
        return (
            scale(ss + sc, d) + scale(st, e) + scale(su, x),
            scale(ss - sc, e) + scale(st, d) + scale(sv, x),
            scale(ss, x) + scale(su, d) + scale(sv, e),
        )

    @wp.func
    def strains(d: V, e: V, x: V, q0: wp.array3d(dtype=real), i: int, j: int):
        """q - q0."""
        dd, ee, xx = dot3(d, d), dot3(e, e), dot3(x, x)
        return (
            half * (dd + ee + xx) - load1(q0, 0, i, j),
            dot3(d, e) - load1(q0, 1, i, j),
            half * (dd - ee) - load1(q0, 2, i, j),
            dot3(d, x) - load1(q0, 3, i, j),
            dot3(e, x) - load1(q0, 4, i, j),
        )

    @wp.func
    def inverse_metric(r1: V, r2: V, floor: real):
        """G^11, G^12, G^22 of two tangents; |r1 x r2|^2 is kept above `floor`, so that folded cells stay finite."""
        g11, g12, g22 = dot3(r1, r1), dot3(r1, r2), dot3(r2, r2)
        inverse = div(splat(one), at_least(mul(g11, g22) - mul(g12, g12), floor))
        return mul(inverse, g22), (-one) * mul(inverse, g12), mul(inverse, g11)

    @wp.func
    def unit_normal(r1: V, r2: V, floor: real):
        a = cross3(r1, r2)
        return scale(div(splat(one), root(at_least(dot3(a, a), floor))), a)

    @wp.func
    def christoffel(r1: V, r2: V, s: V, floor: real):
        """Gamma^1, Gamma^2 of the second difference s."""
        h11, h12, h22 = inverse_metric(r1, r2, floor)
        d1, d2 = dot3(r1, s), dot3(r2, s)
        return mul(h11, d1) + mul(h12, d2), mul(h12, d1) + mul(h22, d2)

    @wp.func
    def tangent_u(r: wp.array3d(dtype=real), alpha_u: wp.array3d(dtype=real), i: int, j: int):
        r0 = load3(r, 0, i, j)
        return scale(along_u(alpha_u, 0, i), load3(r, 0, i + 1, j) - r0) + scale(
            along_u(alpha_u, 1, i), r0 - load3(r, 0, i - 1, j)
        )

    @wp.func
    def tangent_v(r: wp.array3d(dtype=real), alpha_v: wp.array3d(dtype=real), i: int, j: int):
        r0 = load3(r, 0, i, j)
        return scale(load1(alpha_v, 0, 0, j), load3(r, 0, i, j + 1) - r0) + scale(
            load1(alpha_v, 1, 0, j), r0 - load3(r, 0, i, j - 1)
        )

    @wp.func
    def second_u(r: wp.array3d(dtype=real), i: int, j: int):
        r0 = load3(r, 0, i, j)
        return (load3(r, 0, i + 1, j) - r0) - (r0 - load3(r, 0, i - 1, j))

    @wp.func
    def second_v(r: wp.array3d(dtype=real), i: int, j: int):
        r0 = load3(r, 0, i, j)
        return (load3(r, 0, i, j + 1) - r0) - (r0 - load3(r, 0, i, j - 1))

    @wp.func
    def flexed(
        flexure: wp.array3d(dtype=real),
        alpha_u: wp.array3d(dtype=real),
        alpha_v: wp.array3d(dtype=real),
        p: wp.array3d(dtype=real),
        i: int,
        j: int,
    ):
        """Changes of b11 and b22 under the displacement p, linearised."""
        n, p0 = load3(flexure, 0, i, j), load3(p, 0, i, j)
        # Components along n of the differences to the four neighbours.
        up, um = dot3(n, load3(p, 0, i + 1, j) - p0), dot3(n, p0 - load3(p, 0, i - 1, j))
        vp, vm = dot3(n, load3(p, 0, i, j + 1) - p0), dot3(n, p0 - load3(p, 0, i, j - 1))
        d1 = mul(along_u(alpha_u, 0, i), up) + mul(along_u(alpha_u, 1, i), um)
        d2 = mul(load1(alpha_v, 0, 0, j), vp) + mul(load1(alpha_v, 1, 0, j), vm)
        return (
            (up - um) - mul(load1(flexure, 3, i, j), d1) - mul(load1(flexure, 4, i, j), d2),
            (vp - vm) - mul(load1(flexure, 5, i, j), d1) - mul(load1(flexure, 6, i, j), d2),
        )

    @wp.func
    def store_scatter(
        scatter: wp.array3d(dtype=real),
        alpha_u: wp.array3d(dtype=real),
        alpha_v: wp.array3d(dtype=real),
        i: int,
        j: int,
        moment1: L,
        moment2: L,
        g1: L,
        g2: L,
    ):
        store1(scatter, 0, i, j, moment1 - mul(g1, along_u(alpha_u, 0, i)))
        store1(scatter, 1, i, j, moment1 + mul(g1, along_u(alpha_u, 1, i)))
        store1(scatter, 2, i, j, moment2 - mul(g2, load1(alpha_v, 0, 0, j)))
        store1(scatter, 3, i, j, moment2 + mul(g2, load1(alpha_v, 1, 0, j)))

    return SimpleNamespace(
        diagonals=diagonals,
        stress=stress,
        cell_flux=cell_flux,
        strains=strains,
        unit_normal=unit_normal,
        christoffel=christoffel,
        tangent_u=tangent_u,
        tangent_v=tangent_v,
        second_u=second_u,
        second_v=second_v,
        flexed=flexed,
        store_scatter=store_scatter,
    )
