"""Words of the curve kernels: edges, the curvature binormal at a node and its derivatives, parallel transport.

Segment i, from node i to node i + 1, and node i with its edges a (segment i - 1) and b (segment i) share row i.
The formulas are those of :mod:`warpdeform.kernels.curve`.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import lanes

FOLD = 1.0e-6
"""What keeps the curvature of a node finite when its edges turn back on each other, as a part of |a||b|.

It changes the curvature binormal by a relative FOLD / (1 + cos phi); its largest value is sqrt(2 / FOLD).
"""


@functools.cache
def curve_geometry(width: int, real: Any) -> SimpleNamespace:
    """Device functions for one lane width and precision."""
    words = lanes(width, real)
    L, V = words.L, words.V
    load1, load3, store1, store3 = words.load1, words.load3, words.store1, words.store3
    dot3, cross3, scale, mul, div = words.dot3, words.cross3, words.scale, words.mul, words.div
    root, at_least, splat = words.root, words.at_least, words.splat
    zero, half, one, two, fold, tiny = real(0.0), real(0.5), real(1.0), real(2.0), real(FOLD), real(1.0e-30)

    @wp.func
    def row_before(i: int, loop: int):
        """Row of the node before that of row i; `loop` is the number of nodes of a closed curve, 0 of an open one."""
        return wp.where(i == 1, loop, wp.max(i - 1, 0))

    @wp.func
    def row_after(i: int, loop: int):
        return wp.where(i == loop, 1, i + 1)

    @wp.func
    def edges(r: wp.array3d(dtype=real), loop: int, i: int, j: int):
        """Edges a and b that end and begin at a node."""
        r0 = load3(r, 0, i, j)
        return r0 - load3(r, 0, row_before(i, loop), j), load3(r, 0, row_after(i, loop), j) - r0

    @wp.func
    def length(a: V, floor: real):
        """|a|, kept above the root of `floor`, so that segments without length stay finite."""
        return root(at_least(dot3(a, a), floor))

    @wp.func
    def unit3(a: V, floor: real):
        return scale(div(splat(one), length(a, floor)), a)

    @wp.func
    def spread(a: V, b: V, la: L, lb: L):
        """1 / ((1 + fold) |a||b| + a.b)."""
        return div(splat(one), at_least((one + fold) * mul(la, lb) + dot3(a, b), tiny))

    @wp.func
    def binormal(a: V, b: V, inverse: L):
        """Curvature binormal kb; `inverse` is what `spread` gives."""
        return scale(two * inverse, cross3(a, b))

    @wp.func
    def without_fold(inverse: L, la: L, lb: L):
        """What takes kb to 2 a x b / (|a||b| + a.b): the derivative of parallel transport from a to b has no fold."""
        return div(splat(one), at_least(splat(one) - fold * mul(inverse, mul(la, lb)), fold))

    @wp.func
    def binormal_slopes(a: V, b: V, la: L, lb: L, inverse: L, kb: V, d: V):
        """Derivatives of kb.d by a and b, for a constant vector d."""
        k = dot3(kb, d)
        ta, tb = scale(div(splat(one), la), a), scale(div(splat(one), lb), b)
        return (
            scale(inverse, two * cross3(b, d) - scale(mul(k, lb), (one + fold) * ta + tb)),
            scale(inverse, two * cross3(d, a) - scale(mul(k, la), ta + (one + fold) * tb)),
        )

    @wp.func
    def transported(d: V, t0: V, t1: V):
        """d, normal to the unit vector t0, turned by the smallest rotation that takes t0 to the unit vector t1."""
        return d - scale(div(dot3(d, t1), at_least(splat(one) + dot3(t0, t1), fold)), t0 + t1)

    @wp.func
    def store_stretch(
        stretch: wp.array3d(dtype=real), axial: wp.array3d(dtype=real), g0: wp.array3d(dtype=real), b: V, i: int, j: int
    ):
        """Stores the linearised stretch of the segment with edge b; returns its energy's derivative by b."""
        weight = load1(axial, 0, i, j)
        q, w = half * mul(weight, dot3(b, b) - load1(g0, 0, i, j)), scale(weight, b)
        store3(stretch, 0, i, j, w)
        store1(stretch, 3, i, j, at_least(mul(weight, q), zero))
        return scale(q, w)

    return SimpleNamespace(
        store_stretch=store_stretch,
        row_before=row_before,
        row_after=row_after,
        edges=edges,
        length=length,
        unit3=unit3,
        spread=spread,
        binormal=binormal,
        without_fold=without_fold,
        binormal_slopes=binormal_slopes,
        transported=transported,
    )
