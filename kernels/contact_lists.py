"""Lists of pairs in a fixed order, and the pairs of each slot: count, scan, fill; no atomic decides an order.

What a search finds stands in rows, one per thread of the search. A list packs the rows one after the other, those of
points and triangles first. Its capacity is fixed: what does not fit is counted and left out.
"""

import functools
from types import SimpleNamespace

import warp as wp

from warpdeform.kernels.boxes import Tables
from warpdeform.kernels.lanes import kernel_module

CHUNK = 256
"""Numbers that one thread of a scan adds up."""

# Entries of the int32 counts of a list: its pairs, some or none, and pairs that were left out in this step.
LENGTH = wp.constant(0)
ANY = wp.constant(1)
LOST = wp.constant(2)
COUNTS = 3


@wp.struct
class Pair:
    """Two simplices by the slots of their corners.

    Attributes:
        a, b, c, d: Slots: of the point and of its triangle, or of both ends of either edge.
        edges: 1 for two edges.
        law: What holds between their bodies.
        close: 1 if they feel each other only when very close.
    """

    a: wp.int32
    b: wp.int32
    c: wp.int32
    d: wp.int32
    edges: wp.int32
    law: wp.int32
    close: wp.int32


@wp.func
def corner_of(pair: Pair, k: int):
    """Slot of corner k."""
    s = pair.a
    if k == 1:
        s = pair.b
    if k == 2:
        s = pair.c
    if k == 3:
        s = pair.d
    return s


@functools.cache
def contact_lists() -> SimpleNamespace:
    """The kernels; the same for every precision and lane width."""
    module = kernel_module("contact_lists", 1, wp.float64)

    @wp.kernel(module=module)
    def sum_chunks(numbers: wp.array(dtype=wp.int32), sums_out: wp.array(dtype=wp.int32)):
        chunk = wp.tid()
        total = wp.int32(0)
        for k in range(chunk * CHUNK, wp.min((chunk + 1) * CHUNK, numbers.shape[0])):
            total += numbers[k]
        sums_out[chunk] = total

    @wp.kernel(module=module)
    def scan_sums(sums_out: wp.array(dtype=wp.int32)):
        total = wp.int32(0)
        for k in range(sums_out.shape[0]):
            n = sums_out[k]
            sums_out[k] = total
            total += n

    @wp.kernel(module=module)
    def scan_chunks(
        numbers: wp.array(dtype=wp.int32), sums: wp.array(dtype=wp.int32), starts_out: wp.array(dtype=wp.int32)
    ):
        """The sum of the numbers before each, and of all of them at the end."""
        chunk = wp.tid()
        total = sums[chunk]
        end = wp.min((chunk + 1) * CHUNK, numbers.shape[0])
        for k in range(chunk * CHUNK, end):
            starts_out[k] = total
            total += numbers[k]
        if end == numbers.shape[0]:
            starts_out[end] = total

    @wp.kernel(module=module)
    def note_length(capacity: int, starts: wp.array(dtype=wp.int32), counts_out: wp.array(dtype=wp.int32)):
        total = starts[starts.shape[0] - 1]
        length = wp.min(total, capacity)
        counts_out[LENGTH] = length
        counts_out[ANY] = wp.where(length > 0, 1, 0)
        counts_out[LOST] = counts_out[LOST] + total - length

    @wp.kernel(module=module)
    def fill_pairs(
        tables: Tables,
        parts: int,
        starts: wp.array(dtype=wp.int32),
        points: wp.array2d(dtype=wp.int32),
        edges: wp.array2d(dtype=wp.int32),
        pairs_out: wp.array(dtype=Pair),
    ):
        """Pairs of one row of the search, points and triangles, then edges."""
        row = wp.tid()
        mine = tables.body[row // parts] * tables.bodies
        pair = Pair()
        start = starts[row]
        for k in range(wp.min(starts[row + 1], pairs_out.shape[0]) - start):
            t = points[row, 2 * k + 1]
            pair.a = points[row, 2 * k]
            pair.b = tables.triangle_a[t >> 4, t & 15]
            pair.c = tables.triangle_b[t >> 4, t & 15]
            pair.d = tables.triangle_c[t >> 4, t & 15]
            pair.law = mine + tables.body[pair.b >> 4]
            pairs_out[start + k] = pair
        pair.edges = 1
        start = starts[points.shape[0] + row]
        for k in range(wp.min(starts[points.shape[0] + row + 1], pairs_out.shape[0]) - start):
            e, signed = edges[row, 2 * k], edges[row, 2 * k + 1]
            g = wp.where(signed < 0, -1 - signed, signed)
            pair.close = wp.where(signed < 0, 1, 0)
            pair.a = tables.edge_a[e >> 4, e & 15]
            pair.b = tables.edge_b[e >> 4, e & 15]
            pair.c = tables.edge_a[g >> 4, g & 15]
            pair.d = tables.edge_b[g >> 4, g & 15]
            pair.law = mine + tables.body[pair.c >> 4]
            pairs_out[start + k] = pair

    @wp.kernel(module=module)
    def clear(numbers_out: wp.array(dtype=wp.int32)):
        numbers_out[wp.tid()] = 0

    @wp.kernel(module=module)
    def count_corners(
        threads: int,
        counts: wp.array(dtype=wp.int32),
        pairs: wp.array(dtype=Pair),
        numbers_out: wp.array(dtype=wp.int32),
    ):
        """How many corners of pairs lie in each slot."""
        k = wp.tid()
        while k < counts[LENGTH]:
            for corner in range(4):
                wp.atomic_add(numbers_out, corner_of(pairs[k], corner), 1)
            k += threads

    @wp.kernel(module=module)
    def enter_corners(
        threads: int,
        counts: wp.array(dtype=wp.int32),
        pairs: wp.array(dtype=Pair),
        starts: wp.array(dtype=wp.int32),
        numbers_out: wp.array(dtype=wp.int32),
        entries_out: wp.array(dtype=wp.int32),
    ):
        """Enter 4 k + corner of pair k at the corner's slot; `numbers_out` is counted down to zero again."""
        k = wp.tid()
        while k < counts[LENGTH]:
            for corner in range(4):
                s = corner_of(pairs[k], corner)
                last = wp.atomic_sub(numbers_out, s, 1)
                entries_out[starts[s] + last - 1] = 4 * k + corner
            k += threads

    @wp.kernel(module=module)
    def sort_entries(starts: wp.array(dtype=wp.int32), entries_out: wp.array(dtype=wp.int32)):
        """Entries of each slot in ascending order: so it does not matter in which they were entered."""
        s = wp.tid()
        first = starts[s]
        for k in range(first + 1, starts[s + 1]):
            entry = wp.int32(entries_out[k])
            place = wp.int32(k)
            while place > first and entries_out[place - 1] > entry:
                entries_out[place] = entries_out[place - 1]
                place -= 1
            entries_out[place] = entry

    return SimpleNamespace(
        module=module,
        sum_chunks=sum_chunks,
        scan_sums=scan_sums,
        scan_chunks=scan_chunks,
        note_length=note_length,
        fill_pairs=fill_pairs,
        clear=clear,
        count_corners=count_corners,
        enter_corners=enter_corners,
        sort_entries=sort_entries,
    )
