"""The linear map between a grid and a coarser one, fine to coarse and back, as words for kernels.

    out[I, J] = sum over taps s, t of  row_weights[s, I] column_weights[t, J] a[rows[s, I], columns[t, J]]

Rows are what the lanes of a group have in common, columns differ from lane to lane. Interpolation, its transpose, the
sampling of positions and the averaging of cells are this map with different tables (warpdeform/linear/transfer.py).
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import lanes


@functools.cache
def transfer_tables(real: Any) -> Any:
    """The struct ``Tables`` of one precision."""

    @wp.struct
    class Tables:
        rows: wp.array2d(dtype=wp.int32)  # (taps, rows)
        row_weights: wp.array2d(dtype=real)  # (taps, rows)
        columns: wp.array2d(dtype=wp.int32)  # (taps, columns)
        column_weights: wp.array3d(dtype=real)  # (taps, 1, columns)

    return Tables


@functools.cache
def transfers(width: int, real: Any) -> SimpleNamespace:
    """Device functions ``carried`` and ``carried3`` for one lane width and precision."""
    words, Tables = lanes(width, real), transfer_tables(real)
    load1, pick1, pick3, mul, splat = words.load1, words.pick1, words.pick3, words.mul, words.splat
    scale, vector = words.scale, words.vector
    zero = real(0.0)

    @wp.func
    def carried(a: wp.array3d(dtype=real), c: int, tables: Tables, i: int, j: int):
        """Component c of the map of a."""
        total = splat(zero)
        for s in range(tables.rows.shape[0]):
            w = tables.row_weights[s, i]
            if w != zero:
                along = splat(zero)
                for t in range(tables.columns.shape[0]):
                    weight = load1(tables.column_weights, t, 0, j)
                    along = along + mul(weight, pick1(a, c, tables.rows[s, i], tables.columns, t, j))
                total = total + mul(splat(w), along)
        return total

    @wp.func
    def carried3(a: wp.array3d(dtype=real), c: int, tables: Tables, i: int, j: int):
        """The map of a vector, components c to c + 2."""
        total = vector(splat(zero), splat(zero), splat(zero))
        for t in range(tables.columns.shape[0]):
            along = vector(splat(zero), splat(zero), splat(zero))
            for s in range(tables.rows.shape[0]):
                w = tables.row_weights[s, i]
                if w != zero:
                    along = along + scale(splat(w), pick3(a, c, tables.rows[s, i], tables.columns, t, j))
            total = total + scale(load1(tables.column_weights, t, 0, j), along)
        return total

    return SimpleNamespace(carried=carried, carried3=carried3)
