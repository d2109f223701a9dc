"""Mean strains over a step, for steps that conserve energy.

The numbers q of a cell (:mod:`warpdeform.kernels.surface`) are quadratic in the positions. In the middle r of a step
from x to 2 r - x their mean over both ends is q(r) + q(r - x): so with rest numbers q0 - q(r - x) the stresses at r are
the mean ones.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.surface_geometry import geometry


@functools.cache
def surface_mean(width: int, real: Any) -> SimpleNamespace:
    """Kernel ``shift_rest`` for one lane width and precision."""
    words, shape = lanes(width, real), geometry(width, real, True)
    load1, store1 = words.load1, words.store1
    diagonals, numbers = shape.diagonals, shape.numbers
    module = kernel_module("surface_mean", width, real)

    @wp.kernel(module=module)
    def shift_rest(
        r: wp.array3d(dtype=real),
        start: wp.array3d(dtype=real),
        q0: wp.array3d(dtype=real),
        q_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d, e, x = diagonals(r, i, j)
        d0, e0, x0 = diagonals(start, i, j)
        s, t, c, u, v = numbers(d - d0, e - e0, x - x0)
        store1(q_out, 0, i, j, load1(q0, 0, i, j) - s)
        store1(q_out, 1, i, j, load1(q0, 1, i, j) - t)
        store1(q_out, 2, i, j, load1(q0, 2, i, j) - c)
        store1(q_out, 3, i, j, load1(q0, 3, i, j) - u)
        store1(q_out, 4, i, j, load1(q0, 4, i, j) - v)

    return SimpleNamespace(module=module, shift_rest=shift_rest)
