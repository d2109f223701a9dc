"""Lists of pairs on the device: what a search finds, packed in a fixed order, and the pairs of every slot."""

from typing import Any

import warp as wp

from warpdeform.kernels.contact_lists import ANY, CHUNK, COUNTS, LOST, Pair, contact_lists
from warpdeform.launching import choose, launch_alone

THREADS = 4096
"""Threads that share a list on CUDA; on the CPU one goes through it."""


class FoundRows:
    """What the threads of a search find, a row each.

    Args:
        rows: Threads of the search.
        capacity: Pairs of either kind that a row holds.
        device: Warp device.
    """

    def __init__(self, rows: int, capacity: int, device: Any) -> None:
        self.rows = rows
        self.numbers: wp.array = wp.zeros(2 * rows, dtype=wp.int32, device=device)
        self.points: wp.array = wp.zeros((rows, 2 * capacity), dtype=wp.int32, device=device)
        self.edges: wp.array = wp.zeros((rows, 2 * capacity), dtype=wp.int32, device=device)

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return int(self.numbers.capacity + self.points.capacity + self.edges.capacity)


class PairList:
    """Pairs, and which of them each slot belongs to.

    Args:
        found: Where searches leave what goes into the list.
        parts: Threads of the search that share a block.
        slots: Number of slots.
        capacity: Pairs that it holds.
        device: Warp device.

    Attributes:
        counts: int32 (LENGTH, ANY, LOST) of :mod:`warpdeform.kernels.contact_lists`.
        any: View of `counts`: whether there are pairs.
        pairs: The pairs.
        starts: First of `entries` of each slot, one more at the end.
        entries: 4 k + corner for each pair k of a slot.
        threads: Threads that go through the list.
    """

    def __init__(self, found: FoundRows, parts: int, slots: int, capacity: int, device: Any) -> None:
        self._found, self._parts, self._slots, self._device = found, parts, slots, device
        self.capacity, self.threads = capacity, THREADS if device.is_cuda else 1

        def zeros(count: int, dtype: Any = wp.int32) -> wp.array:
            return wp.zeros(count, dtype=dtype, device=device)

        self.counts = zeros(COUNTS)
        self.any, self.lost = self.counts[ANY : ANY + 1], self.counts[LOST : LOST + 1]
        self.pairs = zeros(capacity, Pair)
        self._row_starts, self._row_sums = zeros(2 * found.rows + 1), zeros(-(-2 * found.rows // CHUNK))
        self._numbers, self._slot_sums = zeros(slots), zeros(-(-slots // CHUNK))
        self.starts, self.entries = zeros(slots + 1), zeros(4 * capacity)
        self._kernels = contact_lists()

    def bytes(self) -> int:
        """Device memory [bytes]."""
        arrays = (self.counts, self.pairs, self._row_starts, self._row_sums, self._numbers, self._slot_sums)
        return sum(int(array.capacity) for array in (*arrays, self.starts, self.entries))

    def pack(self, tables: Any) -> None:
        """Take over what the last search has found."""
        found = self._found
        self._scan(found.numbers, self._row_sums, self._row_starts)
        self._launch("note_length", 1, self.capacity, self._row_starts, self.counts)
        choose(self.any, lambda: self._fill(tables), None)

    def _fill(self, tables: Any) -> None:
        found = self._found
        self._launch(
            "fill_pairs", found.rows, tables, self._parts, self._row_starts, found.points, found.edges, self.pairs
        )
        self._launch("clear", self._slots, self._numbers)
        self._launch("count_corners", self.threads, self.threads, self.counts, self.pairs, self._numbers)
        self._scan(self._numbers, self._slot_sums, self.starts)
        inputs = (self.threads, self.counts, self.pairs, self.starts)
        self._launch("enter_corners", self.threads, *inputs, self._numbers, self.entries)
        self._launch("sort_entries", self._slots, self.starts, self.entries)

    def _scan(self, numbers: wp.array, sums: wp.array, starts: wp.array) -> None:
        chunks = sums.shape[0]
        self._launch("sum_chunks", chunks, numbers, sums)
        self._launch("scan_sums", 1, sums)
        self._launch("scan_chunks", chunks, numbers, sums, starts)

    def _launch(self, name: str, dim: int, *inputs: Any) -> None:
        launch_alone(getattr(self._kernels, name), dim, *inputs, device=self._device)
