"""The forces of an elastic solid at its nodes, gathered from what its cells write (:mod:`warpdeform.kernels.solid`)."""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.products import Gathering

FLUX_COMPONENTS = 21
"""Derivatives of a cell's energy by its corners 100, 010, 110, 001, 101, 011, 111; 000 has minus their sum."""


@functools.cache
def solid_gather(width: int, real: Any) -> SimpleNamespace:
    """Kernel ``gather`` for one lane width and precision, and the ``gathering`` behind it, for products with A.

    All variants of solids share them.
    """
    words = lanes(width, real)
    load3, add3 = words.load3, words.add3
    module = kernel_module("solid_gather", width, real)

    @wp.struct
    class Fluxes:
        flux: wp.array3d(dtype=real)
        stride: wp.array(dtype=wp.int32)  # rows to the next node along u, shape (1,)

    @wp.func
    def gathered(fluxes: Fluxes, i: int, j: int):
        """What the forces on the corners of its eight cells make of a node's."""
        flux, u = fluxes.flux, fluxes.stride[0]
        # The node is corner 000 of the cell ahead of it along all axes.
        ahead = (load3(flux, 0, i, j) + load3(flux, 3, i, j)) + (load3(flux, 6, i, j) + load3(flux, 9, i, j))
        ahead = ahead + ((load3(flux, 12, i, j) + load3(flux, 15, i, j)) + load3(flux, 18, i, j))
        f = (load3(flux, 0, i - u, j) + load3(flux, 3, i - 1, j)) + (
            load3(flux, 6, i - u - 1, j) + load3(flux, 9, i, j - 1)
        )
        f = f + ((load3(flux, 12, i - u, j - 1) + load3(flux, 15, i - 1, j - 1)) + load3(flux, 18, i - u - 1, j - 1))
        return f - ahead

    @wp.kernel(module=module)
    def gather(first: int, fluxes: Fluxes, force_out: wp.array3d(dtype=real)):
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        add3(force_out, 0, i, j, gathered(fluxes, i, j))

    return SimpleNamespace(module=module, gather=gather, gathering=Gathering("solid", gathered, Fluxes))
