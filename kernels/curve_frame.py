"""Material frames of curves: two curvatures and the twist of every node, with the angles eliminated (design 1.3).

The frame of a segment is made of its unit tangent t and two directors, the axes of its section. At the start of a step
it is known; from there it follows the iterate by parallel transport, in one go, and turns by an angle (Bergou et al.,
Discrete Elastic Rods, 2008, and Discrete Viscous Threads, 2010):

    u = transported director,  v = t x u,  m1 = cos(angle) u + sin(angle) v,  m2 = t x m1

Node with edges a and b, kb as in :mod:`warpdeform.kernels.curve`:

    kappa_k = kb.(m_k of a + m_k of b)/2,    m = angle of b - angle of a + turning of u from a to b
    energy (EI_1 (kappa_1 - kappa0_1)^2 + EI_2 (kappa_2 - kappa0_2)^2 + GJ (m - m0)^2) / 2l

as squares of three weighted strains q, with R^2 = EI_1/l, EI_2/l, GJ/l. The angles are no unknowns of the solver: they
have the values of least energy wherever energy or forces are asked for, since they carry no inertia. So the gradient by
the positions is the partial derivative, and where the frames came from does not matter. Segments whose director is held
have the angle that brings m1 closest to a given direction; the gradient is exact where that is normal to the edge.

The Hessian is Gauss-Newton's of positions and angles together, with the angles eliminated (Schur complement). What runs
along a strand is one thread per lane group that walks the rows.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.angles import angles
from warpdeform.kernels.curve_angles import angle_system
from warpdeform.kernels.curve_geometry import curve_geometry
from warpdeform.kernels.lanes import kernel_module, lanes

LEVER_COMPONENTS = 5
"""What the strains of a node become of as angles turn: kb.u/2, kb.v/2 of edge a, then of edge b; turning of u."""
MOST_SETTLING = 40
"""Most Newton iterations on the angles; one or two do when they start from those of the last iterate."""
SETTLED = {"float32": 1.0e-4, "float64": 1.0e-7}
"""Largest turn of a Newton iteration after which the angles stand: the next one would turn them by its square."""
ROUND_OFF = {"float32": 1.0e-5, "float64": 1.0e-13}
"""Part of the energy of a strand by which it may grow in an iteration."""
STEEP = 1.0e-3
"""Smallest second derivative by an angle, as a part of its Gauss-Newton part."""


@functools.cache
def curve_frame(width: int, real: Any) -> SimpleNamespace:
    """Kernels of the material frames for one lane width and precision.

    Returns:
        Kernels ``carry_frames``, ``measure_levers``, ``settle_angles``, ``stress``, ``factorise_angles``,
        ``relax_angles``, ``energy``, ``measure_strains`` and ``accept_frames``.
    """
    words, shape, turns = lanes(width, real), curve_geometry(width, real), angles(width, real)
    system = angle_system(width, real)
    L, V = words.L, words.V
    load1, load3, store1, store3 = words.load1, words.load3, words.store1, words.store3
    sum_lanes, max_lanes, larger, exceeds = words.sum_lanes, words.max_lanes, words.larger, words.exceeds
    dot3, cross3, scale, mul, div = words.dot3, words.cross3, words.scale, words.mul, words.div
    root, splat = words.root, words.splat
    row_before, row_after, edges = shape.row_before, shape.row_after, shape.edges
    length, unit3, spread, transported = shape.length, shape.unit3, shape.spread, shape.transported
    binormal, binormal_slopes, store_stretch = shape.binormal, shape.binormal_slopes, shape.store_stretch
    without_fold = shape.without_fold
    cos_sin, angle_of = turns.cos_sin, turns.angle_of
    store_joint, factorise, solve = system.store_joint, system.factorise, system.solve
    zero, half, one, steep = real(0.0), real(0.5), real(1.0), real(STEEP)
    settled, round_off = real(SETTLED[real.__name__] ** 2), real(ROUND_OFF[real.__name__])
    module = kernel_module("curve_frame", width, real)

    @wp.func
    def parts(lever: wp.array3d(dtype=real), ca: L, sa: L, cb: L, sb: L, k: int, j: int):
        """Parts of kappa_1 and kappa_2 that are due to edge a, then to edge b."""
        a1, a2 = load1(lever, 0, k, j), load1(lever, 1, k, j)
        b1, b2 = load1(lever, 2, k, j), load1(lever, 3, k, j)
        return (
            mul(ca, a1) + mul(sa, a2),
            mul(ca, a2) - mul(sa, a1),
            mul(cb, b1) + mul(sb, b2),
            mul(cb, b2) - mul(sb, b1),
        )

    @wp.func
    def weighted(
        weights: wp.array3d(dtype=real), natural: wp.array3d(dtype=real), k1: L, k2: L, m: L, k: int, j: int
    ):
        """The strains q."""
        return (
            mul(load1(weights, 0, k, j), k1 - load1(natural, 0, k, j)),
            mul(load1(weights, 1, k, j), k2 - load1(natural, 1, k, j)),
            mul(load1(weights, 2, k, j), m - load1(natural, 2, k, j)),
        )

    @wp.func
    def turned(u: wp.array3d(dtype=real), t: V, angle: L, i: int, j: int):
        """m1 of a segment with tangent t."""
        c, s = cos_sin(angle)
        director = load3(u, 0, i, j)
        return scale(c, director) + scale(s, cross3(t, director))

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
        kb = half * binormal(a, b, spread(a, b, length(a, floor), length(b, floor)))
        vb = cross3(tb, ub)
        store1(lever_out, 0, i, j, dot3(kb, ua))
        store1(lever_out, 1, i, j, dot3(kb, cross3(ta, ua)))
        store1(lever_out, 2, i, j, dot3(kb, ub))
        store1(lever_out, 3, i, j, dot3(kb, vb))
        carried, before = transported(ua, ta, tb), load1(twist_before, 0, i, j)
        c, s = dot3(carried, ub), splat(zero) - dot3(carried, vb)
        c0, s0 = cos_sin(before)
        store1(lever_out, 4, i, j, before + angle_of(mul(c, c0) + mul(s, s0), mul(s, c0) - mul(c, s0)))

    @wp.kernel(module=module)
    def settle_angles(
        last: int,
        loop: int,
        lever: wp.array3d(dtype=real),
        weights: wp.array3d(dtype=real),
        natural: wp.array3d(dtype=real),
        held: wp.array3d(dtype=real),
        joint: wp.array3d(dtype=real),
        chain: wp.array3d(dtype=real),
        step: wp.array3d(dtype=real),
        move: wp.array3d(dtype=real),
        angle_out: wp.array3d(dtype=real),
    ):
        """The angles of least energy, by Newton from those that are there; `last` is the row of the last segment.

        A step that does not lessen the energy is halved until it does. Every strand decides and stops by itself, so
        that it does not matter which others share its lane group.
        """
        group = wp.tid()
        j = (group + 1) * width
        moving, least = splat(one), splat(zero)
        for iteration in range(MOST_SETTLING):
            energy_now = splat(zero)
            angle_a = load1(angle_out, 0, row_before(1, loop), j)
            ca, sa = cos_sin(angle_a)
            for k in range(1, last + 1):
                angle_b = load1(angle_out, 0, k, j)
                cb, sb = cos_sin(angle_b)
                a1, a2, b1, b2 = parts(lever, ca, sa, cb, sb, k, j)
                twist = angle_b - angle_a + load1(lever, 4, k, j)
                q1, q2, q3 = weighted(weights, natural, a1 + b1, a2 + b2, twist, k, j)
                energy_now = energy_now + (mul(q1, q1) + mul(q2, q2) + mul(q3, q3))
                w1, w2, w3 = load1(weights, 0, k, j), load1(weights, 1, k, j), load1(weights, 2, k, j)
                m1, m2, m3 = mul(w1, q1), mul(w2, q2), mul(w3, q3)
                # Turning edge a changes kappa_1 by a2 and kappa_2 by -a1; second derivatives are -a1 and -a2.
                ww1, ww2, ww3 = mul(w1, w1), mul(w2, w2), mul(w3, w3)
                ha = mul(ww1, mul(a2, a2)) + mul(ww2, mul(a1, a1)) + ww3
                hb = mul(ww1, mul(b2, b2)) + mul(ww2, mul(b1, b1)) + ww3
                store_joint(
                    joint, k, j,
                    larger(ha - mul(m1, a1) - mul(m2, a2), steep * ha),
                    larger(hb - mul(m1, b1) - mul(m2, b2), steep * hb),
                    mul(ww1, mul(a2, b2)) + mul(ww2, mul(a1, b1)) - ww3,
                    mul(m1, a2) - mul(m2, a1) - m3,
                    mul(m1, b2) - mul(m2, b1) + m3,
                )  # fmt: skip
                angle_a = angle_b
                ca = cb
                sa = sb
            factorise(joint, held, last, loop, j, chain)
            solve(joint, held, chain, last, loop, j, step)
            back = exceeds(energy_now - least - round_off * least, zero)
            if iteration == 0:
                back = splat(zero)
            least = mul(back, least) + mul(splat(one) - back, energy_now)
            most = splat(zero)
            for i in range(1, last + 1):
                newton = load1(step, 0, i, j)
                most = larger(most, mul(newton, newton))
            # A turn by more than a radian would leave what the derivatives know.
            forth = div(splat(one) - back, root(splat(one) + most))
            most = splat(zero)
            for i in range(1, last + 1):
                newton, half_back = mul(forth, load1(step, 0, i, j)), half * mul(back, load1(move, 0, i, j))
                turn = mul(moving, newton - half_back)
                store1(move, 0, i, j, newton + half_back)
                store1(angle_out, 0, i, j, load1(angle_out, 0, i, j) + turn)
                most = larger(most, mul(turn, turn))
            moving = exceeds(most, settled)
            if max_lanes(moving) == zero:
                break

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
        angle_a, angle_b = load1(angle, 0, before, j), load1(angle, 0, i, j)
        m1a, m1b = turned(u, ta, angle_a, before, j), turned(u, tb, angle_b, i, j)
        m2a, m2b = cross3(ta, m1a), cross3(tb, m1b)
        a1, a2, b1, b2 = half * dot3(kb, m1a), half * dot3(kb, m2a), half * dot3(kb, m1b), half * dot3(kb, m2b)
        twist = angle_b - angle_a + load1(lever, 4, i, j)
        q1, q2, q3 = weighted(weights, natural, a1 + b1, a2 + b2, twist, i, j)
        w1, w2, w3 = load1(weights, 0, i, j), load1(weights, 1, i, j), load1(weights, 2, i, j)
        w1a, w1b = binormal_slopes(a, b, la, lb, inverse, kb, scale(half * w1, m1a + m1b))
        w2a, w2b = binormal_slopes(a, b, la, lb, inverse, kb, scale(half * w2, m2a + m2b))
        # u turns from a to b by kb/2 times the change of the tangents; without the fold in kb, which transport lacks.
        turning = scale(half * mul(w3, without_fold(inverse, la, lb)), kb)
        w3a, w3b = scale(div(splat(one), la), turning), scale(div(splat(one), lb), turning)
        store3(slopes_out, 0, i, j, w1a)
        store3(slopes_out, 3, i, j, w1b)
        store3(slopes_out, 6, i, j, w2a)
        store3(slopes_out, 9, i, j, w2b)
        store3(slopes_out, 12, i, j, w3a)
        store3(slopes_out, 15, i, j, w3b)
        store1(spins_out, 0, i, j, mul(w1, a2))
        store1(spins_out, 1, i, j, mul(w1, b2))
        store1(spins_out, 2, i, j, splat(zero) - mul(w2, a1))
        store1(spins_out, 3, i, j, splat(zero) - mul(w2, b1))
        store1(spins_out, 4, i, j, splat(zero) - w3)
        store1(spins_out, 5, i, j, w3)
        store3(flux_out, 0, i, j, fb + (scale(q1, w1b) + scale(q2, w2b) + scale(q3, w3b)))
        store3(flux_out, 3, i, j, scale(q1, w1a) + scale(q2, w2a) + scale(q3, w3a))

    @wp.kernel(module=module)
    def factorise_angles(
        last: int,
        loop: int,
        spins: wp.array3d(dtype=real),
        held: wp.array3d(dtype=real),
        joint: wp.array3d(dtype=real),
        chain_out: wp.array3d(dtype=real),
    ):
        """Gauss-Newton's matrix of the angles."""
        group = wp.tid()
        j = (group + 1) * width
        for k in range(1, last + 1):
            a1, b1 = load1(spins, 0, k, j), load1(spins, 1, k, j)
            a2, b2 = load1(spins, 2, k, j), load1(spins, 3, k, j)
            a3, b3 = load1(spins, 4, k, j), load1(spins, 5, k, j)
            store_joint(
                joint, k, j,
                mul(a1, a1) + mul(a2, a2) + mul(a3, a3),
                mul(b1, b1) + mul(b2, b2) + mul(b3, b3),
                mul(a1, b1) + mul(a2, b2) + mul(a3, b3),
                splat(zero),
                splat(zero),
            )  # fmt: skip
        factorise(joint, held, last, loop, j, chain_out)

    @wp.kernel(module=module)
    def relax_angles(
        last: int,
        loop: int,
        slopes: wp.array3d(dtype=real),
        spins: wp.array3d(dtype=real),
        held: wp.array3d(dtype=real),
        chain: wp.array3d(dtype=real),
        p: wp.array3d(dtype=real),
        joint: wp.array3d(dtype=real),
        turn_out: wp.array3d(dtype=real),
    ):
        """How the angles follow the displacement p."""
        group = wp.tid()
        j = (group + 1) * width
        for k in range(1, last + 1):
            pa, pb = edges(p, loop, k, j)
            ga, gb = splat(zero), splat(zero)
            for n in range(3):
                q = dot3(load3(slopes, 6 * n, k, j), pa) + dot3(load3(slopes, 6 * n + 3, k, j), pb)
                ga = ga + mul(load1(spins, 2 * n, k, j), q)
                gb = gb + mul(load1(spins, 2 * n + 1, k, j), q)
            store1(joint, 3, k, j, ga)
            store1(joint, 4, k, j, gb)
        solve(joint, held, chain, last, loop, j, turn_out)

    @wp.func
    def strains(lever: wp.array3d(dtype=real), angle: wp.array3d(dtype=real), loop: int, i: int, j: int):
        """kappa_1, kappa_2 and m of a node."""
        angle_a, angle_b = load1(angle, 0, row_before(i, loop), j), load1(angle, 0, i, j)
        ca, sa = cos_sin(angle_a)
        cb, sb = cos_sin(angle_b)
        a1, a2, b1, b2 = parts(lever, ca, sa, cb, sb, i, j)
        return a1 + b1, a2 + b2, angle_b - angle_a + load1(lever, 4, i, j)

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
        k1, k2, m = strains(lever, angle, loop, i, j)
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
        k1, k2, m = strains(lever, angle, loop, i, j)
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
        m1 = turned(u, t, angle_b, i, j)
        # Round-off of many steps must not turn the director out of the normal plane nor change its length.
        m1 = m1 - scale(dot3(m1, t), t)
        store3(tangent_out, 0, i, j, t)
        store3(director_out, 0, i, j, scale(div(splat(one), length(m1, real(0.25))), m1))
        twist = angle_b - load1(angle, 0, row_before(i, loop), j) + load1(lever, 4, i, j)
        store1(twist_out, 0, i, j, twist)

    return SimpleNamespace(
        module=module,
        carry_frames=carry_frames,
        measure_levers=measure_levers,
        settle_angles=settle_angles,
        stress=stress,
        factorise_angles=factorise_angles,
        relax_angles=relax_angles,
        energy=energy,
        measure_strains=measure_strains,
        accept_frames=accept_frames,
    )
