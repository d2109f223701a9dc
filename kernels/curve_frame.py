"""Material frames of curves: two curvatures and the twist of every node, with the angles eliminated (design 1.3).

The frame of a segment is made of its unit tangent t and two directors, the axes of its section. At the start of a step
it is known; from there it follows the iterate by parallel transport, in one go, and turns by an angle (Bergou et al.,
Discrete Elastic Rods, 2008, and Discrete Viscous Threads, 2010):

    u = transported director,  v = t x u,  director 1: cos(angle) u + sin(angle) v,  director 2: t x director 1

Node with edges a and b, kb as in :mod:`warpdeform.kernels.curve`:

    m = angle of b - angle of a + turning of u from a to b                      twist
    n_k = (director k of a turned by m/2 + director k of b turned by -m/2)/2    directors half way
    kappa_k = kb.n_k
    energy (EI_1 (kappa_1 - kappa0_1)^2 + EI_2 (kappa_2 - kappa0_2)^2 + GJ (m - m0)^2) / 2l

Bergou et al. take the mean of the directors without turning them half way, which makes kappa shorter by cos(m/2): twist
would free bending energy, even of a round section, and a sharply bent node would twist by itself. Here turning both
angles by the same changes kappa alone, and turning them apart the twist alone.

As squares of weighted strains q, R^2 = EI_1/l, EI_2/l, GJ/l. The angles are no unknowns of the solver: they have the
values of least energy wherever energy or forces are asked for, since they carry no inertia. So the gradient by the
positions is the partial derivative, and where the frames came from does not matter. Segments whose director is held
have the angle that brings it closest to a given direction; the gradient is exact where that is normal to the edge.

The Hessian is Gauss-Newton's of positions and angles together, with the angles eliminated (Schur complement). How they
are found is told in :mod:`warpdeform.kernels.curve_settle`.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.angles import angles
from warpdeform.kernels.curve_angles import angle_system
from warpdeform.kernels.curve_geometry import curve_geometry
from warpdeform.kernels.lanes import kernel_module, lanes

LEVER_COMPONENTS = 3
"""The strains of a node with both angles zero: kappa_1, kappa_2, turning of u."""


@functools.cache
def curve_frame(width: int, real: Any) -> SimpleNamespace:
    """Kernels of the material frames for one lane width and precision.

    Returns:
        Kernels ``carry_frames``, ``measure_levers``, ``stress``, ``energy``, ``measure_strains`` and ``accept_frames``.
    """
    words, shape, turns = lanes(width, real), curve_geometry(width, real), angles(width, real)
    system = angle_system(width, real)
    L, V = words.L, words.V
    load1, load3, store1, store3 = words.load1, words.load3, words.store1, words.store3
    dot3, cross3, scale, mul, div = words.dot3, words.cross3, words.scale, words.mul, words.div
    sum_lanes, splat = words.sum_lanes, words.splat
    row_before, row_after, edges = shape.row_before, shape.row_after, shape.edges
    length, unit3, spread, transported = shape.length, shape.unit3, shape.spread, shape.transported
    binormal, binormal_slopes, store_stretch = shape.binormal, shape.binormal_slopes, shape.store_stretch
    without_fold, cos_sin, angle_of = shape.without_fold, turns.cos_sin, turns.angle_of
    strains, weighted = system.strains, system.weighted
    half, quarter, one, tiny = real(0.5), real(0.25), real(1.0), real(1.0e-30)
    module = kernel_module("curve_frame", width, real)

    @wp.func
    def half_way(turning: L, ua: V, ub: V, ta: V, tb: V):
        """n_1 and n_2 with both angles zero."""
        c, s = cos_sin(half * turning)
        va, vb = cross3(ta, ua), cross3(tb, ub)
        c, s = half * c, half * s
        return scale(c, ua + ub) + scale(s, va - vb), scale(c, va + vb) - scale(s, ua - ub)

    @wp.kernel(module=module)
    def carry_frames(
        r: wp.array3d(dtype=real),
        loop: int,
        floor: real,
        tangent: wp.array3d(dtype=real),
        director: wp.array3d(dtype=real),
        held: wp.array3d(dtype=real),
        aim: wp.array3d(dtype=real),
        u_out: wp.array3d(dtype=real),
        angle_out: wp.array3d(dtype=real),
    ):
        """u of every segment, and the angles of those that are held."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        t = unit3(load3(r, 0, row_after(i, loop), j) - load3(r, 0, i, j), floor)
        u = transported(load3(director, 0, i, j), load3(tangent, 0, i, j), t)
        store3(u_out, 0, i, j, u)
        h, d = load1(held, 0, i, j), load3(aim, 0, i, j)
        d = unit3(d - scale(dot3(d, t), t), tiny)
        given = angle_of(dot3(d, u), dot3(d, cross3(t, u)))
        store1(angle_out, 0, i, j, mul(h, given) + mul(splat(one) - h, load1(angle_out, 0, i, j)))

    @wp.kernel(module=module)
    def measure_levers(
        r: wp.array3d(dtype=real),
        loop: int,
        floor: real,
        u: wp.array3d(dtype=real),
        twist_before: wp.array3d(dtype=real),
        lever_out: wp.array3d(dtype=real),
    ):
        """The turning counts on from the twist that the node had, so that it may exceed half a turn."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        a, b = edges(r, loop, i, j)
        ua, ub = load3(u, 0, row_before(i, loop), j), load3(u, 0, i, j)
        ta, tb = unit3(a, floor), unit3(b, floor)
        carried, before = transported(ua, ta, tb), load1(twist_before, 0, i, j)
        c, s = dot3(carried, ub), dot3(cross3(carried, ub), tb)
        c0, s0 = cos_sin(before)
        turning = before + angle_of(mul(c, c0) + mul(s, s0), mul(s, c0) - mul(c, s0))
        n1, n2 = half_way(turning, ua, ub, ta, tb)
        kb = binormal(a, b, spread(a, b, length(a, floor), length(b, floor)))
        store1(lever_out, 0, i, j, dot3(kb, n1))
        store1(lever_out, 1, i, j, dot3(kb, n2))
        store1(lever_out, 2, i, j, turning)

    @wp.kernel(module=module)
    def stress(
        r: wp.array3d(dtype=real),
        loop: int,
        axial: wp.array3d(dtype=real),
        g0: wp.array3d(dtype=real),
        weights: wp.array3d(dtype=real),
        natural: wp.array3d(dtype=real),
        floor: real,
        u: wp.array3d(dtype=real),
        lever: wp.array3d(dtype=real),
        angle: wp.array3d(dtype=real),
        stretch_out: wp.array3d(dtype=real),
        slopes_out: wp.array3d(dtype=real),
        spins_out: wp.array3d(dtype=real),
        flux_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        before = row_before(i, loop)
        a, b = edges(r, loop, i, j)
        fb = store_stretch(stretch_out, axial, g0, b, i, j)
        la, lb = length(a, floor), length(b, floor)
        inverse = spread(a, b, la, lb)
        kb = binormal(a, b, inverse)
        ta, tb = unit3(a, floor), unit3(b, floor)
        n1, n2 = half_way(load1(lever, 2, i, j), load3(u, 0, before, j), load3(u, 0, i, j), ta, tb)
        angle_a, angle_b = load1(angle, 0, before, j), load1(angle, 0, i, j)
        c, s = cos_sin(half * (angle_a + angle_b))
        k1, k2, m = strains(lever, angle_a, angle_b, i, j)
        q1, q2, q3 = weighted(weights, natural, k1, k2, m, i, j)
        w1, w2, w3 = load1(weights, 0, i, j), load1(weights, 1, i, j), load1(weights, 2, i, j)
        w1a, w1b = binormal_slopes(a, b, la, lb, inverse, kb, scale(w1, scale(c, n1) + scale(s, n2)))
        w2a, w2b = binormal_slopes(a, b, la, lb, inverse, kb, scale(w2, scale(c, n2) - scale(s, n1)))
        # u turns from a to b by kb/2 times the change of the tangents; without the fold in kb, which transport lacks.
        turning = scale(half * mul(w3, without_fold(inverse, la, lb)), kb)
        w3a, w3b = scale(div(splat(one), la), turning), scale(div(splat(one), lb), turning)
        store3(slopes_out, 0, i, j, w1a)
        store3(slopes_out, 3, i, j, w1b)
        store3(slopes_out, 6, i, j, w2a)
        store3(slopes_out, 9, i, j, w2b)
        store3(slopes_out, 12, i, j, w3a)
        store3(slopes_out, 15, i, j, w3b)
        store1(spins_out, 0, i, j, half * mul(w1, k2))
        store1(spins_out, 1, i, j, (-half) * mul(w2, k1))
        store1(spins_out, 2, i, j, w3)
        store3(flux_out, 0, i, j, fb + (scale(q1, w1b) + scale(q2, w2b) + scale(q3, w3b)))
        store3(flux_out, 3, i, j, scale(q1, w1a) + scale(q2, w2a) + scale(q3, w3a))

    @wp.kernel(module=module)
    def energy(
        r: wp.array3d(dtype=real),
        loop: int,
        axial: wp.array3d(dtype=real),
        g0: wp.array3d(dtype=real),
        weights: wp.array3d(dtype=real),
        natural: wp.array3d(dtype=real),
        lever: wp.array3d(dtype=real),
        angle: wp.array3d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        b = load3(r, 0, row_after(i, loop), j) - load3(r, 0, i, j)
        q = half * mul(load1(axial, 0, i, j), dot3(b, b) - load1(g0, 0, i, j))
        k1, k2, m = strains(lever, load1(angle, 0, row_before(i, loop), j), load1(angle, 0, i, j), i, j)
        q1, q2, q3 = weighted(weights, natural, k1, k2, m, i, j)
        w = mul(q, q) + (mul(q1, q1) + mul(q2, q2) + mul(q3, q3))
        partials_out[i, j] = partials_out[i, j] + wp.float64(0.5) * sum_lanes(w)

    @wp.kernel(module=module)
    def measure_strains(
        loop: int,
        lever: wp.array3d(dtype=real),
        angle: wp.array3d(dtype=real),
        strains_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        k1, k2, m = strains(lever, load1(angle, 0, row_before(i, loop), j), load1(angle, 0, i, j), i, j)
        store1(strains_out, 0, i, j, k1)
        store1(strains_out, 1, i, j, k2)
        store1(strains_out, 2, i, j, m)

    @wp.kernel(module=module)
    def accept_frames(
        r: wp.array3d(dtype=real),
        loop: int,
        floor: real,
        u: wp.array3d(dtype=real),
        lever: wp.array3d(dtype=real),
        angle: wp.array3d(dtype=real),
        tangent_out: wp.array3d(dtype=real),
        director_out: wp.array3d(dtype=real),
        twist_out: wp.array3d(dtype=real),
    ):
        """The frames of a step that has been accepted are what the next one starts from, with all angles zero."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        angle_b = load1(angle, 0, i, j)
        t = unit3(load3(r, 0, row_after(i, loop), j) - load3(r, 0, i, j), floor)
        c, s = cos_sin(angle_b)
        d = scale(c, load3(u, 0, i, j)) + scale(s, cross3(t, load3(u, 0, i, j)))
        # Round-off of many steps must not turn the director out of the normal plane nor change its length.
        d = unit3(d - scale(dot3(d, t), t), quarter)
        store3(tangent_out, 0, i, j, t)
        store3(director_out, 0, i, j, d)
        store1(twist_out, 0, i, j, angle_b - load1(angle, 0, row_before(i, loop), j) + load1(lever, 2, i, j))

    return SimpleNamespace(
        module=module,
        carry_frames=carry_frames,
        measure_levers=measure_levers,
        stress=stress,
        energy=energy,
        measure_strains=measure_strains,
        accept_frames=accept_frames,
    )
