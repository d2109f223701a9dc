"""The halo of closed axes: places beside the body that repeat the node, or sample, at the other end of the axis.

Kernels read their neighbours without a border test; where an axis is periodic, whoever reads neighbours has the halo
written first. One thread copies all components of one place, so the halo of an array takes one small launch, corners
included: no source is itself in the halo. Which place repeats which one is a table (:mod:`warpdeform.halo`), so curves,
surfaces and solids share these kernels.

Behind a pole an axis goes on along the meridian on the other side, where both axes run backwards: what is measured
there along them is taken for its opposite (``turn``).
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes


@functools.cache
def halo(real: Any) -> SimpleNamespace:
    """Kernels ``wrap``, ``turn`` and ``clear`` for one precision, one thread per place, whatever the lane width.

    `places` holds row and column of a place, and but for ``clear`` those of the node that it repeats, shape (n, 2 or
    4).
    """
    words = lanes(1, real)
    load1, store1 = words.load1, words.store1
    module = kernel_module("halo", 1, real)

    @wp.kernel(module=module)
    def wrap(places: wp.array2d(dtype=wp.int32), a_out: wp.array3d(dtype=real)):
        """Every place takes what its node holds."""
        n = wp.tid()
        i, j = places[n, 0], places[n, 1]
        ii, jj = places[n, 2], places[n, 3]
        for c in range(a_out.shape[0]):
            store1(a_out, c, i, j, load1(a_out, c, ii, jj))

    @wp.kernel(module=module)
    def turn(
        places: wp.array2d(dtype=wp.int32),
        components: wp.array(dtype=wp.int32),
        signs: wp.array(dtype=real),
        a_out: wp.array3d(dtype=real),
    ):
        """Component c of every place is component components[c] of its node, with the sign signs[c]."""
        n = wp.tid()
        i, j = places[n, 0], places[n, 1]
        ii, jj = places[n, 2], places[n, 3]
        for c in range(a_out.shape[0]):
            store1(a_out, c, i, j, signs[c] * load1(a_out, components[c], ii, jj))

    @wp.kernel(module=module)
    def clear(places: wp.array2d(dtype=wp.int32), a_out: wp.array3d(dtype=real)):
        """Every place is zero."""
        n = wp.tid()
        i, j = places[n, 0], places[n, 1]
        for c in range(a_out.shape[0]):
            store1(a_out, c, i, j, real(0.0))

    return SimpleNamespace(module=module, wrap=wrap, turn=turn, clear=clear)
