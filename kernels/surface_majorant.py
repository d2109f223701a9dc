"""A number per node that bounds the Hessian of an elastic surface: p' H p <= sum over nodes of r |p|^2.

Cells. Of its corners' displacements a cell sees D, E and x, orthogonal combinations of them, so that the sum of their
squares is at least |D|^2/2 + |E|^2/2 + |x|^2/4. Each corner gets the largest eigenvalue of the cell's Hessian in that
measure. For the strains it is bounded by the root of the largest column sum of P^2, P = J S J' K with their derivatives
J by (D, E, x) and S = (2, 2, 4); for the tensions by the larger of both blocks; for the twist by the trace.

Nodes. A change e = sum c_i n.p_i of a curvature has e^2 <= (sum |c_j|) sum |c_i| |p_i|^2.

So cells of one shape get what their stiffest uniform strain asks for, 1 + nu times the largest eigenvalue of a sheet at
rest (Poisson's ratio nu); sums of diagonal blocks are twice as far above.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.surface import variant_name
from warpdeform.kernels.surface_geometry import geometry


@functools.cache
def surface_majorant(width: int, real: Any, orthogonal: bool, bending: bool) -> SimpleNamespace:
    """Kernels ``bound_cells`` and ``bound_nodes``; arguments as for :func:`warpdeform.kernels.surface.surface`."""
    words, shape = lanes(width, real), geometry(width, real, orthogonal)
    L, V = words.L, words.V
    load1, store1, add6, along_u = words.load1, words.store1, words.add6, words.along_u
    dot3, mul, root, at_least, splat, isotropic = (
        words.dot3, words.mul, words.root, words.at_least, words.splat, words.isotropic,
    )  # fmt: skip
    diagonals, stress, cell_forces = shape.diagonals, shape.stress, shape.cell_forces
    zero, one, two, four = real(0.0), real(1.0), real(2.0), real(4.0)
    module = kernel_module(f"surface_majorant_{variant_name(orthogonal, bending)}", width, real)

    @wp.func
    def magnitude(a: L):
        return at_least(a, zero) + at_least(splat(zero) - a, zero)

    @wp.func
    def larger(a: L, b: L):
        return b + at_least(a - b, zero)

    @wp.func
    def image(K: wp.array3d(dtype=real), i: int, j: int, d: V, e: V, x: V, s: L, t: L, c: L, u: L, v: L):
        """J S J' K (s, t, c, u, v)."""
        ss, st, sc, su, sv = stress(K, i, j, s, t, c, u, v)
        fd, fe, fx = cell_forces(d, e, x, ss, st, sc, su, sv)
        dd, ee = two * dot3(d, fd), two * dot3(e, fe)
        return (
            dd + ee + four * dot3(x, fx),
            two * (dot3(e, fd) + dot3(d, fe)),
            dd - ee,
            two * dot3(x, fd) + four * dot3(d, fx),
            two * dot3(x, fe) + four * dot3(e, fx),
        )

    @wp.func
    def column_sum(K: wp.array3d(dtype=real), i: int, j: int, d: V, e: V, x: V, s: L, t: L, c: L, u: L, v: L):
        """Magnitudes of (J S J' K)^2 (s, t, c, u, v)."""
        s1, t1, c1, u1, v1 = image(K, i, j, d, e, x, s, t, c, u, v)
        s2, t2, c2, u2, v2 = image(K, i, j, d, e, x, s1, t1, c1, u1, v1)
        return (magnitude(s2) + magnitude(t2)) + (magnitude(c2) + (magnitude(u2) + magnitude(v2)))

    @wp.kernel(module=module)
    def bound_cells(
        r: wp.array3d(dtype=real),
        K: wp.array3d(dtype=real),
        tension: wp.array3d(dtype=real),
        K12: wp.array3d(dtype=real),
        twist: wp.array3d(dtype=real),
        bound_out: wp.array3d(dtype=real),
    ):
        """What each corner of the cell gets."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d, e, x = diagonals(r, i, j)
        o, unit = splat(zero), splat(one)
        square = column_sum(K, i, j, d, e, x, unit, o, o, o, o)
        square = larger(square, column_sum(K, i, j, d, e, x, o, unit, o, o, o))
        square = larger(square, column_sum(K, i, j, d, e, x, o, o, unit, o, o))
        square = larger(square, column_sum(K, i, j, d, e, x, o, o, o, unit, o))
        square = larger(square, column_sum(K, i, j, d, e, x, o, o, o, o, unit))
        bound = root(square)
        across = larger(load1(tension, 0, i, j), load1(tension, 1, i, j)) + magnitude(load1(tension, 3, i, j))
        bound = bound + larger(two * across, four * load1(tension, 2, i, j))
        if wp.static(bending):
            gamma_d, gamma_e = load1(twist, 3, i, j), load1(twist, 4, i, j)
            length = two * (mul(gamma_d, gamma_d) + mul(gamma_e, gamma_e)) + splat(four)
            bound = bound + mul(load1(K12, 0, i, j), length)
        store1(bound_out, 0, i, j, bound)

    @wp.func
    def all_weights(first: L, last: L):
        """Magnitudes of the weights of three nodes in a tangent: 1 inside, 2 at a border."""
        return (first + last) + magnitude(first - last)

    @wp.func
    def flexure_bound(
        KB: wp.array3d(dtype=real),
        alpha_u: wp.array3d(dtype=real),
        alpha_v: wp.array3d(dtype=real),
        flexure: wp.array3d(dtype=real),
        i: int,
        j: int,
        s1: L,
        s2: L,
        a1: L,
        a2: L,
    ):
        """What a node gets that enters a sample's second differences with s1, s2 and its tangents with a1, a2."""
        g111, g211 = load1(flexure, 3, i, j), load1(flexure, 4, i, j)
        g122, g222 = load1(flexure, 5, i, j), load1(flexure, 6, i, j)
        tu = all_weights(along_u(alpha_u, 0, i), along_u(alpha_u, 1, i))
        tv = all_weights(load1(alpha_v, 0, 0, j), load1(alpha_v, 1, 0, j))
        # Those of a second difference add up to 4.
        all1 = splat(four) + (mul(magnitude(g111), tu) + mul(magnitude(g211), tv))
        all2 = splat(four) + (mul(magnitude(g122), tu) + mul(magnitude(g222), tv))
        c1 = magnitude(s1 - mul(g111, a1) - mul(g211, a2))
        c2 = magnitude(s2 - mul(g122, a1) - mul(g222, a2))
        k12 = magnitude(load1(KB, 1, i, j))
        bound = mul(load1(KB, 0, i, j) + k12, mul(all1, c1))
        return bound + mul(load1(KB, 2, i, j) + k12, mul(all2, c2))

    @wp.kernel(module=module)
    def bound_nodes(
        cells: wp.array3d(dtype=real),
        KB: wp.array3d(dtype=real),
        alpha_u: wp.array3d(dtype=real),
        alpha_v: wp.array3d(dtype=real),
        flexure: wp.array3d(dtype=real),
        blocks_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        bound = load1(cells, 0, i, j) + load1(cells, 0, i - 1, j)
        bound = bound + (load1(cells, 0, i, j - 1) + load1(cells, 0, i - 1, j - 1))
        if wp.static(bending):
            none, once, centre = splat(zero), splat(one), splat(-two)
            own1 = along_u(alpha_u, 1, i) - along_u(alpha_u, 0, i)
            own2 = load1(alpha_v, 1, 0, j) - load1(alpha_v, 0, 0, j)
            bound = bound + flexure_bound(KB, alpha_u, alpha_v, flexure, i, j, centre, centre, own1, own2)
            bound = bound + flexure_bound(
                KB, alpha_u, alpha_v, flexure, i - 1, j, once, none, along_u(alpha_u, 0, i - 1), none
            )
            bound = bound + flexure_bound(
                KB, alpha_u, alpha_v, flexure, i + 1, j, once, none, none - along_u(alpha_u, 1, i + 1), none
            )
            bound = bound + flexure_bound(
                KB, alpha_u, alpha_v, flexure, i, j - 1, none, once, none, load1(alpha_v, 0, 0, j - 1)
            )
            bound = bound + flexure_bound(
                KB, alpha_u, alpha_v, flexure, i, j + 1, none, once, none, none - load1(alpha_v, 1, 0, j + 1)
            )
        add6(blocks_out, 0, i, j, isotropic(bound))

    return SimpleNamespace(module=module, bound_cells=bound_cells, bound_nodes=bound_nodes)
