"""Impact zones: what impulses leave at risk moves as one for an update (Provot 1997).

Pairs that are still at risk after all rounds of impulses join their corners to a zone, which moves with its mean
displacement, by mass; or with that of its corners that are held. What a zone comes to be at risk with joins it. So the
rounds end, at the latest when all of it is one zone, and what is not near such a place goes its way.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.boxes import BLOCK, Tables, box_words
from warpdeform.kernels.contact_guard import contact_impulses
from warpdeform.kernels.contact_lists import LENGTH, Pair, corner_of
from warpdeform.kernels.lanes import kernel_module, lanes

FINE = 2.0**40
"""Steps of a unit in which masses and displacements are added up, as integers: so no order of addition shows."""

# Entries of the sums of a zone, each of the first two followed by three moments: mass of its free corners, number of
# those that are held, corners.
MASS = wp.constant(0)
HELD = wp.constant(4)
MEMBERS = wp.constant(8)
SUMS = 9


@functools.cache
def contact_zones(real: Any) -> SimpleNamespace:
    """The kernels for one precision."""
    words = lanes(1, real)
    V, store3, at_slot = words.V, words.store3, box_words(real).at_slot
    Wall = contact_impulses(real).Wall
    fine, one, zero = wp.float64(FINE), wp.float64(1.0), real(0.0)
    module = kernel_module("contact_zones", 1, real)

    @wp.kernel(module=module)
    def begin_zones(zones_out: wp.array(dtype=wp.int32)):
        s = wp.tid()
        zones_out[s] = s

    @wp.kernel(module=module)
    def unite(
        threads: int,
        counts: wp.array(dtype=wp.int32),
        pairs: wp.array(dtype=Pair),
        walls: wp.array(dtype=Wall),
        changed_out: wp.array(dtype=wp.int32),
        zones_out: wp.array(dtype=wp.int32),
    ):
        """Corners of a pair at risk belong to the first zone of any of them."""
        k = wp.tid()
        while k < counts[LENGTH]:
            if walls[k].risk == 1:
                pair = pairs[k]
                first = wp.min(zones_out[pair.a], zones_out[pair.b])
                first = wp.min(first, wp.min(zones_out[pair.c], zones_out[pair.d]))
                for corner in range(4):
                    zone = zones_out[corner_of(pair, corner)]
                    if zone > first:
                        wp.atomic_min(zones_out, zone, first)
                        wp.atomic_min(zones_out, corner_of(pair, corner), first)
                        changed_out[0] = 1
            k += threads

    @wp.kernel(module=module)
    def follow(changed_out: wp.array(dtype=wp.int32), zones_out: wp.array(dtype=wp.int32)):
        """A zone that belongs to another is that one."""
        s = wp.tid()
        zone = zones_out[s]
        first = zones_out[zone]
        if first < zone:
            zones_out[s] = first
            changed_out[0] = 1

    @wp.kernel(module=module)
    def begin_unite(changed: int, changed_out: wp.array(dtype=wp.int32)):
        changed_out[0] = changed

    @wp.kernel(module=module)
    def clear_sums(sums_out: wp.array2d(dtype=wp.int64)):
        s = wp.tid()
        for c in range(SUMS):
            sums_out[s, c] = wp.int64(0)

    @wp.kernel(module=module)
    def sum_zones(
        unit: real,
        zones: wp.array(dtype=wp.int32),
        inverse_masses: wp.array(dtype=real),
        directions: wp.array3d(dtype=real),
        sums_out: wp.array2d(dtype=wp.int64),
    ):
        """Sums over every zone, at its first slot; masses in units of `unit`."""
        s = wp.tid()
        zone = zones[s]
        d = at_slot(directions, s)
        wp.atomic_add(sums_out, zone, MEMBERS, wp.int64(1))
        first = HELD
        m = wp.float64(1.0)
        if inverse_masses[s] > zero:
            first = MASS
            m = one / (wp.float64(inverse_masses[s]) * wp.float64(unit))
        wp.atomic_add(sums_out, zone, first, wp.int64(fine * m))
        for c in range(3):
            wp.atomic_add(sums_out, zone, first + 1 + c, wp.int64(fine * m * wp.float64(d[c])))

    @wp.kernel(module=module)
    def move_zones(
        zones: wp.array(dtype=wp.int32),
        inverse_masses: wp.array(dtype=real),
        sums: wp.array2d(dtype=wp.int64),
        directions_out: wp.array3d(dtype=real),
    ):
        """Every slot of a zone of several goes as the zone does; held ones go their way."""
        s = wp.tid()
        zone = zones[s]
        if inverse_masses[s] > zero and sums[zone, MEMBERS] > wp.int64(1):
            first = wp.where(sums[zone, HELD] > wp.int64(0), HELD, MASS)
            total = wp.float64(sums[zone, first])
            x, y = wp.float64(sums[zone, first + 1]) / total, wp.float64(sums[zone, first + 2]) / total
            z = wp.float64(sums[zone, first + 3]) / total
            store3(directions_out, 0, s >> 4, s & 15, V(real(x), real(y), real(z)))

    @wp.kernel(module=module)
    def note_zones(
        tables: Tables,
        zones: wp.array(dtype=wp.int32),
        sums: wp.array2d(dtype=wp.int64),
        lost: wp.array(dtype=wp.int32),
        stirred_out: wp.array(dtype=wp.int32),
    ):
        """Whether a block has corners that belong to a zone of several; all have if not all risks were listed."""
        b = wp.tid()
        stirred = wp.where(lost[0] > 0, 1, 0)
        for s in range(BLOCK * b, BLOCK * b + BLOCK):
            if sums[zones[s], MEMBERS] > wp.int64(1):
                stirred = 1
        for k in range(tables.border_start[b], tables.border_start[b + 1]):
            if sums[zones[tables.border[k]], MEMBERS] > wp.int64(1):
                stirred = 1
        stirred_out[b] = stirred

    @wp.kernel(module=module)
    def return_zones(
        halo: int,
        slots: wp.array2d(dtype=wp.int32),
        zones: wp.array(dtype=wp.int32),
        sums: wp.array2d(dtype=wp.int64),
        directions: wp.array3d(dtype=real),
        direction_out: wp.array3d(dtype=real),
    ):
        """Bring what zones do back to the nodes of a body."""
        row, column = wp.tid()
        i, j = row + 1, column + halo
        s = slots[i, j]
        if s >= 0 and sums[zones[wp.max(s, 0)], MEMBERS] > wp.int64(1):
            store3(direction_out, 0, i, j, at_slot(directions, s))

    return SimpleNamespace(
        module=module,
        begin_zones=begin_zones,
        begin_unite=begin_unite,
        unite=unite,
        follow=follow,
        clear_sums=clear_sums,
        sum_zones=sum_zones,
        move_zones=move_zones,
        note_zones=note_zones,
        return_zones=return_zones,
    )
