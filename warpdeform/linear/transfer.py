"""From a grid to the next coarser one and back: linear interpolation between equally spaced nodes (design 7.1)."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.grid import Layout, ParameterGrid
from warpdeform.kernels.transfer import transfer_tables

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LinearMap:
    """Tables of a map between two grids (:mod:`warpdeform.kernels.transfer`); kernels get them as the struct.

    Attributes:
        rows: Source rows of each target row, int32, shape (taps, target rows).
        row_weights: Their weights.
        columns: Source columns of each target column, int32, shape (taps, target columns).
        column_weights: Their weights, shape (taps, 1, target columns).
    """

    rows: wp.array
    row_weights: wp.array
    columns: wp.array
    column_weights: wp.array

    def of_rows(self, low: int, high: int) -> Any:
        """The struct for a kernel that writes the target rows `low` to `high` - 1; the halo does not count."""
        return self._whole if low == 0 else self._from(low)

    @cached_property
    def _whole(self) -> Any:
        return self._from(0)

    def _from(self, low: int) -> Any:
        tables = transfer_tables(self.row_weights.dtype)()
        tables.rows, tables.row_weights = self.rows[:, low:], self.row_weights[:, low:]
        tables.columns, tables.column_weights = self.columns, self.column_weights
        return tables

    def bytes(self) -> int:
        """Device memory [bytes]."""
        arrays = (self.rows, self.row_weights, self.columns, self.column_weights)
        return int(sum(array.capacity for array in arrays))


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
        self.layout = Layout(coarse.nodes, fine_layout.lane_width, coarse.periodic, coarse.poles)
        wraps = [p or axis >= fine.dimension for axis, p in enumerate(fine.periodic)]
        steps = list(zip(fine.cells, coarse.cells, wraps, strict=True))
        self.growth = tuple(f / c for f, c, _ in steps)
        self._prolong = [_interpolation(f, c, wrap) for f, c, wrap in steps]
        self._positions = [_interpolation(c, f, wrap) for f, c, wrap in steps]
        self.prolong = self._tables(self._prolong, self.layout, fine_layout)
        self.restrict = self._tables([weights.T for weights in self._prolong], fine_layout, self.layout)
        self.positions = self._tables(self._positions, fine_layout, self.layout)
        self._averages = [_averages(f, c) for f, c, _ in steps]
        self.cells = self._tables(self._averages, fine_layout, self.layout)

    def sample(self, values: Array) -> Array:
        """Values at the fine nodes, shape (*nodes, n), interpolated at the coarse nodes (host)."""
        return _along_axes(self._positions, values)

    def gather(self, values: Array) -> Array:
        """Fine values, shape (*nodes, ...), shared among the coarse nodes by the interpolation transposed (host)."""
        return _along_axes([weights.T for weights in self._prolong], values)

    def average_cells(self, values: Array) -> Array:
        """Values at the fine cells, shape (*cells, ...), averaged over the coarse cells (host)."""
        return _along_axes(self._averages, values)

    def average_nodes(self, values: Array) -> Array:
        """Values at the fine nodes, shape (*nodes, ...), averaged around the coarse nodes (host)."""
        ones = np.ones(values.shape[: len(self._prolong)])
        weights = self.gather(ones)
        return self.gather(values) / weights.reshape(*weights.shape, *[1] * (values.ndim - weights.ndim))

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return sum(each.bytes() for each in (self.prolong, self.restrict, self.positions, self.cells))

    def _tables(self, weights: list[Array], source: Layout, target: Layout) -> "LinearMap":
        *across, along = [_taps(axis) for axis in weights]
        rows, row_weights = _row_taps(across, source, target)
        columns = np.zeros((len(along[0]), target.columns), dtype=np.int32)
        column_weights = np.zeros((len(along[0]), 1, target.columns))
        inside = slice(target.halo, target.halo + along[0].shape[1])
        columns[:, inside] = np.where(along[1] != 0.0, along[0] + source.halo, 0)
        column_weights[:, 0, inside] = along[1]
        return LinearMap(
            wp.array(rows, dtype=wp.int32, device=self._device),
            wp.array(row_weights, dtype=self._real, device=self._device),
            wp.array(columns, dtype=wp.int32, device=self._device),
            wp.array(column_weights, dtype=self._real, device=self._device),
        )


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


Taps = tuple[NDArray[np.int64], Array]
"""Indices and weights, shape (taps, targets); taps that a target does not need have index and weight zero."""


def _taps(weights: Array) -> Taps:
    """The nonzero weights of one axis."""
    chosen = [np.flatnonzero(row) for row in weights]
    indices = np.zeros((max(map(len, chosen)), len(weights)), dtype=np.int64)
    values = np.zeros(indices.shape)
    for target, sources in enumerate(chosen):
        indices[: len(sources), target] = sources
        values[: len(sources), target] = weights[target, sources]
    return indices, values


def _row_taps(across: list[Taps], source: Layout, target: Layout) -> tuple[NDArray[np.int32], Array]:
    """Taps between rows of the component arrays, shape (taps, rows): of all axes but the last, taken together."""
    indices, values = across[0]
    sources, targets = source.node_rows, target.node_rows
    if len(across) == 1:
        found = sources[indices]
    else:
        more, more_values = across[1]
        found = sources[indices[:, None, :, None], more[None, :, None, :]].reshape(-1, indices.shape[1], more.shape[1])
        values = (values[:, None, :, None] * more_values[None, :, None, :]).reshape(found.shape)
    rows = np.zeros((len(found), target.rows), dtype=np.int32)
    row_weights = np.zeros((len(found), target.rows))
    inside = targets[tuple(slice(count) for count in found.shape[1:])]
    rows[:, inside] = np.where(values != 0.0, found, 0)
    row_weights[:, inside] = values
    return rows, row_weights


def _along_axes(weights: list[Array], values: Array) -> Array:
    """One linear map per axis, applied to values of shape (*nodes, ...)."""
    for axis, matrix in enumerate(weights):
        values = np.moveaxis(np.tensordot(matrix, values, axes=(1, axis)), 0, axis)
    return values
