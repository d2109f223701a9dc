"""The halo of a body's component arrays where an axis is periodic or closes at a pole (design 1.3, 2.3)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.grid import Layout, ring_at
from warpdeform.kernels.halo import halo
from warpdeform.launching import launch_alone


class Halo:
    """Keeps the places beside a body in step with the nodes they repeat; bodies without closed axes need none.

    Whoever reads neighbours refreshes what it reads first: positions before it measures them, a search direction before
    it multiplies, stresses before they are gathered. Some of these places lie among the lanes or rows that kernels
    write (behind the last node of a periodic v axis whose count is no multiple of the lane width; between the planes of
    a solid). What is summed over lanes must be zero there: energies and masses are, because their coefficients are;
    coefficients that neighbours read as well are kept twice (`surrounded`); what is gathered is cleared (`clear`).

    Nodes have neighbours across a pole, cells have none: there is no cell between the nodes around a pole and those on
    the other side. So arrays of cells are refreshed by `refresh_cells`, and behind a pole keep what they have.

    Args:
        layout: Memory layout.
        real: ``wp.float32`` or ``wp.float64``.
        device: Warp device.
    """

    def __init__(self, layout: Layout, real: Any, device: Any) -> None:
        seams, poles = halo_places(layout), pole_places(layout)
        places = np.concatenate([seams, poles])
        empty = lanes_of_no_node(layout)
        self._real, self._device = real, device
        self._shared = bool(empty[places[:, 0], places[:, 1]].any())
        rest = np.argwhere(empty & self._shared)
        self._repeated = self._table(places)
        self._seams = self._table(seams) if len(poles) else self._repeated
        self._across = self._table(poles)
        self._rest = self._table(rest)
        self._kernels = halo(real) if len(places) else None

    def refresh(self, *arrays: wp.array) -> None:
        """Write the halo of component arrays of the nodes, shape (n, rows, columns)."""
        for array in arrays:
            self._launch("wrap", self._repeated, array)

    def refresh_cells(self, *arrays: wp.array) -> None:
        """Write the halo of component arrays of the cells, shape (n, rows, columns)."""
        for array in arrays:
            self._launch("wrap", self._seams, array)

    def refresh_turned(self, array: wp.array, turning: "Turning") -> None:
        """Write the halo of what is measured at the nodes along the axes, shape (n, rows, columns)."""
        self._launch("wrap", self._seams, array)
        self._launch("turn", self._across, turning.components, turning.signs, array)

    def turning(self, components: Sequence[int], signs: Sequence[float]) -> "Turning":
        """What becomes of the components of an array where both axes run backwards; see `Turning`."""
        return Turning(
            wp.array(np.array(components, dtype=np.int32), dtype=wp.int32, device=self._device),
            wp.array(np.array(signs, dtype=np.float64), dtype=self._real, device=self._device),
        )

    def clear(self, *arrays: wp.array) -> None:
        """Zero what kernels over lanes have gathered from the halo where no node is."""
        for array in arrays:
            self._launch("clear", self._rest, array)

    def surrounded(self, array: wp.array, cells: bool = False) -> wp.array:
        """Constants of the nodes, or of the cells, with their halo, for kernels that read those of neighbours.

        Returns:
            The array itself where its halo lies outside all lanes; else a copy, because what is summed must not see it.
        """
        if self._kernels is None:
            return array
        array = wp.clone(array) if self._shared else array
        if cells:
            self.refresh_cells(array)
        else:
            self.refresh(array)
        return array

    def bytes(self) -> int:
        """Device memory [bytes]."""
        tables = {table.ptr: table.capacity for table in (self._repeated, self._seams, self._across, self._rest)}
        return int(sum(tables.values()))

    def _table(self, places: NDArray[np.int64]) -> wp.array:
        return wp.array(places, dtype=wp.int32, device=self._device)

    def _launch(self, name: str, table: wp.array, *arguments: wp.array) -> None:
        if table.shape[0]:
            launch_alone(getattr(self._kernels, name), table.shape[0], table, *arguments, device=self._device)


@dataclass(frozen=True)
class Turning:
    """What becomes of the components of an array behind a pole: component c is `signs[c]` times `components[c]`.

    Attributes:
        components: int32, shape (n,).
        signs: 1 or -1, shape (n,).
    """

    components: wp.array
    signs: wp.array


def halo_places(layout: Layout) -> NDArray[np.int64]:
    """Row and column of every place beside a periodic axis and of the node that it repeats, shape (n, 4)."""
    axes = range(len(layout.nodes))
    around = [
        np.arange(-1, n + 1) if wraps else np.arange(n) for n, wraps in zip(layout.nodes, layout.periodic, strict=True)
    ]
    index = np.stack(np.meshgrid(*around, indexing="ij"), axis=-1).reshape(-1, len(axes))
    repeated = index % np.array(layout.nodes)
    beside = (index != repeated).any(axis=1)
    return _table(layout, index[beside], repeated[beside])


def pole_places(layout: Layout) -> NDArray[np.int64]:
    """Row and column of every place behind a pole and of the node on the other side that it repeats, shape (n, 4)."""
    found = [np.zeros((0, 4), dtype=np.int64)]
    for end, pole in zip((0, -1), layout.poles, strict=True):
        if pole:
            around = layout.periodic.index(True)
            count = layout.nodes[around]
            meridians = np.arange(-1, count + 1)
            ring = ring_at(layout.nodes, layout.periodic, end)
            behind, opposite = ring[meridians % count], ring[(meridians + count // 2) % count]
            behind[:, around] = meridians
            behind[:, 1 - around] += 1 if end else -1
            found.append(_table(layout, behind, opposite))
    return np.concatenate(found)


def _table(layout: Layout, index: NDArray[np.int64], repeated: NDArray[np.int64]) -> NDArray[np.int64]:
    """Row and column of places by their index, which may lie beside the grid, and of the nodes that they repeat."""
    rows = layout.first_row + layout.stride * index[:, 0] + (index[:, 1] if len(layout.nodes) == 3 else 0)
    return np.concatenate([np.stack([rows, index[:, -1] + layout.halo], axis=1), layout.places(repeated)], axis=1)


def lanes_of_no_node(layout: Layout) -> NDArray[np.bool_]:
    """Whether kernels over lanes write a place that no node has, shape (rows, columns)."""
    empty = np.zeros((layout.rows, layout.columns), dtype=bool)
    empty[1:-1, layout.halo : layout.halo + layout.groups * layout.lane_width] = True
    empty[layout.node_rows.reshape(-1), layout.halo : layout.halo + layout.nodes[-1]] = False
    return empty
