"""The parameter grid of a body and how its nodes lie in device memory."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST_GROWTH = 2.2
"""Largest growth of the spacing from a grid of a multigrid hierarchy to the next."""
AROUND_POLES = 0.3
"""Part of the mean distance of neighbours around poles at which grids are coarsened: beside the poles they are closer.

Without it a sphere of 128 x 64 nodes takes up to 111 iterations, with it 26.
"""


@dataclass(frozen=True)
class ParameterGrid:
    """A regular grid of material coordinates: u of curves, (u, v) of surfaces, (u, v, w) of solids.

    A curve's second axis counts its strands, which nothing connects: side by side they fill the lanes.

    Attributes:
        nodes: Nodes along each axis, each at least 2 (strands: at least 1).
        spacing: Parameter spacings, in the units of the parametrisation.
        periodic: Axes whose index wraps; a periodic axis has as many cells as nodes.
        dimension: Axes along which nodes are connected: 1 for curves, 2 for surfaces, 3 for solids.
        poles: Ends, start and end, of the open axis of a surface that close at a pole; the other axis is periodic with
            an even number of nodes, and the nodes beside a pole lie half a step from it, opposite each other.
    """

    nodes: tuple[int, ...]
    spacing: tuple[float, ...]
    periodic: tuple[bool, ...] = ()
    dimension: int = 0
    poles: tuple[bool, bool] = (False, False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "periodic", self.periodic or (False,) * len(self.nodes))
        object.__setattr__(self, "dimension", self.dimension or len(self.nodes))

    @property
    def cells(self) -> tuple[int, ...]:
        """Cells along each axis; of a curve's second axis, its strands."""
        wraps = [p or axis >= self.dimension for axis, p in enumerate(self.periodic)]
        return tuple(n if w else n - 1 for n, w in zip(self.nodes, wraps, strict=True))

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return int(np.prod(self.nodes))

    def coarser(self, lengths: tuple[float, ...]) -> "ParameterGrid | None":
        """The next grid of a multigrid hierarchy: half as fine on every axis worth coarsening.

        Those are the connected axes with more than three nodes (periodic: four) that are spaced less than twice as far
        as the closest of them, so that stretched grids grow square before they grow coarse (design 7.1). Nodes stay
        equally spaced, so that the kernels of the fine grid serve the coarse one; they need not coincide with fine
        nodes. Half the nodes, rounded up, keep whole lane groups whole (64, 32, 16); where that would widen the spacing
        by more than `MOST_GROWTH` it is half the cells, rounded up. Around
        poles the number stays even.

        Args:
            lengths: Mean distance of neighbours along each axis [m].

        Returns:
            The coarser grid, or None if no axis can be coarsened.
        """
        axes = range(len(self.nodes))
        open_axes = [k < self.dimension and self.nodes[k] > (4 if self.periodic[k] else 3) for k in axes]
        if not any(open_axes):
            return None
        if any(self.poles):
            lengths = tuple(
                length * (AROUND_POLES if wraps else 1.0) for length, wraps in zip(lengths, self.periodic, strict=True)
            )
        limit = 2.0 * min(lengths[k] for k in axes if open_axes[k])
        nodes, spacing = [], []
        for axis, cells in enumerate(self.cells):
            halve = open_axes[axis] and lengths[axis] < limit
            ends = self.nodes[axis] - cells
            fewer = cells
            if halve:
                fewer = -(-self.nodes[axis] // 2) - ends
                if cells > MOST_GROWTH * fewer:
                    fewer = -(-cells // 2)
                if any(self.poles) and self.periodic[axis]:
                    fewer += fewer % 2
            nodes.append(fewer + ends)
            spacing.append(self.spacing[axis] * cells / fewer)
        return ParameterGrid(tuple(nodes), tuple(spacing), self.periodic, self.dimension, self.poles)

    @property
    def rings(self) -> list[NDArray[np.int64]]:
        """Indices of the nodes around each pole, shape (n, 2) each."""
        return [ring_at(self.nodes, self.periodic, end) for end, pole in zip((0, -1), self.poles, strict=True) if pole]

    def closed(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values per node, shape (*nodes, ...), with the first ones again behind the last along periodic axes."""
        for axis in range(self.dimension):
            values = self._wrapped(values, axis)
        return values

    def differences(self, values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
        """Differences of values per node, shape (*nodes, ...), to the next node along a connected axis."""
        return np.asarray(np.diff(self._wrapped(values, axis), axis=axis))

    def means(self, values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
        """Means of values per node along a connected axis, shape (..., nodes, ...), with the next ones."""
        values = self._wrapped(values, axis)
        count = values.shape[axis] - 1
        return 0.5 * (np.take(values, range(count), axis=axis) + np.take(values, range(1, count + 1), axis=axis))

    def _wrapped(self, values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
        """The values, with the first ones again behind the last if the axis is periodic."""
        return np.concatenate([values, np.take(values, [0], axis=axis)], axis=axis) if self.periodic[axis] else values

    def parameters(self) -> NDArray[np.float64]:
        """Material coordinates of the nodes, scaled to 0..1 along each axis, shape (*nodes, axes); 0 or 1 at a pole."""
        return self._places([np.arange(count) for count in self.nodes])

    def cell_parameters(self) -> NDArray[np.float64]:
        """Material coordinates of the middles of the cells, shape (*cells, axes); of strands, their own."""
        return self._places([
            np.arange(count) + (0.5 if axis < self.dimension else 0.0) for axis, count in enumerate(self.cells)
        ])  # fmt: skip

    def _places(self, along: Sequence[NDArray[Any]]) -> NDArray[np.float64]:
        """Material coordinates at places counted in nodes along each axis."""
        scaled = []
        for axis, (places, cells) in enumerate(zip(along, self.cells, strict=True)):
            start, end = (0.0, 0.0) if self.periodic[axis] else (0.5 * pole for pole in self.poles)
            steps = cells if axis < self.dimension else self.nodes[axis] - 1
            scaled.append((places + start) / max(steps + start + end, 1))
        return np.stack(np.meshgrid(*scaled, indexing="ij"), axis=-1)

    def cells_to_nodes(self, cells: NDArray[np.float64]) -> NDArray[np.float64]:
        """Share a quantity of each cell, shape (*cells), equally among its corners: trapezoid weights.

        Returns:
            Node shares, shape (*nodes); their sum is the sum over the cells.
        """
        shares = np.zeros(self.nodes)
        for corner in product((0, 1), repeat=self.dimension):
            shares[self.corner_of_cells(corner)] += cells / 2.0**self.dimension
        return shares

    def corner_of_cells(self, corner: tuple[int, ...]) -> tuple[NDArray[np.int64], ...]:
        """Index of the nodes that are one corner, 0 or 1 along each connected axis, of all cells."""
        steps = (*corner, 0)[: len(self.nodes)]
        along = zip(self.cells, steps, self.nodes, strict=True)
        return np.ix_(*[(np.arange(cells) + step) % n for cells, step, n in along])

    def cell_means(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Means of values per node, shape (*nodes, ...), over the corners of the cells, shape (*cells, ...)."""
        corners = list(product((0, 1), repeat=self.dimension))
        return np.asarray(sum(values[self.corner_of_cells(corner)] for corner in corners) / len(corners))


@dataclass(frozen=True)
class Layout:
    """Component arrays [component, row, column] with a halo: the last axis runs along the columns, all others the rows.

    Node (i, j) of a curve or surface lies at row i + 1, column j + halo; node (i, j, k) of a solid at row
    first_row + i stride + j, column k + halo, so that its neighbours along u are `stride` rows away. Columns are filled
    up to whole lane groups and framed by one group on each side, rows by as many as a neighbour can be away (planes of
    a solid share a row between them), so that kernels read neighbours without a border test. Everything outside the
    body is zero and stays zero, but for the halo of periodic axes.

    Attributes:
        nodes: Nodes along each axis: two or three.
        lane_width: Nodes per lane group.
        periodic: Axes whose index wraps; planes of a solid that is periodic along v share no row.
        poles: Ends of the open axis that close at a pole, as in :class:`ParameterGrid`.
        halo: Columns before the first node.
        groups: Lane groups in a row, halo not included.
        stride: Rows from a node to its neighbour along u.
        first_row: Row of the first node.
    """

    nodes: tuple[int, ...]
    lane_width: int
    periodic: tuple[bool, ...] = ()
    poles: tuple[bool, bool] = (False, False)
    halo: int = field(init=False)
    groups: int = field(init=False)
    stride: int = field(init=False)
    first_row: int = field(init=False)

    def __post_init__(self) -> None:
        solid = len(self.nodes) == 3
        wraps = solid and len(self.periodic) == 3 and self.periodic[1]
        stride = self.nodes[1] + (2 if wraps else 1) if solid else 1
        object.__setattr__(self, "periodic", self.periodic or (False,) * len(self.nodes))
        object.__setattr__(self, "halo", self.lane_width)
        object.__setattr__(self, "groups", -(-self.nodes[-1] // self.lane_width))
        object.__setattr__(self, "stride", stride)
        object.__setattr__(self, "first_row", stride + 1 if solid else 1)

    @property
    def node_rows(self) -> NDArray[np.int64]:
        """Rows of the nodes, shape (nodes along all axes but the last)."""
        rows = self.first_row + self.stride * np.arange(self.nodes[0])
        return rows if len(self.nodes) == 2 else np.add.outer(rows, np.arange(self.nodes[1]))

    @property
    def rows(self) -> int:
        """Rows of an array, halo included."""
        return int(self.node_rows.max()) + self.first_row + 1

    @property
    def columns(self) -> int:
        """Columns of an array, halo included."""
        return (self.groups + 2) * self.lane_width

    @property
    def lane_dim(self) -> tuple[int, int]:
        """Launch dimensions of a lane kernel that reads no neighbours: one thread per lane group, rows from 1 on."""
        return (self.rows - 2, self.groups)

    @property
    def node_dim(self) -> tuple[int, int]:
        """Launch dimensions of a kernel with one thread per place, rows from 1 on, columns from `halo` on.

        Some places belong to no node; their mass is zero.
        """
        return (self.rows - 2, self.groups * self.lane_width)

    def places(self, nodes: NDArray[np.integer]) -> NDArray[np.int64]:
        """Row and column of nodes, given by their indices, shape (k, axes): shape (k, 2)."""
        rows = self.node_rows[tuple(nodes[:, axis] for axis in range(len(self.nodes) - 1))]
        return np.stack([rows, nodes[:, -1] + self.halo], axis=-1)

    def pack(self, values: NDArray[np.generic]) -> NDArray[np.float64]:
        """Host values per node, shape (*nodes) or (*nodes, n), to component form (n, rows, columns).

        Values on fewer samples than nodes (cells, edges) fill the first rows and columns; the rest is zero.
        """
        axes = len(self.nodes)
        values = values[..., None] if values.ndim == axes else values
        *across, along, components = values.shape
        rows = self.node_rows[tuple(slice(count) for count in across)].reshape(-1)
        packed = np.zeros((components, self.rows, self.columns))
        packed[:, rows, self.halo : self.halo + along] = np.moveaxis(values, -1, 0).reshape(components, -1, along)
        return packed

    def unpack(self, packed: NDArray[np.generic], samples: tuple[int, ...] | None = None) -> NDArray[np.float64]:
        """The inverse of `pack`: (n, rows, columns) to a fresh array (*nodes, n), or of fewer `samples` than nodes."""
        *across, along = samples or self.nodes
        rows = self.node_rows[tuple(slice(count) for count in across)].reshape(-1)
        values = np.moveaxis(packed[:, rows, self.halo : self.halo + along], 0, -1).reshape(*across, along, -1)
        return np.array(values, dtype=np.float64, order="C")


def ring_at(nodes: tuple[int, ...], periodic: tuple[bool, ...], end: int) -> NDArray[np.int64]:
    """Indices of the nodes at the start (0) or the end (-1) of the open axis of a surface, shape (n, 2).

    They come in the order of its periodic axis.
    """
    around = periodic.index(True)
    ring = np.zeros((nodes[around], 2), dtype=np.int64)
    ring[:, around] = np.arange(nodes[around])
    ring[:, 1 - around] = end % nodes[1 - around]
    return ring
