"""The halo of a body's component arrays where an axis is periodic (design 2.3)."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.grid import Layout
from warpdeform.kernels.halo import halo
from warpdeform.launching import launch_alone


class Halo:
    """Keeps the places beside a body in step with the other end of their axis; bodies without such an axis need none.

    Whoever reads neighbours refreshes what it reads first: positions before it measures them, a search direction before
    it multiplies, stresses before they are gathered. Some of these places lie among the lanes or rows that kernels
    write (behind the last node of a periodic v axis whose count is no multiple of the lane width; between the planes of
    a solid). What is summed over lanes must be zero there: energies and masses are, because their coefficients are;
    coefficients that neighbours read as well are kept twice (`surrounded`); what is gathered is cleared (`clear`).

    Args:
        layout: Memory layout.
        real: ``wp.float32`` or ``wp.float64``.
        device: Warp device.
    """

    def __init__(self, layout: Layout, real: Any, device: Any) -> None:
        places = halo_places(layout)
        empty = lanes_of_no_node(layout)
        self._device = device
        self._shared = bool(empty[places[:, 0], places[:, 1]].any())
        rest = np.argwhere(empty & self._shared)
        self._repeated: wp.array = wp.array(places, dtype=wp.int32, device=device)
        self._rest: wp.array = wp.array(rest, dtype=wp.int32, device=device)
        self._kernels = halo(real) if len(places) else None

    def refresh(self, *arrays: wp.array) -> None:
        """Write the halo of component arrays, shape (n, rows, columns)."""
        for array in arrays:
            self._launch("wrap", self._repeated, array)

    def clear(self, *arrays: wp.array) -> None:
        """Zero what kernels over lanes have gathered from the halo where no node is."""
        for array in arrays:
            self._launch("clear", self._rest, array)

    def surrounded(self, array: wp.array) -> wp.array:
        """Constants with their halo, for kernels that read those of neighbours.

        Returns:
            The array itself where its halo lies outside all lanes; else a copy, because what is summed must not see it.
        """
        if self._kernels is None:
            return array
        array = wp.clone(array) if self._shared else array
        self.refresh(array)
        return array

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return int(self._repeated.capacity) + int(self._rest.capacity)

    def _launch(self, name: str, table: wp.array, array: wp.array) -> None:
        if table.shape[0]:
            launch_alone(getattr(self._kernels, name), table.shape[0], table, array, device=self._device)


def halo_places(layout: Layout) -> NDArray[np.int64]:
    """Row and column of every place of the halo and of the node that it repeats, shape (n, 4)."""
    axes = range(len(layout.nodes))
    around = [
        np.arange(-1, n + 1) if wraps else np.arange(n) for n, wraps in zip(layout.nodes, layout.periodic, strict=True)
    ]
    index = np.stack(np.meshgrid(*around, indexing="ij"), axis=-1).reshape(-1, len(axes))
    repeated = index % np.array(layout.nodes)
    beside = (index != repeated).any(axis=1)
    index, repeated = index[beside], repeated[beside]
    rows = layout.first_row + layout.stride * index[:, 0] + (index[:, 1] if len(axes) == 3 else 0)
    return np.concatenate([np.stack([rows, index[:, -1] + layout.halo], axis=1), layout.places(repeated)], axis=1)


def lanes_of_no_node(layout: Layout) -> NDArray[np.bool_]:
    """Whether kernels over lanes write a place that no node has, shape (rows, columns)."""
    empty = np.zeros((layout.rows, layout.columns), dtype=bool)
    empty[1:-1, layout.halo : layout.halo + layout.groups * layout.lane_width] = True
    empty[layout.node_rows.reshape(-1), layout.halo : layout.halo + layout.nodes[-1]] = False
    return empty
