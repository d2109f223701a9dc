"""Sums over all bodies in a fixed order: lanes, then groups of a row, then rows (:mod:`warpdeform.kernels.krylov`)."""

from collections.abc import Sequence

import warp as wp

from warpdeform.kernels.krylov import reductions
from warpdeform.launching import PerRow, launch_alone, launch_rows
from warpdeform.state import State


class Sums:
    """Reduces the partial sums of all bodies to one number on the device.

    Args:
        states: The bodies.
    """

    def __init__(self, states: Sequence[State]) -> None:
        self.states = tuple(states)
        self._device = states[0].device
        self._offsets: list[int] = []
        count = 0
        for state in states:
            self._offsets.append(count)
            count += state.layout.lane_dim[0]
        self.rows: wp.array = wp.zeros((2, count), dtype=wp.float64, device=self._device)

    def gather_dots(self) -> None:
        """Add up `State.dots`, one entry per lane group, into rows."""
        self._rows(reductions().sum_rows, "dots", by_lanes=True)

    def total_dots(self, entry: int, scalars: wp.array) -> None:
        """Sum of `State.dots` into `scalars[entry]`, of its magnitudes into the next entry."""
        self.gather_dots()
        self._total(entry, scalars)

    def total_partials(self, entry: int, scalars: wp.array) -> None:
        """Sum of `State.partials`, one entry per node, into `scalars[entry]`, of its magnitudes into the next."""
        self._rows(reductions().sum_rows, "partials", by_lanes=False)
        self._total(entry, scalars)

    def greatest_dots(self, entry: int, scalars: wp.array) -> None:
        """Largest entry of `State.dots` into `scalars[entry]`."""
        self._rows(reductions().max_rows, "dots", by_lanes=True)
        launch_alone(reductions().greatest, 1, self.rows, entry, scalars, device=self._device)

    def _rows(self, kernel: wp.Kernel, partials: str, by_lanes: bool) -> None:
        for state, offset in zip(self.states, self._offsets, strict=True):
            stride = state.lane_width if by_lanes else 1
            rows = PerRow(self.rows[:, offset : offset + state.layout.lane_dim[0]])
            launch_rows(kernel, state.layout, getattr(state, partials), stride, rows, device=self._device)

    def _total(self, entry: int, scalars: wp.array) -> None:
        launch_alone(reductions().total, 1, self.rows, entry, scalars, device=self._device)
