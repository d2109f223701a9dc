"""Words of the angles of a strand's segments: strains as they turn, and their linear system along the rows.

Node k couples the angles of its edges a and b (segments before k and k) by the second derivatives of its energy; the
matrix is tridiagonal, with a corner that couples the last segment of a closed curve with the first. The last angle is
eliminated last, so that the corner fills one column and no more. Angles that are held do not turn.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.angles import angles
from warpdeform.kernels.curve_geometry import curve_geometry
from warpdeform.kernels.lanes import lanes

JOINT_COMPONENTS = 4
"""Derivatives of a node's energy by its two angles: aa = bb, ab, then a, b."""
CHAIN_COMPONENTS = 3
"""Factors at a segment: 1 / pivot, coupling with the segment before over its pivot, column of the last segment."""
PIVOT = {"float32": 1.0e-5, "float64": 1.0e-12}
"""A pivot below this part of the diagonal is round-off: the strand may spin freely, and its last angle stays."""


@functools.cache
def angle_system(width: int, real: Any) -> SimpleNamespace:
    """Device functions for one lane width and precision."""
    words, shape = lanes(width, real), curve_geometry(width, real)
    L, cos_sin = words.L, angles(width, real).cos_sin
    load1, store1, mul, div, splat = words.load1, words.store1, words.mul, words.div, words.splat
    exceeds, larger, at_least, row_after = words.exceeds, words.larger, words.at_least, shape.row_after
    zero, half, one, pivot, tiny = real(0.0), real(0.5), real(1.0), real(PIVOT[real.__name__]), real(1.0e-30)

    @wp.func
    def strains(lever: wp.array3d(dtype=real), angle_a: L, angle_b: L, k: int, j: int):
        """kappa_1, kappa_2 and m of a node."""
        c, s = cos_sin(half * (angle_a + angle_b))
        k1, k2 = load1(lever, 0, k, j), load1(lever, 1, k, j)
        return mul(c, k1) + mul(s, k2), mul(c, k2) - mul(s, k1), angle_b - angle_a + load1(lever, 2, k, j)

    @wp.func
    def weighted(weights: wp.array3d(dtype=real), natural: wp.array3d(dtype=real), k1: L, k2: L, m: L, k: int, j: int):
        """The strains q of a node."""
        return (
            mul(load1(weights, 0, k, j), k1 - load1(natural, 0, k, j)),
            mul(load1(weights, 1, k, j), k2 - load1(natural, 1, k, j)),
            mul(load1(weights, 2, k, j), m - load1(natural, 2, k, j)),
        )

    @wp.func
    def store_matrix(joint: wp.array3d(dtype=real), k: int, j: int, bending: L, twist: L):
        """Bending resists the sum of both angles, twist their difference."""
        store1(joint, 0, k, j, bending + twist)
        store1(joint, 1, k, j, bending - twist)

    @wp.func
    def store_moments(joint: wp.array3d(dtype=real), k: int, j: int, bending: L, twist: L):
        store1(joint, 2, k, j, bending - twist)
        store1(joint, 3, k, j, bending + twist)

    @wp.func
    def free_of(held: wp.array3d(dtype=real), i: int, j: int):
        return splat(one) - load1(held, 0, i, j)

    @wp.func
    def inverse_pivot(diagonal: L, less: L):
        """1 / (diagonal - less), 0 where that is not positive; and 1 where it is not negative, else 0."""
        d, lost = diagonal - less, pivot * diagonal
        return div(exceeds(d - lost, zero), at_least(d, tiny)), exceeds(d + lost + splat(tiny), zero)

    @wp.func
    def factorise(
        joint: wp.array3d(dtype=real),
        held: wp.array3d(dtype=real),
        last: int,
        loop: int,
        j: int,
        chain: wp.array3d(dtype=real),
    ):
        """Returns 1 where the matrix is positive, or at least not negative, in any direction; else 0."""
        definite = splat(one)
        free = free_of(held, 1, j)
        column = mul(mul(free, free_of(held, last, j)), load1(joint, 1, 1, j))
        factor, coupling, corner = splat(zero), splat(zero), splat(zero)
        for i in range(1, last):
            diagonal = load1(joint, 0, i, j) + load1(joint, 0, i + 1, j)
            inverse, positive = inverse_pivot(diagonal, mul(factor, coupling))
            definite = mul(definite, positive)
            following = free_of(held, i + 1, j)
            coupling = mul(mul(free, following), load1(joint, 1, i + 1, j))
            if i == last - 1:
                column = column + coupling
                coupling = splat(zero)
            store1(chain, 0, i, j, inverse)
            store1(chain, 1, i, j, factor)
            store1(chain, 2, i, j, column)
            corner = corner + mul(inverse, mul(column, column))
            factor = mul(inverse, coupling)
            column = splat(zero) - mul(factor, column)
            free = following
        diagonal = load1(joint, 0, last, j) + load1(joint, 0, row_after(last, loop), j)
        inverse, positive = inverse_pivot(diagonal, corner)
        store1(chain, 0, last, j, inverse)
        store1(chain, 1, last, j, splat(zero))
        return mul(definite, positive)

    @wp.func
    def make_definite(joint: wp.array3d(dtype=real), definite: L, last: int, j: int):
        """Turns the sign of what bending adds where it is negative, in the strands that are not definite."""
        for k in range(1, last + 1):
            aa, ab = load1(joint, 0, k, j), load1(joint, 1, k, j)
            bending = half * (aa + ab)
            more = mul(splat(one) - definite, larger(bending, splat(zero) - bending) - bending)
            store1(joint, 0, k, j, aa + more)
            store1(joint, 1, k, j, ab + more)

    @wp.func
    def moment(joint: wp.array3d(dtype=real), held: wp.array3d(dtype=real), i: int, following: int, j: int):
        """What turns segment i: less energy."""
        return mul(free_of(held, i, j), splat(zero) - load1(joint, 3, i, j) - load1(joint, 2, following, j))

    @wp.func
    def solve(
        joint: wp.array3d(dtype=real),
        held: wp.array3d(dtype=real),
        chain: wp.array3d(dtype=real),
        last: int,
        loop: int,
        j: int,
        turn: wp.array3d(dtype=real),
    ):
        """How far the angles turn."""
        y, tail = splat(zero), splat(zero)
        for i in range(1, last):
            y = moment(joint, held, i, i + 1, j) - mul(load1(chain, 1, i, j), y)
            store1(turn, 0, i, j, y)
            tail = tail + mul(load1(chain, 0, i, j), mul(load1(chain, 2, i, j), y))
        end = mul(load1(chain, 0, last, j), moment(joint, held, last, row_after(last, loop), j) - tail)
        store1(turn, 0, last, j, end)
        x = splat(zero) + end
        for n in range(1, last):
            i = last - n
            y = load1(turn, 0, i, j) - mul(load1(chain, 2, i, j), end)
            x = mul(load1(chain, 0, i, j), y) - mul(load1(chain, 1, i + 1, j), x)
            store1(turn, 0, i, j, x)

    return SimpleNamespace(
        strains=strains,
        weighted=weighted,
        store_matrix=store_matrix,
        store_moments=store_moments,
        moment=moment,
        factorise=factorise,
        make_definite=make_definite,
        solve=solve,
    )
