"""The halo of a body's component arrays where an axis is periodic (design 2.3)."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.grid import Layout
from warpdeform.kernels.halo import halo


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
        rows, columns = places[:, 0], places[:, 1] - layout.halo
        lanes = layout.groups * layout.lane_width
        launched = (rows >= 1) & (rows <= layout.rows - 2) & (columns >= 0) & (columns < lanes)
        self._device = device
        self._tables: list[wp.array] = [
            wp.array(np.ascontiguousarray(chosen), dtype=wp.int32, device=device)
            for chosen in (places, places[launched])
        ]
        self._kernels = halo(real) if len(places) else None

    def refresh(self, *arrays: wp.array) -> None:
        """Write the halo of component arrays, shape (n, rows, columns)."""
        for array in arrays:
            self._launch("wrap", 0, array)

    def clear(self, *arrays: wp.array) -> None:
        """Zero what kernels over lanes have written into the halo."""
        for array in arrays:
            self._launch("clear", 1, array)

    def surrounded(self, array: wp.array) -> wp.array:
        """Constants with their halo, for kernels that read those of neighbours.

        Returns:
            The array itself where its halo lies outside all lanes; else a copy, because what is summed must not see it.
        """
        if self._kernels is None:
            return array
        array = wp.clone(array) if self._tables[1].shape[0] else array
        self.refresh(array)
        return array

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return sum(int(table.capacity) for table in self._tables)

    def _launch(self, name: str, which: int, array: wp.array) -> None:
        table = self._tables[which]
        if table.shape[0]:
            wp.launch(getattr(self._kernels, name), dim=table.shape[0], inputs=[table, array], device=self._device)


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
