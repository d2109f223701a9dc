"""Words of the surface kernels: differences, strains and forces of a cell, tangents, normals, Christoffel symbols.

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
    root, at_least, splat, isotropic, symmetric = (
        words.root, words.at_least, words.splat, words.isotropic, words.symmetric,
    )  # fmt: skip
    zero, half, one = real(0.0), real(0.5), real(1.0)

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
    def numbers(d: V, e: V, x: V):
        """q."""
        dd, ee, xx = dot3(d, d), dot3(e, e), dot3(x, x)
        return half * (dd + ee + xx), dot3(d, e), half * (dd - ee), dot3(d, x), dot3(e, x)

    @wp.func
    def strains(d: V, e: V, x: V, q0: wp.array3d(dtype=real), i: int, j: int):
        """q - q0."""
        s, t, c, u, v = numbers(d, e, x)
        return (
            s - load1(q0, 0, i, j),
            t - load1(q0, 1, i, j),
            c - load1(q0, 2, i, j),
            u - load1(q0, 3, i, j),
            v - load1(q0, 4, i, j),
        )

    @wp.func
    def strain_changes(d: V, e: V, x: V, pd: V, pe: V, px: V):
        """q, linearised, under a displacement with the differences pd, pe, px."""
        dd, ee = dot3(d, pd), dot3(e, pe)
        return (
            (dd + ee) + dot3(x, px),
            dot3(d, pe) + dot3(e, pd),
            dd - ee,
            dot3(d, px) + dot3(x, pd),
            dot3(e, px) + dot3(x, pe),
        )

    @wp.func
    def cell_forces(d: V, e: V, x: V, ss: L, st: L, sc: L, su: L, sv: L):
        """Derivatives of the energy by D, E and x, from its derivatives by q."""
        fd = scale(ss + sc, d) + scale(st, e) + scale(su, x)
        fe = scale(ss - sc, e) + scale(st, d) + scale(sv, x)
        fx = scale(ss, x) + scale(su, d) + scale(sv, e)
        return fd, fe, fx

    @wp.func
    def store_tension(tension: wp.array3d(dtype=real), i: int, j: int, ss: L, st: L, sc: L):
        # dW by the mean squared length of the u-edges is ss + st, of the v-edges ss - st: their tensions.
        pull_u, pull_v = half * at_least(ss + st, zero), half * at_least(ss - st, zero)
        store1(tension, 0, i, j, (pull_u + pull_v) + at_least(sc, zero))
        store1(tension, 1, i, j, (pull_u + pull_v) + at_least(splat(zero) - sc, zero))
        store1(tension, 2, i, j, pull_u + pull_v)
        store1(tension, 3, i, j, pull_u - pull_v)

    @wp.func
    def tensed(tension: wp.array3d(dtype=real), i: int, j: int, fd: V, fe: V, fx: V, pd: V, pe: V, px: V):
        """fd, fe and fx, and on top of them the tension times pd, pe and px."""
        tde = load1(tension, 3, i, j)
        fd = fd + scale(load1(tension, 0, i, j), pd) + scale(tde, pe)
        fe = fe + scale(load1(tension, 1, i, j), pe) + scale(tde, pd)
        fx = fx + scale(load1(tension, 2, i, j), px)
        return fd, fe, fx

    @wp.func
    def block_column(
        K: wp.array3d(dtype=real), i: int, j: int, gs: V, gt: V, gc: V, gu: V, gv: V, s: L, t: L, c: L, u: L, v: L
    ):
        """Column of g' K g, where g are the gradients of the strains and (s, t, c, u, v) their components there."""
        ss, st, sc, su, sv = stress(K, i, j, s, t, c, u, v)
        return scale(ss, gs) + scale(st, gt) + scale(sc, gc) + (scale(su, gu) + scale(sv, gv))

    @wp.func
    def corner_block(
        K: wp.array3d(dtype=real),
        tension: wp.array3d(dtype=real),
        i: int,
        j: int,
        d: V,
        e: V,
        x: V,
        on_d: real,
        on_e: real,
        on_x: real,
    ):
        """Diagonal block of the corner whose motion dr gives dD = on_d dr, dE = on_e dr, dx = on_x dr (0, 1 or -1)."""
        gs = on_d * d + on_e * e + on_x * x
        gt, gc = on_e * d + on_d * e, on_d * d - on_e * e
        gu, gv = on_x * d + on_d * x, on_x * e + on_e * x
        block = isotropic(
            (on_d * on_d) * load1(tension, 0, i, j)
            + (on_e * on_e) * load1(tension, 1, i, j)
            + (on_x * on_x) * load1(tension, 2, i, j)
        )
        c0 = block_column(K, i, j, gs, gt, gc, gu, gv, gs[0], gt[0], gc[0], gu[0], gv[0])
        c1 = block_column(K, i, j, gs, gt, gc, gu, gv, gs[1], gt[1], gc[1], gu[1], gv[1])
        c2 = block_column(K, i, j, gs, gt, gc, gu, gv, gs[2], gt[2], gc[2], gu[2], gv[2])
        return block + symmetric(c0, c1, c2)

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
        numbers=numbers,
        strains=strains,
        strain_changes=strain_changes,
        cell_forces=cell_forces,
        store_tension=store_tension,
        tensed=tensed,
        corner_block=corner_block,
        unit_normal=unit_normal,
        christoffel=christoffel,
        tangent_u=tangent_u,
        tangent_v=tangent_v,
        second_u=second_u,
        second_v=second_v,
        flexed=flexed,
        store_scatter=store_scatter,
    )
