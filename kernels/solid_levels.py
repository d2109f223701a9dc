"""Stress of an elastic solid on a coarser grid, for multigrid.

Directions are those of the coarse positions (:mod:`warpdeform.kernels.solid`, as on any grid); the stress in the
Hessian is the mean of the fine one: strains of a coarse grid would be those of another shape.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.transfer import transfer_tables, transfers


@functools.cache
def solid_levels(width: int, real: Any) -> SimpleNamespace:
    """Kernels ``average_stress`` and ``sum_means`` for one lane width and precision."""
    words, moves, Tables = lanes(width, real), transfers(width, real), transfer_tables(real)
    carried3 = moves.carried3
    load1, store1, splat, mul = words.load1, words.store1, words.splat, words.mul
    module = kernel_module("solid_levels", width, real)

    @wp.kernel(module=module)
    def average_stress(
        mean: wp.array3d(dtype=real),
        tables: Tables,
        grow_u: real,
        grow_v: real,
        grow_w: real,
        mean_out: wp.array3d(dtype=real),
    ):
        """Mean over the fine cells of a coarse cell, for edges that have grown by `grow_u`, `grow_v`, `grow_w`.

        A stress N11 gives a cell the coefficient N11 V/h1^2 of the squared difference along u, so its mean grows by the
        growth of V/h1^2, that of a shear stress N12 by the growth of V/(h1 h2).
        """
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        pull, shear = carried3(mean, 0, tables, i, j), carried3(mean, 3, tables, i, j)
        store1(mean_out, 0, i, j, mul(splat(grow_v * grow_w / grow_u), pull[0]))
        store1(mean_out, 1, i, j, mul(splat(grow_u * grow_w / grow_v), pull[1]))
        store1(mean_out, 2, i, j, mul(splat(grow_u * grow_v / grow_w), pull[2]))
        store1(mean_out, 3, i, j, mul(splat(grow_w), shear[0]))
        store1(mean_out, 4, i, j, mul(splat(grow_v), shear[1]))
        store1(mean_out, 5, i, j, mul(splat(grow_u), shear[2]))

    @wp.func
    def around(a: wp.array3d(dtype=real), c: int, i: int, j: int, bi: int, bj: int, ci: int, cj: int):
        """Sum over the four cells of an edge."""
        return (load1(a, c, i, j) + load1(a, c, i - bi, j - bj)) + (
            load1(a, c, i - ci, j - cj) + load1(a, c, i - bi - ci, j - bj - cj)
        )

    @wp.kernel(module=module)
    def sum_means(first: int, u: int, mean: wp.array3d(dtype=real), stress_out: wp.array3d(dtype=real)):
        """Stresses of the edges and faces that begin at a node, where those of a cell are all alike."""
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        store1(stress_out, 0, i, j, around(mean, 0, i, j, 1, 0, 0, 1))
        store1(stress_out, 1, i, j, around(mean, 1, i, j, u, 0, 0, 1))
        store1(stress_out, 2, i, j, around(mean, 2, i, j, u, 0, 1, 0))
        store1(stress_out, 3, i, j, load1(mean, 3, i, j) + load1(mean, 3, i, j - 1))
        store1(stress_out, 4, i, j, load1(mean, 4, i, j) + load1(mean, 4, i - 1, j))
        store1(stress_out, 5, i, j, load1(mean, 5, i, j) + load1(mean, 5, i - u, j))

    return SimpleNamespace(module=module, average_stress=average_stress, sum_means=sum_means)
