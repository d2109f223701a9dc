"""Words of the solid kernels: the springs of a cell, their modes, and Hooke's law between them.

The formulas are those of :mod:`warpdeform.kernels.solid`.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import lanes


@functools.cache
def solid_geometry(width: int, real: Any, orthogonal: bool) -> SimpleNamespace:
    """Device functions for one lane width, precision and kind of chart.

    Args:
        width: Lane width.
        real: ``wp.float32`` or ``wp.float64``.
        orthogonal: The law is diagonal but for the mean extensions (eighteen coefficients); else it is Hooke's in a
            chart (thirteen per cell, three per node, and `ratio`).
    """
    words = lanes(width, real)
    L, V = words.L, words.V
    load1, load3, dot3, mul = words.load1, words.load3, words.dot3, words.mul
    third, half, two = real(1.0 / 3.0), real(0.5), real(2.0)

    @wp.func
    def along(r0: V, r1: V, p0: V, p1: V):
        """e.p of an edge."""
        return dot3(r1 - r0, p1 - p0)

    @wp.func
    def across(r00: V, r10: V, r01: V, r11: V, p00: V, p10: V, p01: V, p11: V):
        """D.p - E.p of the diagonals of a face."""
        return dot3(r11 - r00, p11 - p00) - dot3(r10 - r01, p10 - p01)

    @wp.func
    def numbers(r: wp.array3d(dtype=real), p: wp.array3d(dtype=real), i: int, j: int, u: int):
        """e.p of the twelve edges of a cell and D.p - E.p of its six faces, in the order of its stresses."""
        r000, r100 = load3(r, 0, i, j), load3(r, 0, i + u, j)
        r010, r110 = load3(r, 0, i + 1, j), load3(r, 0, i + u + 1, j)
        r001, r101 = load3(r, 0, i, j + 1), load3(r, 0, i + u, j + 1)
        r011, r111 = load3(r, 0, i + 1, j + 1), load3(r, 0, i + u + 1, j + 1)
        p000, p100 = load3(p, 0, i, j), load3(p, 0, i + u, j)
        p010, p110 = load3(p, 0, i + 1, j), load3(p, 0, i + u + 1, j)
        p001, p101 = load3(p, 0, i, j + 1), load3(p, 0, i + u, j + 1)
        p011, p111 = load3(p, 0, i + 1, j + 1), load3(p, 0, i + u + 1, j + 1)
        return (
            along(r000, r100, p000, p100),
            along(r010, r110, p010, p110),
            along(r001, r101, p001, p101),
            along(r011, r111, p011, p111),
            along(r000, r010, p000, p010),
            along(r100, r110, p100, p110),
            along(r001, r011, p001, p011),
            along(r101, r111, p101, p111),
            along(r000, r001, p000, p001),
            along(r100, r101, p100, p101),
            along(r010, r011, p010, p011),
            along(r110, r111, p110, p111),
            across(r000, r100, r010, r110, p000, p100, p010, p110),
            across(r001, r101, r011, r111, p001, p101, p011, p111),
            across(r000, r100, r001, r101, p000, p100, p001, p101),
            across(r010, r110, r011, r111, p010, p110, p011, p111),
            across(r000, r010, r001, r011, p000, p010, p001, p011),
            across(r100, r110, r101, r111, p100, p110, p101, p111),
        )

    @wp.func
    def strains(r: wp.array3d(dtype=real), q0: wp.array3d(dtype=real), i: int, j: int, u: int):
        """q of a cell since rest, in the order of its stresses."""
        (
            u00, u10, u01, u11, v00, v10, v01, v11, w00, w10, w01, w11, uv0, uv1, uw0, uw1, vw0, vw1,
        ) = numbers(r, r, i, j, u)  # fmt: skip
        return (
            half * u00 - load1(q0, 0, i, j),
            half * u10 - load1(q0, 0, i + 1, j),
            half * u01 - load1(q0, 0, i, j + 1),
            half * u11 - load1(q0, 0, i + 1, j + 1),
            half * v00 - load1(q0, 1, i, j),
            half * v10 - load1(q0, 1, i + u, j),
            half * v01 - load1(q0, 1, i, j + 1),
            half * v11 - load1(q0, 1, i + u, j + 1),
            half * w00 - load1(q0, 2, i, j),
            half * w10 - load1(q0, 2, i + u, j),
            half * w01 - load1(q0, 2, i + 1, j),
            half * w11 - load1(q0, 2, i + u + 1, j),
            half * uv0 - load1(q0, 3, i, j),
            half * uv1 - load1(q0, 3, i, j + 1),
            half * uw0 - load1(q0, 4, i, j),
            half * uw1 - load1(q0, 4, i + 1, j),
            half * vw0 - load1(q0, 5, i, j),
            half * vw1 - load1(q0, 5, i + u, j),
        )

    @wp.func
    def modes(e00: L, e10: L, e01: L, e11: L):
        """Sum, slope along either index, and cross mode of four edges."""
        low, high, rise, climb = e00 + e10, e01 + e11, e10 - e00, e11 - e01
        return low + high, rise + climb, high - low, climb - rise

    @wp.func
    def edges_of_modes(s: L, a: L, b: L, x: L):
        """The transpose of `modes`: what the edges get of stresses that belong to modes."""
        low, high, less, more = s - b, s + b, a - x, a + x
        return low - less, low + less, high - more, high + more

    @wp.func
    def mean_stress(K: wp.array3d(dtype=real), ratio: real, i: int, j: int, e1: L, e2: L, e3: L, c12: L, c13: L, c23: L):
        """Stresses of the sums of extensions and of shears."""
        if wp.static(orthogonal):
            k12, k13, k23 = load1(K, 1, i, j), load1(K, 2, i, j), load1(K, 4, i, j)
            return (
                mul(load1(K, 0, i, j), e1) + mul(k12, e2) + mul(k13, e3),
                mul(k12, e1) + mul(load1(K, 3, i, j), e2) + mul(k23, e3),
                mul(k13, e1) + mul(k23, e2) + mul(load1(K, 5, i, j), e3),
                mul(load1(K, 12, i, j), c12),
                mul(load1(K, 13, i, j), c13),
                mul(load1(K, 14, i, j), c23),
            )
        else:
            # ratio (h : e) h + h e h, h the inverse metric times a factor.
            h11, h12, h13 = load1(K, 0, i, j), load1(K, 1, i, j), load1(K, 2, i, j)
            h22, h23, h33 = load1(K, 3, i, j), load1(K, 4, i, j), load1(K, 5, i, j)
            a11, a12 = mul(h11, e1) + mul(h12, c12) + mul(h13, c13), mul(h11, c12) + mul(h12, e2) + mul(h13, c23)
            a13, a21 = mul(h11, c13) + mul(h12, c23) + mul(h13, e3), mul(h12, e1) + mul(h22, c12) + mul(h23, c13)
            a22, a23 = mul(h12, c12) + mul(h22, e2) + mul(h23, c23), mul(h12, c13) + mul(h22, c23) + mul(h23, e3)
            a31, a32 = mul(h13, e1) + mul(h23, c12) + mul(h33, c13), mul(h13, c12) + mul(h23, e2) + mul(h33, c23)
            a33 = mul(h13, c13) + mul(h23, c23) + mul(h33, e3)
            pressure = ratio * (a11 + a22 + a33)
            return (
                mul(a11 + pressure, h11) + mul(a12, h12) + mul(a13, h13),
                mul(a21, h12) + mul(a22 + pressure, h22) + mul(a23, h23),
                mul(a31, h13) + mul(a32, h23) + mul(a33 + pressure, h33),
                two * (mul(a11 + pressure, h12) + mul(a12, h22) + mul(a13, h23)),
                two * (mul(a11 + pressure, h13) + mul(a12, h23) + mul(a13, h33)),
                two * (mul(a21, h13) + mul(a22 + pressure, h23) + mul(a23, h33)),
            )

    @wp.func
    def stress(
        share: wp.array3d(dtype=real), K: wp.array3d(dtype=real), t: wp.array3d(dtype=real), ratio: real, each: int,
        i: int, j: int, u: int,
        u00: L, u10: L, u01: L, u11: L, v00: L, v10: L, v01: L, v11: L, w00: L, w10: L, w01: L, w11: L,
        uv0: L, uv1: L, uw0: L, uw1: L, vw0: L, vw1: L,
    ):  # fmt: skip
        """Stresses of the edges and faces of a cell; `each` is 1 where cells have coefficients of their own, else 0."""
        ii, jj = i * each, j * each
        if wp.static(orthogonal):
            h = load1(share, 0, i, j)
            e1, b12, b13, x1 = modes(mul(h, u00), mul(h, u10), mul(h, u01), mul(h, u11))
            e2, b21, b23, x2 = modes(mul(h, v00), mul(h, v10), mul(h, v01), mul(h, v11))
            e3, b31, b32, x3 = modes(mul(h, w00), mul(h, w10), mul(h, w01), mul(h, w11))
            c12, c13, c23 = mul(h, uv0 + uv1), mul(h, uw0 + uw1), mul(h, vw0 + vw1)
            d12, d13, d23 = mul(h, uv1 - uv0), mul(h, uw1 - uw0), mul(h, vw1 - vw0)
            s1, s2, s3, p12, p13, p23 = mean_stress(K, ratio, ii, jj, e1, e2, e3, c12, c13, c23)
            k1, k2, k3 = load1(K, 6, ii, jj), load1(K, 7, ii, jj), load1(K, 8, ii, jj)
            su00, su10, su01, su11 = edges_of_modes(s1, mul(k1, b12), mul(k1, b13), mul(load1(K, 9, ii, jj), x1))
            sv00, sv10, sv01, sv11 = edges_of_modes(s2, mul(k2, b21), mul(k2, b23), mul(load1(K, 10, ii, jj), x2))
            sw00, sw10, sw01, sw11 = edges_of_modes(s3, mul(k3, b31), mul(k3, b32), mul(load1(K, 11, ii, jj), x3))
            q12, q13, q23 = mul(load1(K, 15, ii, jj), d12), mul(load1(K, 16, ii, jj), d13), mul(load1(K, 17, ii, jj), d23)
            return (
                su00, su10, su01, su11, sv00, sv10, sv01, sv11, sw00, sw10, sw01, sw11,
                p12 - q12, p12 + q12, p13 - q13, p13 + q13, p23 - q23, p23 + q23,
            )  # fmt: skip
        else:
            tu00, tu10, tu01, tu11 = load1(t, 0, i, j), load1(t, 0, i + 1, j), load1(t, 0, i, j + 1), load1(t, 0, i + 1, j + 1)
            tv00, tv10, tv01, tv11 = load1(t, 1, i, j), load1(t, 1, i + u, j), load1(t, 1, i, j + 1), load1(t, 1, i + u, j + 1)
            tw00, tw10, tw01, tw11 = load1(t, 2, i, j), load1(t, 2, i + u, j), load1(t, 2, i + 1, j), load1(t, 2, i + u + 1, j)
            n12, n13, n23 = load1(K, 6, ii, jj), load1(K, 7, ii, jj), load1(K, 8, ii, jj)
            e1, b12, b13, x1 = modes(mul(tu00, u00), mul(tu10, u10), mul(tu01, u01), mul(tu11, u11))
            e2, b21, b23, x2 = modes(mul(tv00, v00), mul(tv10, v10), mul(tv01, v01), mul(tv11, v11))
            e3, b31, b32, x3 = modes(mul(tw00, w00), mul(tw10, w10), mul(tw01, w01), mul(tw11, w11))
            c12, c13, c23 = mul(n12, uv0 + uv1), mul(n13, uw0 + uw1), mul(n23, vw0 + vw1)
            d12, d13, d23 = mul(n12, uv1 - uv0), mul(n13, uw1 - uw0), mul(n23, vw1 - vw0)
            s1, s2, s3, p12, p13, p23 = mean_stress(K, ratio, ii, jj, e1, e2, e3, c12, c13, c23)
            k = load1(K, 12, ii, jj)
            x = third * k
            su00, su10, su01, su11 = edges_of_modes(s1, mul(k, b12), mul(k, b13), mul(x, x1))
            sv00, sv10, sv01, sv11 = edges_of_modes(s2, mul(k, b21), mul(k, b23), mul(x, x2))
            sw00, sw10, sw01, sw11 = edges_of_modes(s3, mul(k, b31), mul(k, b32), mul(x, x3))
            q12, q13, q23 = mul(load1(K, 9, ii, jj), d12), mul(load1(K, 10, ii, jj), d13), mul(load1(K, 11, ii, jj), d23)
            return (
                mul(tu00, su00), mul(tu10, su10), mul(tu01, su01), mul(tu11, su11),
                mul(tv00, sv00), mul(tv10, sv10), mul(tv01, sv01), mul(tv11, sv11),
                mul(tw00, sw00), mul(tw10, sw10), mul(tw01, sw01), mul(tw11, sw11),
                mul(n12, p12 - q12), mul(n12, p12 + q12), mul(n13, p13 - q13), mul(n13, p13 + q13),
                mul(n23, p23 - q23), mul(n23, p23 + q23),
            )  # fmt: skip

    return SimpleNamespace(numbers=numbers, strains=strains, mean_stress=mean_stress, stress=stress)
