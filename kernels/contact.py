"""Forces between pairs: points and triangles, edges and edges (design 5.2).

Per pair, with r the vector from the closest point of the second to that of the first and w the corners' weights in it,
1 for a point, minus the barycentric ones for its triangle, so that r = sum w_k x_k:

    energy    m phi(|r| - offset)              m = m1 m2 / (m1 + m2), reduced mass of the two sides
    gradient  m phi' w_k n                     n = r / |r|; exact, since the closest points are stationary
    Hessian   m phi'' (w_k n) (w_l n)'         without the turning of n, which may be negative

Where layers meet every point faces a triangle on either side, so that two pairs share what m phi stands for: half the
mean of the masses each. The list of pairs is frozen between searches; the closest points follow the positions.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.boxes import BLOCK, box_words
from warpdeform.kernels.contact_geometry import closest
from warpdeform.kernels.contact_law import contact_law
from warpdeform.kernels.contact_lists import ANY, LENGTH, Pair
from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.potential import potentials

FAR = 1.0e30
"""Distance of skins where nothing is near [m]."""
CLOSE = 0.1
"""Range of edges that feel each other only when very close, as a share of that of the field, and their weight."""

# Entries of the int32 state of a list: whether nodes have moved too far for it, whether the boxes are around them, and
# whether there is one.
STALE = wp.constant(0)
FITTED = wp.constant(1)
MADE = wp.constant(2)
LIST_STATE = 3


@functools.cache
def contact(real: Any) -> SimpleNamespace:
    """The kernels for one precision, and `Push`, what a pair does at a Newton iterate."""
    words = lanes(1, real)
    V, S, load3, add3, add6 = words.V, words.S, words.load3, words.add3, words.add6
    outer, apply6 = words.outer, words.apply6
    geometry, Law, at_slot = closest(real), contact_law(real), box_words(real).at_slot
    point_triangle, segment_segment = geometry.point_triangle, geometry.segment_segment
    exponential, wall = potentials(real).exponential, potentials(real).wall
    W = wp.types.vector(4, real)
    zero, one = real(0.0), real(1.0)
    module = kernel_module("contact", 1, real)

    @wp.struct
    class Push:
        """What a pair does at a Newton iterate.

        Attributes:
            gradient: Derivative of the energy by r [N].
            block: Derivative of that by r, positive semi-definite [N/m].
        """

        gradient: V
        block: S

    @wp.func
    def difference(pair: Pair, points: wp.array3d(dtype=real)):
        """The vector r between the closest points, and the weights of the corners in it."""
        xa, xb = at_slot(points, pair.a), at_slot(points, pair.b)
        xc, xd = at_slot(points, pair.c), at_slot(points, pair.d)
        r, w = V(), W()
        if pair.edges == 1:
            r, s, t = segment_segment(xa, xb, xc, xd)
            w = W(one - s, s, t - one, -t)
        else:
            r, u = point_triangle(xa, xb, xc, xd)
            w = W(one, -u[0], -u[1], -u[2])
        return r, w

    @wp.func
    def reduced_mass(pair: Pair, masses: wp.array(dtype=real), w: W):
        first = w[0] * masses[pair.a]
        second = -w[2] * masses[pair.c] - w[3] * masses[pair.d]
        if pair.edges == 1:
            first += w[1] * masses[pair.b]
        else:
            second -= w[1] * masses[pair.b]
        return first * second / (first + second)

    @wp.func
    def density(pair: Pair, law: Law, distance: real):
        """phi and its derivatives at a distance of the middle surfaces."""
        share = one
        if pair.close == 1:
            share = real(CLOSE)
        phi = share * exponential(law.strength, share * law.eps, distance - law.offset)
        return phi + wall(share * law.strength, share * law.wall, distance - law.inner)

    @wp.kernel(module=module)
    def weigh_pairs(
        threads: int,
        counts: wp.array(dtype=wp.int32),
        pairs: wp.array(dtype=Pair),
        points: wp.array3d(dtype=real),
        masses: wp.array(dtype=real),
        weights_out: wp.array(dtype=real),
    ):
        """Masses of new pairs, which stay while the list does."""
        k = wp.tid()
        while k < counts[LENGTH]:
            _r, w = difference(pairs[k], points)
            weights_out[k] = reduced_mass(pairs[k], masses, w)
            k += threads

    @wp.kernel(module=module)
    def linearise_pairs(
        threads: int,
        counts: wp.array(dtype=wp.int32),
        pairs: wp.array(dtype=Pair),
        laws: wp.array(dtype=Law),
        weights: wp.array(dtype=real),
        points: wp.array3d(dtype=real),
        closest_out: wp.array(dtype=real),
        shares_out: wp.array(dtype=W),
        pushes_out: wp.array(dtype=Push),
    ):
        """The weights of the corners of each pair, and what it does; the smallest distance of skins."""
        k = wp.tid()
        closest = real(FAR)
        while k < counts[LENGTH]:
            pair = pairs[k]
            r, w = difference(pair, points)
            distance = wp.length(r)
            n = r / wp.max(distance, real(1e-30))
            law = laws[pair.law]
            closest = wp.min(closest, distance - law.offset)
            phi = density(pair, law, distance)
            push = Push()
            shares_out[k] = w
            push.gradient = weights[k] * phi[1] * n
            push.block = weights[k] * phi[2] * outer(n, n)
            pushes_out[k] = push
            k += threads
        wp.atomic_min(closest_out, 0, closest)

    @wp.kernel(module=module)
    def pair_energies(
        threads: int,
        counts: wp.array(dtype=wp.int32),
        pairs: wp.array(dtype=Pair),
        laws: wp.array(dtype=Law),
        weights: wp.array(dtype=real),
        points: wp.array3d(dtype=real),
        energies_out: wp.array(dtype=wp.float64),
    ):
        """Energy [J] of each thread's pairs."""
        thread = wp.tid()
        total = wp.float64(0.0)
        k = thread
        while k < counts[LENGTH]:
            pair = pairs[k]
            r, _w = difference(pair, points)
            total += wp.float64(weights[k] * density(pair, laws[pair.law], wp.length(r))[0])
            k += threads
        energies_out[thread] = total

    @wp.kernel(module=module)
    def add_energies(halo: int, energies: wp.array(dtype=wp.float64), partials_out: wp.array2d(dtype=wp.float64)):
        """All of it to one place of one body."""
        total = wp.float64(0.0)
        for k in range(energies.shape[0]):
            total += energies[k]
        partials_out[1, halo] = partials_out[1, halo] + total

    @wp.kernel(module=module)
    def sum_diagonal(
        starts: wp.array(dtype=wp.int32),
        entries: wp.array(dtype=wp.int32),
        shares: wp.array(dtype=W),
        pushes: wp.array(dtype=Push),
        diagonal_out: wp.array(dtype=S),
    ):
        """The diagonal block of each slot that has pairs."""
        s = wp.tid()
        if starts[s + 1] > starts[s]:
            b = S()
            for k in range(starts[s], starts[s + 1]):
                w = shares[entries[k] >> 2][entries[k] & 3]
                b += w * w * pushes[entries[k] >> 2].block
            diagonal_out[s] = b

    @wp.kernel(module=module)
    def add_pair_gradients(
        halo: int,
        slots: wp.array2d(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        entries: wp.array(dtype=wp.int32),
        shares: wp.array(dtype=W),
        pushes: wp.array(dtype=Push),
        gradient_out: wp.array3d(dtype=real),
    ):
        row, column = wp.tid()
        i, j = row + 1, column + halo
        s = slots[i, j]
        if s >= 0 and starts[s + 1] > starts[s]:
            g = V()
            for k in range(starts[s], starts[s + 1]):
                g += shares[entries[k] >> 2][entries[k] & 3] * pushes[entries[k] >> 2].gradient
            add3(gradient_out, 0, i, j, g)

    @wp.kernel(module=module)
    def add_pair_blocks(
        halo: int,
        slots: wp.array2d(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        diagonal: wp.array(dtype=S),
        blocks_out: wp.array3d(dtype=real),
    ):
        row, column = wp.tid()
        i, j = row + 1, column + halo
        s = slots[i, j]
        if s >= 0 and starts[s + 1] > starts[s]:
            add6(blocks_out, 0, i, j, diagonal[s])

    @wp.kernel(module=module)
    def multiply_pairs(
        threads: int,
        counts: wp.array(dtype=wp.int32),
        pairs: wp.array(dtype=Pair),
        shares: wp.array(dtype=W),
        pushes: wp.array(dtype=Push),
        directions: wp.array3d(dtype=real),
        pulls_out: wp.array(dtype=V),
    ):
        """Block times the change of r."""
        k = wp.tid()
        while k < counts[LENGTH]:
            pair, w = pairs[k], shares[k]
            change = w[0] * at_slot(directions, pair.a) + w[1] * at_slot(directions, pair.b)
            change += w[2] * at_slot(directions, pair.c) + w[3] * at_slot(directions, pair.d)
            pulls_out[k] = apply6(pushes[k].block, change)
            k += threads

    @wp.kernel(module=module)
    def add_couplings(
        halo: int,
        slots: wp.array2d(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        entries: wp.array(dtype=wp.int32),
        shares: wp.array(dtype=W),
        pulls: wp.array(dtype=V),
        diagonal: wp.array(dtype=S),
        direction: wp.array3d(dtype=real),
        product_out: wp.array3d(dtype=real),
    ):
        """The Hessian product without its diagonal blocks, which are the nodes' own."""
        row, column = wp.tid()
        i, j = row + 1, column + halo
        s = slots[i, j]
        if s >= 0 and starts[s + 1] > starts[s]:
            q = -apply6(diagonal[s], load3(direction, 0, i, j))
            for k in range(starts[s], starts[s + 1]):
                q += shares[entries[k] >> 2][entries[k] & 3] * pulls[entries[k] >> 2]
            add3(product_out, 0, i, j, q)

    @wp.kernel(module=module)
    def begin_move(move_out: wp.array(dtype=real)):
        move_out[0] = zero

    @wp.kernel(module=module)
    def measure_move(points: wp.array3d(dtype=real), listed: wp.array3d(dtype=real), move_out: wp.array(dtype=real)):
        """Largest way that a slot has gone along an axis since the list was made."""
        b = wp.tid()
        most = zero
        for k in range(BLOCK):
            for c in range(3):
                way = wp.abs(points[c, b, k] - listed[c, b, k])
                most = wp.where(way <= real(FAR), wp.max(most, way), real(FAR))  # also of what is not finite
        wp.atomic_max(move_out, 0, most)

    @wp.kernel(module=module)
    def judge_move(slack: real, move: wp.array(dtype=real), state_out: wp.array(dtype=wp.int32)):
        """Whether the list is stale, and whether the boxes fit: those of a new list do, or if nothing has moved."""
        stale = state_out[MADE] == 0 or not (move[0] <= slack)
        state_out[MADE] = 1
        state_out[STALE] = wp.where(stale, 1, 0)
        state_out[FITTED] = wp.where(stale or move[0] == zero, 1, 0)

    @wp.kernel(module=module)
    def drop_list(counts_out: wp.array(dtype=wp.int32), state_out: wp.array(dtype=wp.int32)):
        """There are no pairs, and whoever wants to know of any has to search, with boxes that have to be fitted."""
        counts_out[LENGTH] = 0
        counts_out[ANY] = 0
        state_out[MADE] = 0
        state_out[FITTED] = 0

    @wp.kernel(module=module)
    def keep_points(points: wp.array3d(dtype=real), listed_out: wp.array3d(dtype=real)):
        b = wp.tid()
        for k in range(BLOCK):
            for c in range(3):
                listed_out[c, b, k] = points[c, b, k]

    return SimpleNamespace(
        module=module,
        Push=Push,
        Shares=W,
        V=V,
        S=S,
        sum_diagonal=sum_diagonal,
        begin_move=begin_move,
        measure_move=measure_move,
        judge_move=judge_move,
        drop_list=drop_list,
        keep_points=keep_points,
        weigh_pairs=weigh_pairs,
        linearise_pairs=linearise_pairs,
        pair_energies=pair_energies,
        add_energies=add_energies,
        add_pair_gradients=add_pair_gradients,
        add_pair_blocks=add_pair_blocks,
        multiply_pairs=multiply_pairs,
        add_couplings=add_couplings,
    )
