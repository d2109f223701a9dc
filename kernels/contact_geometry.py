"""Closest points of a point and a triangle, and of two segments.

Both give the vector r from the closest point of the second to that of the first, and the weights of the corners. Where
the closest points lie inside, r is taken along the normal, so that its direction is right however short it is. Weights
of corners that a closest point does not lie between are exactly zero. The third corner of a triangle may be its second
(strands are made of such triangles); any other triangle of no area is taken as its edges.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

SLIVER = 1e-6
"""A triangle whose sides enclose an angle with a sine, squared, below it has no inside."""
PARALLEL = 1e-10
"""Edges that enclose an angle with a sine, squared, below it count as parallel."""


@functools.cache
def closest(real: Any) -> SimpleNamespace:
    """The functions for one precision.

    Returns:
        ``point_triangle(p, a, b, c)`` gives r and the weights of a, b, c; ``segment_segment(p, q, a, b)`` gives r and
        the shares s of the way from p to q and t from a to b.
    """
    V, V64 = wp.types.vector(3, real), wp.types.vector(3, wp.float64)
    zero, one, tiny = real(0.0), real(1.0), real(1e-30)

    @wp.func
    def share(q: V, d: V):
        """How far along d, from 0 to 1, the point closest to q lies."""
        return wp.clamp(wp.dot(q, d) / wp.max(wp.dot(d, d), tiny), zero, one)

    @wp.func
    def point_triangle(p: V, a: V, b: V, c: V):
        ab, ac, ap = b - a, c - a, p - a
        n = wp.cross(ab, ac)
        area = wp.dot(n, n)
        v, w = wp.dot(wp.cross(ap, ac), n), wp.dot(wp.cross(ab, ap), n)
        if v >= zero and w >= zero and v + w <= area and area > real(SLIVER) * wp.dot(ab, ab) * wp.dot(ac, ac):
            v, w = v / area, w / area
            return (wp.dot(ap, n) / area) * n, V(one - v - w, v, w)
        # The closest point of each edge, and the best of the three.
        t = share(ap, ab)
        r, weights = ap - t * ab, V(one - t, t, zero)
        t = share(ap, ac)
        other = ap - t * ac
        if wp.dot(other, other) < wp.dot(r, r):
            r, weights = other, V(one - t, zero, t)
        bc, bp = c - b, p - b
        t = share(bp, bc)
        other = bp - t * bc
        if wp.dot(other, other) < wp.dot(r, r):
            r, weights = other, V(zero, one - t, t)
        return r, weights

    @wp.func
    def share64(along: wp.float64, length: wp.float64):
        return wp.clamp(along / wp.max(length, wp.float64(1e-60)), wp.float64(0.0), wp.float64(1.0))

    @wp.func
    def narrow(a: V64):
        return V(real(a[0]), real(a[1]), real(a[2]))

    @wp.func
    def wide(a: V):
        return V64(wp.float64(a[0]), wp.float64(a[1]), wp.float64(a[2]))

    @wp.func
    def segment_segment(p: V, q: V, a: V, b: V):
        # In double precision: of all but parallel edges single precision leaves neither s and t nor the normal.
        d, e, r = wide(q - p), wide(b - a), wide(p - a)
        dd, ee, de, dr, er = wp.dot(d, d), wp.dot(e, e), wp.dot(d, e), wp.dot(d, r), wp.dot(e, r)
        determinant = dd * ee - de * de
        none, whole = wp.float64(0.0), wp.float64(1.0)
        if determinant > wp.float64(PARALLEL) * dd * ee:
            s, t = (de * er - ee * dr) / determinant, (dd * er - de * dr) / determinant
            if s > none and s < whole and t > none and t < whole:
                n = wp.cross(d, e)
                return narrow((wp.dot(r, n) / determinant) * n), real(s), real(t)
        # The best of the four ends, with the closest point of the other segment.
        s, t = none, share64(er, ee)
        best = r - t * e
        u = share64(er + de, ee)
        other = r + d - u * e
        if wp.dot(other, other) < wp.dot(best, best):
            s, t, best = whole, u, other
        u = share64(-dr, dd)
        other = r + u * d
        if wp.dot(other, other) < wp.dot(best, best):
            s, t, best = u, none, other
        u = share64(de - dr, dd)
        other = r - e + u * d
        if wp.dot(other, other) < wp.dot(best, best):
            s, t, best = u, whole, other
        return narrow(best), real(s), real(t)

    return SimpleNamespace(point_triangle=point_triangle, segment_segment=segment_segment)
