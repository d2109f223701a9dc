"""Closest points of a point and a triangle, and of two segments, in every lane and without a branch.

Both return the vector r from the closest point of the second to that of the first, and the weights of the corners. The
closest points lie on the simplices whatever rounding does to their weights, so that |r| is never below the distance.
A triangle of a curve has its second and third corner in one place; any other degenerate triangle is taken as its edges.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import lanes

SLIVER = 1e-8
"""A triangle whose sine of an angle, squared, is below it has no inside."""


@functools.cache
def closest(width: int, real: Any) -> SimpleNamespace:
    """The functions for one lane width and precision.

    Returns:
        ``point_triangle(p, a, b, c)`` gives r and the weights of a, b, c as a vector; weights of corners that the
        closest point does not lie between are exactly zero. ``segment_segment(p, q, a, b)`` gives r and the shares s
        of the way from p to q and t from a to b.
    """
    words = lanes(width, real)
    V, L, vector, splat, mul, div = words.V, words.L, words.vector, words.splat, words.mul, words.div
    dot3, cross3, scale, at_least = words.dot3, words.cross3, words.scale, words.at_least
    least, most, where1, where3 = words.least, words.most, words.where1, words.where3
    zero, one, tiny = real(0.0), real(1.0), real(1e-30)

    @wp.func
    def share(q: V, d: V):
        """How far along d, from 0 to 1, the point closest to q lies."""
        return most(splat(zero), least(splat(one), div(dot3(q, d), at_least(dot3(d, d), tiny))))

    @wp.func
    def one_minus(a: L):
        return splat(one) - a

    @wp.func
    def point_triangle(p: V, a: V, b: V, c: V):
        ab, ac, ap = b - a, c - a, p - a
        bc, bp = c - b, p - b
        # The closest point of each edge, and the best of the three.
        t_ab, t_ac, t_bc = share(ap, ab), share(ap, ac), share(bp, bc)
        r_ab, r_ac, r_bc = ap - scale(t_ab, ab), ap - scale(t_ac, ac), bp - scale(t_bc, bc)
        d_ab, d_ac, d_bc = dot3(r_ab, r_ab), dot3(r_ac, r_ac), dot3(r_bc, r_bc)
        r = where3(d_ab - d_ac, r_ac, r_ab)
        nothing = splat(zero)
        weights = where3(d_ab - d_ac, vector(one_minus(t_ac), nothing, t_ac), vector(one_minus(t_ab), t_ab, nothing))
        best = least(d_ab, d_ac)
        r = where3(best - d_bc, r_bc, r)
        weights = where3(best - d_bc, vector(nothing, one_minus(t_bc), t_bc), weights)
        # The inside, where p lies over it.
        n = cross3(ab, ac)
        area = dot3(n, n)
        inverse = div(splat(one), at_least(area, tiny))
        v = mul(dot3(cross3(ap, ac), n), inverse)
        w = mul(dot3(cross3(ab, ap), n), inverse)
        u = splat(one) - v - w
        inside = least(u, least(v, w))
        full = area - real(SLIVER) * mul(dot3(ab, ab), dot3(ac, ac))
        inside = least(inside, full)
        r = where3(inside, scale(mul(dot3(ap, n), inverse), n), r)
        weights = where3(inside, vector(u, v, w), weights)
        return r, weights

    @wp.func
    def segment_segment(p: V, q: V, a: V, b: V):
        d, e, r = q - p, b - a, p - a
        # The best of the four ends, with the closest point of the other segment.
        t_p, t_q, s_a, s_b = share(r, e), share(q - a, e), share(a - p, d), share(b - p, d)
        r_p, r_q, r_a, r_b = r - scale(t_p, e), q - a - scale(t_q, e), scale(s_a, d) + r, scale(s_b, d) + (p - b)
        d_p, d_q, d_a, d_b = dot3(r_p, r_p), dot3(r_q, r_q), dot3(r_a, r_a), dot3(r_b, r_b)
        shortest = least(least(d_p, d_q), least(d_a, d_b))
        floor, ceiling = splat(zero), splat(one)
        q_wins = d_p - d_q
        s, t, best = where1(q_wins, ceiling, floor), where1(q_wins, t_q, t_p), least(d_p, d_q)
        closest = where3(q_wins, r_q, r_p)
        b_wins = d_a - d_b
        first_wins = least(d_a, d_b) - best
        s, t = where1(first_wins, s, where1(b_wins, s_b, s_a)), where1(first_wins, t, where1(b_wins, ceiling, floor))
        closest = where3(first_wins, closest, where3(b_wins, r_b, r_a))
        # Or both inside, where that is shorter; along the common normal, which is exact however near they are.
        dd, ee, de, dr, er = dot3(d, d), dot3(e, e), dot3(d, e), dot3(d, r), dot3(e, r)
        determinant = mul(dd, ee) - mul(de, de)
        inverse = div(splat(one), at_least(determinant, tiny))
        s_in, t_in = mul(mul(de, er) - mul(ee, dr), inverse), mul(mul(dd, er) - mul(de, dr), inverse)
        inside = least(least(s_in, one_minus(s_in)), least(t_in, one_minus(t_in)))
        normal = cross3(d, e)
        r_in = scale(mul(dot3(r, normal), inverse), normal)
        inside = least(inside, shortest - dot3(r_in, r_in))
        closest = where3(inside, r_in, closest)
        return closest, where1(inside, s_in, s), where1(inside, t_in, t)

    return SimpleNamespace(point_triangle=point_triangle, segment_segment=segment_segment, share=share)
