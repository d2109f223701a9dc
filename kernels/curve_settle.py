"""The angles of a curve's segments: those of least energy, and how they follow a displacement (design 1.3).

What runs along a strand is one thread per lane group that walks the rows. Formulas and strains are those of
:mod:`warpdeform.kernels.curve_frame`.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.curve_angles import angle_system
from warpdeform.kernels.curve_geometry import curve_geometry
from warpdeform.kernels.lanes import kernel_module, lanes

MOST_SETTLING = 40
"""Most Newton iterations on the angles; one or two do when they start from those of the last iterate."""
SETTLED = {"float32": 1.0e-4, "float64": 1.0e-7}
"""A Newton iteration that turns the angles by so little is the last: the next one would turn them by its square.

Counted is the mean turn, weighted with the stiffness that resists it: strands that spin freely never stand still.
"""
ROUND_OFF = {"float32": 1.0e-5, "float64": 1.0e-13}
"""Part of the energy of a strand by which it may grow in an iteration; of a second derivative that is not counted."""


@functools.cache
def curve_settle(width: int, real: Any) -> SimpleNamespace:
    """Kernels ``settle_angles``, ``factorise_angles`` and ``relax_angles`` for one lane width and precision."""
    words, shape, system = lanes(width, real), curve_geometry(width, real), angle_system(width, real)
    L, load1, load3, store1 = words.L, words.load1, words.load3, words.store1
    max_lanes, larger, exceeds, at_least = words.max_lanes, words.larger, words.exceeds, words.at_least
    dot3, mul, div, root, splat = words.dot3, words.mul, words.div, words.root, words.splat
    row_before, row_after, edges = shape.row_before, shape.row_after, shape.edges
    strains, weighted = system.strains, system.weighted
    store_matrix, store_moments, moment = system.store_matrix, system.store_moments, system.moment
    factorise, make_definite, solve = system.factorise, system.make_definite, system.solve
    zero, half, quarter, one = real(0.0), real(0.5), real(0.25), real(1.0)
    settled, round_off = real(SETTLED[real.__name__] ** 2), real(ROUND_OFF[real.__name__])
    module = kernel_module("curve_settle", width, real)

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

    return SimpleNamespace(
        module=module, settle_angles=settle_angles, factorise_angles=factorise_angles, relax_angles=relax_angles
    )
