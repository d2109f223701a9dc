"""Friction of the pairs of a contact: what they hold by, and what points keep between steps (design 5.1, 5.2)."""

from typing import Any

import warp as wp

from warpdeform.forces.contact_lists import PairList
from warpdeform.forces.contact_slots import ContactSlots
from warpdeform.forces.force import LAGGED_ITERATIONS
from warpdeform.kernels.contact_friction import contact_friction
from warpdeform.launching import choose


class ContactFriction:
    """Friction with stick anchors; see :mod:`warpdeform.kernels.contact_friction`.

    Args:
        slots: The bodies in slots.
        pairs: The list of pairs.
        stale: Whether the list is new, int32, shape (1,).
        iteration: Newton iteration of the step, int32, shape (1,).
    """

    def __init__(self, slots: ContactSlots, pairs: PairList, stale: wp.array, iteration: wp.array) -> None:
        self._slots, self._pairs, self._stale, self._iteration = slots, pairs, stale, iteration
        self._kernels = contact_friction(slots.real)
        self._start = slots.vectors()
        self._grips = slots.zeros(pairs.capacity, self._kernels.Grip)
        self._anchors = slots.zeros(slots.count, self._kernels.Anchors)

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return sum(int(array.capacity) for array in (self._start, self._grips, self._anchors))

    def begin(self) -> None:
        """A step begins at `x`."""
        self._slots.gather("x", self._start)

    def linearise(self, shares: wp.array, pushes: wp.array) -> None:
        """Add to what pairs do at the slots' points."""
        lagged = (LAGGED_ITERATIONS, self._iteration, self._stale, self._slots.scene.laws)
        self._on_pairs("grip_pairs", *lagged, pushes, self._grips)
        self._on_pairs("push_grips", shares, *self._held(self._slots.points), pushes)

    def add_energies(self, shares: wp.array, points: wp.array, energies: wp.array) -> None:
        """Add the potential [J] of each thread's pairs at some points."""
        self._on_pairs("grip_energies", shares, *self._held(points), energies)

    def finish(self, shares: wp.array) -> None:
        """The step is accepted at the slots' points: keep what has been stretched; the step's friction is over."""
        slots, pairs = self._slots, self._pairs

        def keep() -> None:
            entered = (pairs.starts, pairs.entries, pairs.pairs, shares, self._grips)
            slots.launch(self._kernels.keep_anchors, slots.count, *entered, slots.points, self._start, self._anchors)
            self._on_pairs("release_grips", self._grips)

        def drop() -> None:
            slots.launch(self._kernels.drop_anchors, slots.count, self._anchors)

        choose(pairs.any, keep, drop)

    def clear(self) -> None:
        """Forget what earlier steps have stretched."""
        self._anchors.zero_()
        self._grips.zero_()

    def _held(self, points: wp.array) -> tuple[wp.array, ...]:
        return (self._grips, self._anchors, points, self._start)

    def _on_pairs(self, name: str, *inputs: Any) -> None:
        pairs = self._pairs
        kernel = getattr(self._kernels, name)
        self._slots.launch(kernel, pairs.threads, pairs.threads, pairs.counts, pairs.pairs, *inputs)
