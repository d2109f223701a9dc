"""From a grid to the next coarser one and back: linear interpolation between equally spaced nodes (design 7.1)."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.grid import Layout, ParameterGrid
from warpdeform.kernels.transfer import transfer_tables

Array = NDArray[np.float64]


class Transfer:
    """The step between two grids of a hierarchy; coarse nodes need not be fine nodes.

    Args:
        fine: Grid of the fine level.
        fine_layout: Its memory layout.
        coarse: Grid of the coarse level, with as many cells as the fine one or fewer, down to half, along each axis.
        real: ``wp.float32`` or ``wp.float64``.
        device: Warp device.

    Attributes:
        coarse: Grid of the coarse level.
        layout: Memory layout of the coarse level.
        growth: Coarse over fine spacing along each axis.
        prolong: Tables of the interpolation P from coarse to fine nodes.
        restrict: Tables of its transpose.
        positions: Tables that interpolate fine positions at the coarse nodes.
        cells: Tables that average over the fine cells of each coarse cell.
    """

    def __init__(self, fine: ParameterGrid, fine_layout: Layout, coarse: ParameterGrid, real: Any, device: Any) -> None:
        self.coarse, self._real, self._device = coarse, real, device
        self.layout = Layout(coarse.nodes, fine_layout.lane_width)
        steps = list(zip(fine.cells, coarse.cells, fine.periodic, strict=True))
        self.growth = (fine.cells[0] / coarse.cells[0], fine.cells[1] / coarse.cells[1])
        prolong = [_interpolation(f, c, periodic) for f, c, periodic in steps]
        self._prolong = prolong
        self._positions = [_interpolation(c, f, periodic) for f, c, periodic in steps]
        self.prolong = self._tables(prolong, self.layout, fine_layout)
        self.restrict = self._tables([weights.T for weights in prolong], fine_layout, self.layout)
        self.positions = self._tables(self._positions, fine_layout, self.layout)
        self.cells = self._tables([_averages(f, c) for f, c, _ in steps], fine_layout, self.layout)

    def sample(self, values: Array) -> Array:
        """Values at the fine nodes, shape (nu, nv, n), interpolated at the coarse nodes (host)."""
        along_u, along_v = self._positions
        return np.einsum("Ii,Jj,ijn->IJn", along_u, along_v, values)

    def gather(self, values: Array) -> Array:
        """Fine values, shape (nu, nv), shared among the coarse nodes by the transpose of the interpolation (host)."""
        along_u, along_v = self._prolong
        return along_u.T @ values @ along_v

    def bytes(self) -> int:
        """Device memory [bytes]."""
        maps = (self.prolong, self.restrict, self.positions, self.cells)
        return sum(a.capacity for m in maps for a in (m.rows, m.row_weights, m.columns, m.column_weights))

    def _tables(self, weights: list[Array], source: Layout, target: Layout) -> Any:
        rows, row_weights = _taps(weights[0], 1, 1, target.rows)
        columns, column_weights = _taps(weights[1], source.halo, target.halo, target.columns)
        tables = transfer_tables(self._real)()
        tables.rows = wp.array(rows, dtype=wp.int32, device=self._device)
        tables.row_weights = wp.array(row_weights, dtype=self._real, device=self._device)
        tables.columns = wp.array(columns, dtype=wp.int32, device=self._device)
        tables.column_weights = wp.array(column_weights[:, None, :], dtype=self._real, device=self._device)
        return tables


def _interpolation(targets: int, sources: int, periodic: bool) -> Array:
    """Weights of linear interpolation between the nodes of one axis, shape (target nodes, source nodes).

    Args:
        targets: Cells of the grid that is interpolated to.
        sources: Cells of the grid that has the values.
        periodic: The axis wraps; it has as many nodes as cells.
    """
    nodes, points = (sources, targets) if periodic else (sources + 1, targets + 1)
    at = np.arange(points) * sources
    lower = np.minimum(at // targets, sources - 1)
    upper_weight = at / targets - lower
    weights = np.zeros((points, nodes))
    weights[np.arange(points), lower] = 1.0 - upper_weight
    weights[np.arange(points), (lower + 1) % nodes] += upper_weight
    return weights


def _averages(fine: int, coarse: int) -> Array:
    """Shares of the fine cells in each coarse cell of one axis, shape (coarse cells, fine cells); rows add up to 1."""
    edges = np.arange(coarse + 1) * fine / coarse
    left, right = np.arange(fine), np.arange(1, fine + 1)
    overlap = np.minimum(edges[1:, None], right) - np.maximum(edges[:-1, None], left)
    return np.maximum(overlap, 0.0) * coarse / fine


def _taps(weights: Array, source_offset: int, target_offset: int, size: int) -> tuple[NDArray[np.int32], Array]:
    """Nonzero weights as a table, shape (taps, size), of indices and of weights; the rest is zero, with index zero."""
    chosen = [np.flatnonzero(row) for row in weights]
    indices = np.zeros((max(map(len, chosen)), size), dtype=np.int32)
    values = np.zeros(indices.shape)
    for target, sources in enumerate(chosen):
        indices[: len(sources), target + target_offset] = sources + source_offset
        values[: len(sources), target + target_offset] = weights[target, sources]
    return indices, values
