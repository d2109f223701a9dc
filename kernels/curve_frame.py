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

LEVER_COMPONENTS = 3
"""The strains of a node with both angles zero: kappa_1, kappa_2, turning of u."""
MOST_SETTLING = 40
"""Most Newton iterations on the angles; one or two do when they start from those of the last iterate."""
SETTLED = {"float32": 1.0e-4, "float64": 1.0e-7}
"""A Newton iteration that turns the angles by so little is the last: the next one would turn them by its square.

Counted is the mean turn, weighted with the stiffness that resists it: strands that spin freely never stand still.
"""
ROUND_OFF = {"float32": 1.0e-5, "float64": 1.0e-13}
"""Part of the energy of a strand by which it may grow in an iteration; of a second derivative that is not counted."""


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
    root, splat, at_least = words.root, words.splat, words.at_least
    row_before, row_after, edges = shape.row_before, shape.row_after, shape.edges
    length, unit3, spread, transported = shape.length, shape.unit3, shape.spread, shape.transported
    binormal, binormal_slopes, store_stretch = shape.binormal, shape.binormal_slopes, shape.store_stretch
    without_fold = shape.without_fold
    cos_sin, angle_of = turns.cos_sin, turns.angle_of
    store_matrix, store_moments, moment = system.store_matrix, system.store_moments, system.moment
    factorise, make_definite, solve = system.factorise, system.make_definite, system.solve
    zero, half, quarter, one, tiny = real(0.0), real(0.5), real(0.25), real(1.0), real(1.0e-30)
    settled, round_off = real(SETTLED[real.__name__] ** 2), real(ROUND_OFF[real.__name__])
    module = kernel_module("curve_frame", width, real)

    @wp.func
    def strains(lever: wp.array3d(dtype=real), angle_a: L, angle_b: L, k: int, j: int):
        """kappa_1, kappa_2 and m of a node."""
        c, s = cos_sin(half * (angle_a + angle_b))
        k1, k2 = load1(lever, 0, k, j), load1(lever, 1, k, j)
        return mul(c, k1) + mul(s, k2), mul(c, k2) - mul(s, k1), angle_b - angle_a + load1(lever, 2, k, j)

    @wp.func
    def half_way(turning: L, ua: V, ub: V, ta: V, tb: V):
        """n_1 and n_2 with both angles zero."""
        c, s = cos_sin(half * turning)
        va, vb = cross3(ta, ua), cross3(tb, ub)
        c, s = half * c, half * s
        return scale(c, ua + ub) + scale(s, va - vb), scale(c, va + vb) - scale(s, ua - ub)

    @wp.func
    def weighted(weights: wp.array3d(dtype=real), natural: wp.array3d(dtype=real), k1: L, k2: L, m: L, k: int, j: int):
        """The strains q of a node."""
        return (
            mul(load1(weights, 0, k, j), k1 - load1(natural, 0, k, j)),
            mul(load1(weights, 1, k, j), k2 - load1(natural, 1, k, j)),
            mul(load1(weights, 2, k, j), m - load1(natural, 2, k, j)),
        )

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

    @wp.func
    def equations(
        last: int,
        loop: int,
        lever: wp.array3d(dtype=real),
        weights: wp.array3d(dtype=real),
        natural: wp.array3d(dtype=real),
        angle: wp.array3d(dtype=real),
        joint: wp.array3d(dtype=real),
        j: int,
    ):
        """First and second derivatives of the energy by the angles; returns twice the energy and all stiffness."""
        twice, stiffness = splat(zero), splat(zero)
        angle_a = load1(angle, 0, row_before(1, loop), j)
        for k in range(1, last + 1):
            angle_b = load1(angle, 0, k, j)
            k1, k2, m = strains(lever, angle_a, angle_b, k, j)
            q1, q2, q3 = weighted(weights, natural, k1, k2, m, k, j)
            w1, w2, w3 = load1(weights, 0, k, j), load1(weights, 1, k, j), load1(weights, 2, k, j)
            m1, m2, twist = mul(w1, q1), mul(w2, q2), mul(w3, w3)
            # Half the sum of the angles turns kappa: its first derivative is (kappa_2, -kappa_1), the second -kappa.
            bending = mul(mul(w1, w1), mul(k2, k2)) + mul(mul(w2, w2), mul(k1, k1))
            steep, lost = bending - mul(m1, k1) - mul(m2, k2), round_off * bending
            # Both parts are the same in a section that bends alike in every direction: round-off is not to hold it.
            steep = at_least(steep - lost, zero) - at_least(splat(zero) - steep - lost, zero)
            store_matrix(joint, k, j, quarter * steep, twist)
            store_moments(joint, k, j, half * (mul(m1, k2) - mul(m2, k1)), mul(w3, q3))
            twice = twice + (mul(q1, q1) + mul(q2, q2) + mul(q3, q3))
            stiffness = stiffness + (bending + twist)
            angle_a = angle_b
        return twice, stiffness

    @wp.func
    def follow(
        last: int,
        loop: int,
        first: bool,
        moving: L,
        back: L,
        held: wp.array3d(dtype=real),
        joint: wp.array3d(dtype=real),
        step: wp.array3d(dtype=real),
        move: wp.array3d(dtype=real),
        angle: wp.array3d(dtype=real),
        j: int,
    ):
        """Takes the step, or half of the last move back; returns what the whole step would gain."""
        most, gain = splat(zero), splat(zero)
        for i in range(1, last + 1):
            newton = load1(step, 0, i, j)
            most = larger(most, mul(newton, newton))
            gain = gain + mul(newton, moment(joint, held, i, row_after(i, loop), j))
        # A turn by more than a radian would leave what the derivatives know.
        forth = div(splat(one) - back, root(splat(one) + most))
        for i in range(1, last + 1):
            newton, half_back = mul(forth, load1(step, 0, i, j)), splat(zero)
            if not first:
                half_back = half * mul(back, load1(move, 0, i, j))
            store1(move, 0, i, j, newton + half_back)
            store1(angle, 0, i, j, load1(angle, 0, i, j) + mul(moving, newton - half_back))
        return gain

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
        moving, least, back = splat(one), splat(zero), splat(zero)
        for iteration in range(MOST_SETTLING):
            twice, stiffness = equations(last, loop, lever, weights, natural, angle_out, joint, j)
            if iteration > 0:
                back = exceeds(twice - least - round_off * least, zero)
            least = mul(back, least) + mul(splat(one) - back, twice)
            definite = factorise(joint, held, last, loop, j, chain)
            if max_lanes(splat(one) - definite) > zero:
                # Downhill where the energy is concave.
                make_definite(joint, definite, last, j)
                factorise(joint, held, last, loop, j, chain)
            solve(joint, held, chain, last, loop, j, step)
            gain = follow(last, loop, iteration == 0, moving, back, held, joint, step, move, angle_out, j)
            moving = exceeds(mul(moving, gain - settled * stiffness), zero)
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
            s1, s2, s3 = load1(spins, 0, k, j), load1(spins, 1, k, j), load1(spins, 2, k, j)
            store_matrix(joint, k, j, mul(s1, s1) + mul(s2, s2), mul(s3, s3))
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
            q1 = dot3(load3(slopes, 0, k, j), pa) + dot3(load3(slopes, 3, k, j), pb)
            q2 = dot3(load3(slopes, 6, k, j), pa) + dot3(load3(slopes, 9, k, j), pb)
            q3 = dot3(load3(slopes, 12, k, j), pa) + dot3(load3(slopes, 15, k, j), pb)
            bending = mul(load1(spins, 0, k, j), q1) + mul(load1(spins, 1, k, j), q2)
            store_moments(joint, k, j, bending, mul(load1(spins, 2, k, j), q3))
        solve(joint, held, chain, last, loop, j, turn_out)

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
        settle_angles=settle_angles,
        stress=stress,
        factorise_angles=factorise_angles,
        relax_angles=relax_angles,
        energy=energy,
        measure_strains=measure_strains,
        accept_frames=accept_frames,
    )
