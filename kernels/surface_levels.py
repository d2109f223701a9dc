"""Coefficients of an elastic surface on a coarser grid, for multigrid.

Normals and Christoffel symbols are those of the coarse positions (:mod:`warpdeform.kernels.surface`, as on any grid);
the clipped tension is the mean of the fine one: strains of a coarse grid would be those of another, flatter shape.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.transfer import transfer_tables, transfers


@functools.cache
def surface_levels(width: int, real: Any) -> SimpleNamespace:
    """Kernel ``average_tension`` for one lane width and precision."""
    words, moves, Tables = lanes(width, real), transfers(width, real), transfer_tables(real)
    carried, carried3 = moves.carried, moves.carried3
    store1, splat, mul = words.store1, words.splat, words.mul
    module = kernel_module("surface_levels", width, real)

    @wp.kernel(module=module)
    def average_tension(
        tension: wp.array3d(dtype=real),
        tables: Tables,
        ratio: real,
        tension_out: wp.array3d(dtype=real),
    ):
        """Mean over the fine cells of a coarse cell, for differences along edges that have grown.

        A tension N11 gives a cell the coefficient N11 h2/h1 of the squared difference along u, so its mean grows by
        1/ratio, where ratio is the growth of h1/h2; along v by ratio; a shear stress stays. Components as in
        ``surface.TENSION_COMPONENTS``: with pulls p, q along u, v and positive shear halves a, b they are
        p + q + a, p + q + b, p + q, p - q.
        """
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        mean = carried3(tension, 0, tables, i, j)
        both, difference = mean[2], carried(tension, 3, tables, i, j)
        shear_d, shear_e = mean[0] - both, mean[1] - both
        pull_u = mul(splat(real(0.5) / ratio), both + difference)
        pull_v = mul(splat(real(0.5) * ratio), both - difference)
        store1(tension_out, 0, i, j, (pull_u + pull_v) + shear_d)
        store1(tension_out, 1, i, j, (pull_u + pull_v) + shear_e)
        store1(tension_out, 2, i, j, pull_u + pull_v)
        store1(tension_out, 3, i, j, pull_u - pull_v)

    return SimpleNamespace(module=module, average_tension=average_tension)
