"""Impulses that take risks away from pairs, and the rounds of the guard (:mod:`warpdeform.kernels.contact_guard`).

A pair at risk gets impulses along the normal of its dividing plane, inverse to the masses of its corners, so that the
guard gives a body no momentum; each pair's are divided by the number of pairs that push the most concerned of its
corners. After some sweeps all pairs that may be concerned are looked at again. Where that does not end after so many
rounds, everything starts again with half of what nodes wanted to go, in the end with as much as every pair allows.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.boxes import BLOCK, Tables, box_words
from warpdeform.kernels.contact_geometry import closest
from warpdeform.kernels.contact_guard import kept_separation
from warpdeform.kernels.contact_law import contact_law
from warpdeform.kernels.contact_lists import LENGTH, Pair
from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.newton import BLOCKED, OUTCOME

TARGET = 0.7
"""Share of its room that impulses let a pair lose: less than is a risk, as a margin for what they do to each other."""

# Entries of the int32 state of the guard.
ACTIVE = wp.constant(0)
ROUND = wp.constant(1)
HALVE = wp.constant(2)
HALVINGS = wp.constant(3)
LIMITED = wp.constant(4)
UPDATES = wp.constant(5)
PUSHED = wp.constant(6)
SHORTENED = wp.constant(7)
GUARD_STATE = 8


@functools.cache
def contact_impulses(real: Any) -> SimpleNamespace:
    """What takes risks away, for one precision: `Wall`, the plane of a pair, and the kernels."""
    words = lanes(1, real)
    V, store3 = words.V, words.store3
    geometry, Law, at_slot = closest(real), contact_law(real), box_words(real).at_slot
    point_triangle, segment_segment = geometry.point_triangle, geometry.segment_segment
    W = wp.types.vector(4, real)
    zero, one, tiny, kept = real(0.0), real(1.0), real(1e-30), kept_separation(real)
    module = kernel_module("contact_impulses", 1, real)

    @wp.struct
    class Wall:
        """The dividing plane of a pair.

        Attributes:
            n: Unit normal, towards the first side.
            heights: Of the corners along it, from the first corner on [m].
            need: Separation that impulses are to leave [m].
        """

        n: V
        heights: W
        need: real

    @wp.func
    def heights_after(pair: Pair, wall: Wall, directions: wp.array3d(dtype=real)):
        """Heights of the corners when they have gone their way."""
        n = wall.n
        return wall.heights + W(
            wp.dot(n, at_slot(directions, pair.a)), wp.dot(n, at_slot(directions, pair.b)),
            wp.dot(n, at_slot(directions, pair.c)), wp.dot(n, at_slot(directions, pair.d)),
        )  # fmt: skip

    @wp.kernel(module=module)
    def raise_walls(
        threads: int,
        counts: wp.array(dtype=wp.int32),
        pairs: wp.array(dtype=Pair),
        laws: wp.array(dtype=Law),
        points: wp.array3d(dtype=real),
        walls_out: wp.array(dtype=Wall),
    ):
        k = wp.tid()
        while k < counts[LENGTH]:
            pair = pairs[k]
            xa, xb = at_slot(points, pair.a), at_slot(points, pair.b)
            xc, xd = at_slot(points, pair.c), at_slot(points, pair.d)
            wall = Wall()
            r = V()
            if pair.edges == 1:
                r, _s, _t = segment_segment(xa, xb, xc, xd)
            else:
                r, _w = point_triangle(xa, xb, xc, xd)
            n = r / wp.max(wp.length(r), tiny)
            b, c, d = wp.dot(n, xb - xa), wp.dot(n, xc - xa), wp.dot(n, xd - xa)
            separation = wp.min(-c, -d)
            if pair.edges == 1:
                separation = wp.min(separation, wp.min(b - c, b - d))
            else:
                separation = wp.min(separation, -b)
            wall.n = n
            wall.heights = W(zero, b, c, d)
            law = laws[pair.law]
            wall.need = wp.max(kept(separation, law, real(TARGET)), law.floor)
            walls_out[k] = wall
            k += threads

    @wp.func
    def push_apart(u: W, amounts: W, i: int, j: int, need: real, wi: real, wj: real):
        """Give corners i and j, of inverse masses wi and wj, what keeps their heights u apart; the amounts so far."""
        lacking = need - (u[i] + amounts[i]) + (u[j] + amounts[j])
        pushed = amounts
        if lacking > zero and wi + wj > zero:
            pushed[i] = pushed[i] + lacking * wi / (wi + wj)
            pushed[j] = pushed[j] - lacking * wj / (wi + wj)
        return pushed

    @wp.kernel(module=module)
    def find_impulses(
        threads: int,
        counts: wp.array(dtype=wp.int32),
        pairs: wp.array(dtype=Pair),
        walls: wp.array(dtype=Wall),
        inverse_masses: wp.array(dtype=real),
        directions: wp.array3d(dtype=real),
        amounts_out: wp.array(dtype=W),
    ):
        """What each corner of each pair is to go along n [m]."""
        k = wp.tid()
        while k < counts[LENGTH]:
            pair, wall = pairs[k], walls[k]
            u = heights_after(pair, wall, directions)
            wa, wb = inverse_masses[pair.a], inverse_masses[pair.b]
            wc, wd = inverse_masses[pair.c], inverse_masses[pair.d]
            amounts = W()
            if pair.edges == 1:
                amounts = push_apart(u, amounts, 0, 2, wall.need, wa, wc)
                amounts = push_apart(u, amounts, 1, 3, wall.need, wb, wd)
                amounts = push_apart(u, amounts, 0, 3, wall.need, wa, wd)
                amounts = push_apart(u, amounts, 1, 2, wall.need, wb, wc)
            else:
                amounts = push_apart(u, amounts, 0, 1, wall.need, wa, wb)
                amounts = push_apart(u, amounts, 0, 2, wall.need, wa, wc)
                amounts = push_apart(u, amounts, 0, 3, wall.need, wa, wd)
            amounts_out[k] = amounts
            k += threads

    @wp.kernel(module=module)
    def count_pushed(
        starts: wp.array(dtype=wp.int32),
        entries: wp.array(dtype=wp.int32),
        amounts: wp.array(dtype=W),
        pushed_out: wp.array(dtype=wp.int32),
    ):
        """How many pairs push each slot."""
        s = wp.tid()
        if starts[s + 1] > starts[s]:
            pushed = wp.int32(0)
            for k in range(starts[s], starts[s + 1]):
                if amounts[entries[k] >> 2][entries[k] & 3] != zero:
                    pushed += 1
            pushed_out[s] = pushed

    @wp.kernel(module=module)
    def share_impulses(
        threads: int,
        counts: wp.array(dtype=wp.int32),
        pairs: wp.array(dtype=Pair),
        pushed: wp.array(dtype=wp.int32),
        amounts_out: wp.array(dtype=W),
    ):
        """Divide what each pair gives by the number of pairs that push the most concerned of its corners."""
        k = wp.tid()
        while k < counts[LENGTH]:
            pair = pairs[k]
            most = wp.max(wp.max(pushed[pair.a], pushed[pair.b]), wp.max(pushed[pair.c], pushed[pair.d]))
            amounts_out[k] = amounts_out[k] / real(wp.max(most, 1))
            k += threads

    @wp.kernel(module=module)
    def give_impulses(
        starts: wp.array(dtype=wp.int32),
        entries: wp.array(dtype=wp.int32),
        walls: wp.array(dtype=Wall),
        amounts: wp.array(dtype=W),
        directions_out: wp.array3d(dtype=real),
    ):
        """Every slot goes along the normals of its pairs."""
        s = wp.tid()
        if starts[s + 1] > starts[s]:
            d = at_slot(directions_out, s)
            for k in range(starts[s], starts[s + 1]):
                pair = entries[k] >> 2
                d += amounts[pair][entries[k] & 3] * walls[pair].n
            store3(directions_out, 0, s >> 4, s & 15, d)

    @wp.kernel(module=module)
    def return_directions(
        halo: int,
        slots: wp.array2d(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        directions: wp.array3d(dtype=real),
        state_out: wp.array(dtype=wp.int32),
        direction_out: wp.array3d(dtype=real),
    ):
        """Bring what has changed back to the nodes of a body; in the first round count them."""
        row, column = wp.tid()
        i, j = row + 1, column + halo
        s = slots[i, j]
        if s >= 0 and starts[s + 1] > starts[s]:
            d = at_slot(directions, s)
            if (
                state_out[ROUND] == 1
                and state_out[HALVINGS] == 0
                and wp.length(d - words.load3(direction_out, 0, i, j)) > zero
            ):
                wp.atomic_add(state_out, PUSHED, 1)
            store3(direction_out, 0, i, j, d)

    @wp.kernel(module=module)
    def begin_guard(state_out: wp.array(dtype=wp.int32), stirred_out: wp.array(dtype=wp.int32)):
        b = wp.tid()
        stirred_out[b] = 1
        if b == 0:
            state_out[ACTIVE] = 1
            state_out[ROUND] = 0
            state_out[HALVE] = 0
            state_out[HALVINGS] = 0
            state_out[LIMITED] = 0
            state_out[UPDATES] = state_out[UPDATES] + 1

    @wp.kernel(module=module)
    def count_update(state_out: wp.array(dtype=wp.int32)):
        """An update in which nothing was near."""
        state_out[UPDATES] = state_out[UPDATES] + 1

    @wp.kernel(module=module)
    def hold_pinned(
        halo: int,
        slots: wp.array2d(dtype=wp.int32),
        free: wp.array3d(dtype=real),
        unpinned: wp.array(dtype=real),
        inverse_masses_out: wp.array(dtype=real),
    ):
        """Pins may let go: inverse masses are those of the step."""
        row, column = wp.tid()
        i, j = row + 1, column + halo
        s = slots[i, j]
        if s >= 0:
            inverse_masses_out[s] = free[0, i, j] * unpinned[s]

    @wp.kernel(module=module)
    def note_stirred(
        tables: Tables,
        starts: wp.array(dtype=wp.int32),
        lost: wp.array(dtype=wp.int32),
        stirred_out: wp.array(dtype=wp.int32),
    ):
        """Whether a block has corners that may have been given impulses; all have if not all risks were listed."""
        b = wp.tid()
        stirred = wp.where(starts[BLOCK * b + BLOCK] > starts[BLOCK * b] or lost[0] > 0, 1, 0)
        for k in range(tables.border_start[b], tables.border_start[b + 1]):
            s = tables.border[k]
            if starts[s + 1] > starts[s]:
                stirred = 1
        stirred_out[b] = stirred

    @wp.kernel(module=module)
    def begin_round(share_out: wp.array(dtype=real), lost_out: wp.array(dtype=wp.int32)):
        share_out[0] = one
        lost_out[0] = 0

    @wp.kernel(module=module)
    def judge_round(rounds: int, halvings: int, share: wp.array(dtype=real), state_out: wp.array(dtype=wp.int32)):
        """Go on while there are risks; after so many rounds with half of the displacements, in the end shorten them."""
        state_out[ROUND] = state_out[ROUND] + 1
        state_out[HALVE] = 0
        risks = share[0] < one
        if risks and state_out[ROUND] > rounds:
            if state_out[HALVINGS] < halvings:
                state_out[HALVE] = 1
                state_out[HALVINGS] = state_out[HALVINGS] + 1
                state_out[ROUND] = 0
            else:
                state_out[LIMITED] = 1
                state_out[ACTIVE] = 0
            state_out[SHORTENED] = state_out[SHORTENED] + 1
        if not risks:
            state_out[ACTIVE] = 0

    @wp.kernel(module=module)
    def keep_directions(directions: wp.array3d(dtype=real), wanted_out: wp.array3d(dtype=real)):
        s = wp.tid()
        store3(wanted_out, 0, s >> 4, s & 15, at_slot(directions, s))

    @wp.kernel(module=module)
    def halve_wanted(stirred_out: wp.array(dtype=wp.int32), wanted_out: wp.array3d(dtype=real)):
        s = wp.tid()
        store3(wanted_out, 0, s >> 4, s & 15, real(0.5) * at_slot(wanted_out, s))
        stirred_out[s >> 4] = 1

    @wp.kernel(module=module)
    def halve_directions(
        halo: int,
        slots: wp.array2d(dtype=wp.int32),
        wanted: wp.array3d(dtype=real),
        direction_out: wp.array3d(dtype=real),
    ):
        """Half of what nodes wanted to go before the guard changed it."""
        row, column = wp.tid()
        i, j = row + 1, column + halo
        s = slots[i, j]
        d = real(0.5) * words.load3(direction_out, 0, i, j)
        if s >= 0:
            d = at_slot(wanted, s)
        store3(direction_out, 0, i, j, d)

    @wp.kernel(module=module)
    def shorten(
        halo: int, slots: wp.array2d(dtype=wp.int32), share: wp.array(dtype=real), direction_out: wp.array3d(dtype=real)
    ):
        """Multiply a vector with what every pair allows, also of nodes without a slot."""
        row, column = wp.tid()
        i, j = row + 1, column + halo
        store3(direction_out, 0, i, j, share[0] * words.load3(direction_out, 0, i, j))

    @wp.kernel(module=module)
    def find_way(
        halo: int,
        slots: wp.array2d(dtype=wp.int32),
        position: wp.array3d(dtype=real),
        goal: wp.array3d(dtype=real),
        direction_out: wp.array3d(dtype=real),
    ):
        row, column = wp.tid()
        i, j = row + 1, column + halo
        store3(direction_out, 0, i, j, words.load3(goal, 0, i, j) - words.load3(position, 0, i, j))

    @wp.kernel(module=module)
    def go_way(
        halo: int,
        slots: wp.array2d(dtype=wp.int32),
        position: wp.array3d(dtype=real),
        direction: wp.array3d(dtype=real),
        goal_out: wp.array3d(dtype=real),
    ):
        row, column = wp.tid()
        i, j = row + 1, column + halo
        store3(goal_out, 0, i, j, words.load3(position, 0, i, j) + words.load3(direction, 0, i, j))

    @wp.kernel(module=module)
    def measure_lag(
        halo: int,
        slots: wp.array2d(dtype=wp.int32),
        mass: wp.array3d(dtype=real),
        free: wp.array3d(dtype=real),
        target: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        lag_out: wp.array(dtype=real),
    ):
        """How far behind its target the last pinned node is."""
        row, column = wp.tid()
        i, j = row + 1, column + halo
        if mass[0, i, j] > zero and free[0, i, j] == zero:
            away = words.load3(position, 0, i, j) - words.load3(target, 0, i, j)
            wp.atomic_max(lag_out, 0, wp.length(away))

    @wp.kernel(module=module)
    def judge_lag(most: real, lag: wp.array(dtype=real), step_out: wp.array(dtype=wp.int32)):
        """A step whose pins are farther behind than that does not count."""
        if lag[0] > most:
            step_out[OUTCOME] = BLOCKED

    return SimpleNamespace(
        module=module,
        Wall=Wall,
        Amounts=W,
        raise_walls=raise_walls,
        find_impulses=find_impulses,
        count_pushed=count_pushed,
        share_impulses=share_impulses,
        give_impulses=give_impulses,
        return_directions=return_directions,
        begin_guard=begin_guard,
        count_update=count_update,
        hold_pinned=hold_pinned,
        note_stirred=note_stirred,
        begin_round=begin_round,
        judge_round=judge_round,
        keep_directions=keep_directions,
        halve_wanted=halve_wanted,
        halve_directions=halve_directions,
        shorten=shorten,
        find_way=find_way,
        go_way=go_way,
        measure_lag=measure_lag,
        judge_lag=judge_lag,
    )
