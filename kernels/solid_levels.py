"""Tension of an elastic solid, and the hardness of its barrier, on a coarser grid, for multigrid.

Directions are those of the coarse positions (:mod:`warpdeform.kernels.solid`, as on any grid); these two are the means
of the fine ones: strains and volumes of a coarse grid would be those of another shape.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.transfer import transfer_tables, transfers


@functools.cache
def solid_levels(width: int, real: Any) -> SimpleNamespace:
    """Kernels ``average_tension`` and ``average_hardness`` for one lane width and precision."""
    words, moves, Tables = lanes(width, real), transfers(width, real), transfer_tables(real)
    carried, carried3 = moves.carried, moves.carried3
    store1, splat, mul, one = words.store1, words.splat, words.mul, real(1.0)
    module = kernel_module("solid_levels", width, real)

    @wp.kernel(module=module)
    def average_tension(
        tension: wp.array3d(dtype=real),
        tables: Tables,
        grow_u: real,
        grow_v: real,
        grow_w: real,
        tension_out: wp.array3d(dtype=real),
    ):
        """Mean over the fine cells of a coarse cell, for edges that have grown by `grow_u`, `grow_v`, `grow_w`.

        A stress N11 gives a cell the coefficient N11 V/h1^2 of the squared difference along u, so its mean grows by the
        growth of V/h1^2, that of a shear stress N12 by the growth of V/(h1 h2).
        """
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        pull, shear = carried3(tension, 0, tables, i, j), carried3(tension, 3, tables, i, j)
        store1(tension_out, 0, i, j, mul(splat(grow_v * grow_w / grow_u), pull[0]))
        store1(tension_out, 1, i, j, mul(splat(grow_u * grow_w / grow_v), pull[1]))
        store1(tension_out, 2, i, j, mul(splat(grow_u * grow_v / grow_w), pull[2]))
        store1(tension_out, 3, i, j, mul(splat(grow_w), shear[0]))
        store1(tension_out, 4, i, j, mul(splat(grow_v), shear[1]))
        store1(tension_out, 5, i, j, mul(splat(grow_u), shear[2]))

    @wp.kernel(module=module)
    def average_hardness(
        hardness: wp.array3d(dtype=real), tables: Tables, growth: real, hardness_out: wp.array3d(dtype=real)
    ):
        """The same of the barrier, for cells whose volume has grown by `growth`."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store1(hardness_out, 0, i, j, mul(splat(one / growth), carried(hardness, 0, tables, i, j)))

    return SimpleNamespace(module=module, average_tension=average_tension, average_hardness=average_hardness)
