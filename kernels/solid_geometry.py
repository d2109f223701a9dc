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
        orthogonal: K has twenty-one entries, which multiply q as it is; else it has sixteen, those of Hooke's law in a
            chart, and edges count by t q.
    """
    words = lanes(width, real)
    L, V = words.L, words.V
    load1, load3, dot3, mul = words.load1, words.load3, words.dot3, words.mul
    half, two = real(0.5), real(2.0)

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
    def edge_weights(
        share: wp.array3d(dtype=real), t: wp.array3d(dtype=real),
        axis: int, i: int, j: int, bi: int, bj: int, ci: int, cj: int,
    ):  # fmt: skip
        """What q of the four edges along an axis is multiplied with; the other axes have the steps b and c."""
        if wp.static(orthogonal):
            h = load1(share, 0, i, j)
            return h, h, h, h
        else:
            return (
                load1(t, axis, i, j),
                load1(t, axis, i + bi, j + bj),
                load1(t, axis, i + ci, j + cj),
                load1(t, axis, i + bi + ci, j + bj + cj),
            )

    @wp.func
    def face_weights(share: wp.array3d(dtype=real), K: wp.array3d(dtype=real), i: int, j: int, ii: int, jj: int):
        """The same for the faces 12, 13, 23; (ii, jj) is where K is."""
        if wp.static(orthogonal):
            h = load1(share, 0, i, j)
            return h, h, h
        else:
            return load1(K, 6, ii, jj), load1(K, 7, ii, jj), load1(K, 8, ii, jj)

    @wp.func
    def back(weight: L, stress: L):
        """The stress that belongs to q; K of the orthogonal variant gives it right away."""
        if wp.static(orthogonal):
            return stress
        else:
            return mul(weight, stress)

    @wp.func
    def mean_stress(
        K: wp.array3d(dtype=real), space: real, i: int, j: int, e1: L, e2: L, e3: L, c12: L, c13: L, c23: L
    ):
        """Stresses of the sums of extensions and of shears."""
        if wp.static(orthogonal):
            k12, k13, k23 = load1(K, 1, i, j), load1(K, 2, i, j), load1(K, 4, i, j)
            return (
                mul(load1(K, 0, i, j), e1) + mul(k12, e2) + mul(k13, e3),
                mul(k12, e1) + mul(load1(K, 3, i, j), e2) + mul(k23, e3),
                mul(k13, e1) + mul(k23, e2) + mul(load1(K, 5, i, j), e3),
                mul(load1(K, 15, i, j), c12),
                mul(load1(K, 16, i, j), c13),
                mul(load1(K, 17, i, j), c23),
            )
        else:
            # s = space (h : e) h + h e h, where h is the inverse metric times a factor; a = h e + space (h : e).
            h11, h12, h13 = load1(K, 0, i, j), load1(K, 1, i, j), load1(K, 2, i, j)
            h22, h23, h33 = load1(K, 3, i, j), load1(K, 4, i, j), load1(K, 5, i, j)
            a12, a13 = mul(h11, c12) + mul(h12, e2) + mul(h13, c23), mul(h11, c13) + mul(h12, c23) + mul(h13, e3)
            a21, a23 = mul(h12, e1) + mul(h22, c12) + mul(h23, c13), mul(h12, c13) + mul(h22, c23) + mul(h23, e3)
            a31, a32 = mul(h13, e1) + mul(h23, c12) + mul(h33, c13), mul(h13, c12) + mul(h23, e2) + mul(h33, c23)
            b11, b22 = mul(h11, e1) + mul(h12, c12) + mul(h13, c13), mul(h12, c12) + mul(h22, e2) + mul(h23, c23)
            b33 = mul(h13, c13) + mul(h23, c23) + mul(h33, e3)
            pressure = space * (b11 + b22 + b33)
            a11, a22, a33 = b11 + pressure, b22 + pressure, b33 + pressure
            return (
                mul(a11, h11) + mul(a12, h12) + mul(a13, h13),
                mul(a21, h12) + mul(a22, h22) + mul(a23, h23),
                mul(a31, h13) + mul(a32, h23) + mul(a33, h33),
                two * (mul(a11, h12) + mul(a12, h22) + mul(a13, h23)),
                two * (mul(a11, h13) + mul(a12, h23) + mul(a13, h33)),
                two * (mul(a21, h13) + mul(a22, h23) + mul(a23, h33)),
            )

    @wp.func
    def plane_stress(
        K: wp.array3d(dtype=real), plane: real, i: int, j: int, first: int, second: int, pair: int, e1: L, e2: L, c: L
    ):  # fmt: skip
        """Stresses of what varies along one axis, of the strains of the two others, `first` and `second`.

        `pair` is their place among 12, 13, 23.
        """
        if wp.static(orthogonal):
            k12 = load1(K, 9 + pair, i, j)
            return (
                mul(load1(K, 6 + first, i, j), e1) + mul(k12, e2),
                mul(k12, e1) + mul(load1(K, 6 + second, i, j), e2),
                mul(load1(K, 18 + pair, i, j), c),
            )
        else:
            # The same law as `mean_stress`, in two dimensions and with the metric (1, cosine; cosine, 1).
            cosine, m = load1(K, 9 + pair, i, j), load1(K, 12 + pair, i, j)
            a12, a21 = mul(m, c - mul(cosine, e2)), mul(m, c - mul(cosine, e1))
            b11, b22 = mul(m, e1 - mul(cosine, c)), mul(m, e2 - mul(cosine, c))
            pressure = plane * (b11 + b22)
            a11, a22 = b11 + pressure, b22 + pressure
            return a11 - mul(cosine, a12), a22 - mul(cosine, a21), two * (a12 - mul(cosine, a11))

    @wp.func
    def cross_stress(K: wp.array3d(dtype=real), axis: int, i: int, j: int, x: L):
        """Stress of the cross mode of the edges along an axis."""
        if wp.static(orthogonal):
            return mul(load1(K, 12 + axis, i, j), x)
        else:
            return mul(load1(K, 15, i, j), x)

    @wp.func
    def stress(
        share: wp.array3d(dtype=real), K: wp.array3d(dtype=real), t: wp.array3d(dtype=real),
        space: real, plane: real, each: int, i: int, j: int, u: int,
        u00: L, u10: L, u01: L, u11: L, v00: L, v10: L, v01: L, v11: L, w00: L, w10: L, w01: L, w11: L,
        uv0: L, uv1: L, uw0: L, uw1: L, vw0: L, vw1: L,
    ):  # fmt: skip
        """Stresses of the edges and faces of a cell; `each` is 1 where cells have coefficients of their own, else 0."""
        ii, jj = i * each, j * each
        tu00, tu10, tu01, tu11 = edge_weights(share, t, 0, i, j, 1, 0, 0, 1)
        tv00, tv10, tv01, tv11 = edge_weights(share, t, 1, i, j, u, 0, 0, 1)
        tw00, tw10, tw01, tw11 = edge_weights(share, t, 2, i, j, u, 0, 1, 0)
        n12, n13, n23 = face_weights(share, K, i, j, ii, jj)
        # Sums, slopes along the two other axes, cross modes; b12 is the slope of e1 along axis 2.
        e1, b12, b13, x1 = modes(mul(tu00, u00), mul(tu10, u10), mul(tu01, u01), mul(tu11, u11))
        e2, b21, b23, x2 = modes(mul(tv00, v00), mul(tv10, v10), mul(tv01, v01), mul(tv11, v11))
        e3, b31, b32, x3 = modes(mul(tw00, w00), mul(tw10, w10), mul(tw01, w01), mul(tw11, w11))
        c12, d12 = mul(n12, uv0 + uv1), mul(n12, uv1 - uv0)
        c13, d13 = mul(n13, uw0 + uw1), mul(n13, uw1 - uw0)
        c23, d23 = mul(n23, vw0 + vw1), mul(n23, vw1 - vw0)
        s1, s2, s3, s12, s13, s23 = mean_stress(K, space, ii, jj, e1, e2, e3, c12, c13, c23)
        p13, p23, q12 = plane_stress(K, plane, ii, jj, 0, 1, 0, b13, b23, d12)
        p12, p32, q13 = plane_stress(K, plane, ii, jj, 0, 2, 1, b12, b32, d13)
        p21, p31, q23 = plane_stress(K, plane, ii, jj, 1, 2, 2, b21, b31, d23)
        su00, su10, su01, su11 = edges_of_modes(s1, p12, p13, cross_stress(K, 0, ii, jj, x1))
        sv00, sv10, sv01, sv11 = edges_of_modes(s2, p21, p23, cross_stress(K, 1, ii, jj, x2))
        sw00, sw10, sw01, sw11 = edges_of_modes(s3, p31, p32, cross_stress(K, 2, ii, jj, x3))
        return (
            back(tu00, su00), back(tu10, su10), back(tu01, su01), back(tu11, su11),
            back(tv00, sv00), back(tv10, sv10), back(tv01, sv01), back(tv11, sv11),
            back(tw00, sw00), back(tw10, sw10), back(tw01, sw01), back(tw11, sw11),
            back(n12, s12 - q12), back(n12, s12 + q12), back(n13, s13 - q13), back(n13, s13 + q13),
            back(n23, s23 - q23), back(n23, s23 + q23),
        )  # fmt: skip

    return SimpleNamespace(
        numbers=numbers,
        strains=strains,
        mean_stress=mean_stress,
        plane_stress=plane_stress,
        cross_stress=cross_stress,
        face_weights=face_weights,
        back=back,
        stress=stress,
    )
