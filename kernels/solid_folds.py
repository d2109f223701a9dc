"""Starts of Newton that a solid must not have: cells squeezed flat or turned inside out on the way there.

A prediction carries a solid on by its velocity, and where it meets an obstacle the guard stops the nodes in front, not
those behind. Cells that are not much higher than the way of a step are squeezed or turned over by that, although the
potential may be lower than where the step began. Squared lengths do not tell a cell from its mirror image: from such a
start Newton finds a minimum among folded cells, and there it stays.
"""

import functools
import math
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.solid_volume import solid_volume

KEPT = 0.2
"""Share of the volume before that every cell must have at a start. A cube of 20 nodes a side that falls on the ground
in steps of 1/60 s keeps 0.75 of its cells' volume with a tenth to a half; with none corners fold over."""


@functools.cache
def solid_folds(width: int, real: Any) -> SimpleNamespace:
    """Kernel ``forbid_folds`` for one lane width and precision."""
    words = lanes(width, real)
    load1, dot3, cross3, above, splat = words.load1, words.dot3, words.cross3, words.above, words.splat
    sum_lanes = words.sum_lanes
    edge_sums = solid_volume(width, real).edge_sums
    zero, one, kept, infinite = real(0.0), real(1.0), real(KEPT), real(math.inf)
    module = kernel_module("solid_folds", width, real)

    @wp.func
    def signed_volume(r: wp.array3d(dtype=real), i: int, j: int, u: int):
        """64 times that of the mean edges of a cell."""
        y1, y2, y3 = edge_sums(r, i, j, u)
        return dot3(y1, cross3(y2, y3))

    @wp.kernel(module=module)
    def forbid_folds(
        first: int,
        u: int,
        share: wp.array3d(dtype=real),
        before: wp.array3d(dtype=real),
        r: wp.array3d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        """Add infinity for each cell of less than `KEPT` of its volume before, or of the other sign."""
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        J0 = signed_volume(before, i, j, u)
        spare = signed_volume(r, i, j, u) - kept * J0
        spare = above(J0, zero, spare, (-one) * spare)
        forbidden = above(spare, zero, splat(zero), splat(infinite))
        forbidden = above(load1(share, 0, i, j), zero, forbidden, splat(zero))
        partials_out[i, j] = partials_out[i, j] + sum_lanes(forbidden)

    return SimpleNamespace(module=module, forbid_folds=forbid_folds)
