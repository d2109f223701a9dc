"""Curves whose rest shape changes: their coefficients and rest numbers from those of the shape that they start with.

Rest lengths are a times those at the start, with a = 1 + w (a_t - 1): a_t holds for the body at a time, w is the share
that a place takes in it. A node has the w of the length between the middles of its segments, which grows as they do.
What a segment has in l0 and a node in l (:mod:`warpdeform.kernels.curve`) follows:

    |b|^2 at rest: l0^2 -> a^2 l0^2,    R^2 = EA / l0^3 -> R^2 / a^3,    R^2 = EI / l, GJ / l -> R^2 / a

A curve keeps the angles by which it turns as it grows, and may be given curvatures about its two directors and a twist
per length, kappa [1/m], on top of it:

    kappa_k, m at rest -> kappa_k + w kappa a l

A curvature alone makes a straight curve a polygon about a circle whose radius is 1/kappa: that is what kb / l measures.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes

# Entries of `rest`: what holds for the body.
SCALE = wp.constant(0)
KAPPA = wp.constant(1)
REST_ENTRIES = 4
"""Numbers of `rest`: a_t, kappa about directors 1 and 2, twist per length [1/m]."""


@functools.cache
def curve_growth(width: int, real: Any) -> SimpleNamespace:
    """Kernels for one lane width and precision.

    Threads begin at row 0 and column 0. `share` holds w at the segments or at the nodes, shape (1, rows, columns).
    """
    words = lanes(width, real)
    load1, store1, mul, div, root, splat = (
        words.load1, words.store1, words.mul, words.div, words.root, words.splat,
    )  # fmt: skip
    one = real(1.0)
    module = kernel_module("curve_growth", width, real)

    @wp.func
    def scaled(rest: wp.array(dtype=real), share: wp.array3d(dtype=real), i: int, j: int):
        """a at a place."""
        return splat(one) + (rest[SCALE] - one) * load1(share, 0, i, j)

    @wp.kernel(module=module)
    def grow_lengths(
        rest: wp.array(dtype=real),
        share: wp.array3d(dtype=real),
        g0: wp.array3d(dtype=real),
        g0_out: wp.array3d(dtype=real),
    ):
        """At the segments."""
        i, group = wp.tid()
        j = group * width
        a = scaled(rest, share, i, j)
        store1(g0_out, 0, i, j, mul(mul(a, a), load1(g0, 0, i, j)))

    @wp.kernel(module=module)
    def grow_stretching(
        rest: wp.array(dtype=real),
        share: wp.array3d(dtype=real),
        weight: wp.array3d(dtype=real),
        weight_out: wp.array3d(dtype=real),
    ):
        """At the segments."""
        i, group = wp.tid()
        j = group * width
        a = scaled(rest, share, i, j)
        store1(weight_out, 0, i, j, div(load1(weight, 0, i, j), mul(a, root(a))))

    @wp.kernel(module=module)
    def grow_bending(
        rest: wp.array(dtype=real),
        share: wp.array3d(dtype=real),
        weights: wp.array3d(dtype=real),
        weights_out: wp.array3d(dtype=real),
    ):
        """At the nodes: of kb, or of both curvatures and the twist."""
        i, group = wp.tid()
        j = group * width
        less = div(splat(one), root(scaled(rest, share, i, j)))
        for k in range(weights.shape[0]):
            store1(weights_out, k, i, j, mul(less, load1(weights, k, i, j)))

    @wp.kernel(module=module)
    def grow_curvature(
        rest: wp.array(dtype=real),
        share: wp.array3d(dtype=real),
        lengths: wp.array3d(dtype=real),
        natural: wp.array3d(dtype=real),
        natural_out: wp.array3d(dtype=real),
    ):
        """At the nodes; `lengths` holds their l [m], shape (1, rows, columns)."""
        i, group = wp.tid()
        j = group * width
        grown = mul(mul(load1(share, 0, i, j), scaled(rest, share, i, j)), load1(lengths, 0, i, j))
        for k in range(3):
            store1(natural_out, k, i, j, load1(natural, k, i, j) + rest[KAPPA + k] * grown)

    return SimpleNamespace(
        module=module,
        grow_lengths=grow_lengths,
        grow_stretching=grow_stretching,
        grow_bending=grow_bending,
        grow_curvature=grow_curvature,
    )
