"""Solids whose rest shape changes: their coefficients and rest numbers from those of the shape that they start with.

The rest lengths along u, v, w are a1, a2, a3 times those at the start, with a_i = 1 + w (a_t,i - 1): a_t,i hold for the
body at a time, w is the share that a place takes in it. Edges and faces have a w of their own, as cells have; cells
stretch along their edges, whose angles stay. So of what :mod:`warpdeform.kernels.solid` reads

    q at rest: (|e|^2)/2 of edges along i -> a_i^2 q,    2 m_i.m_j of faces -> a_i a_j q
    K, orthogonal, of V/(L_i^2 L_j^2):                   K -> a1 a2 a3 / (a_i^2 a_j^2) K
    K, general:    sqrt(V) L_i L_j Gh^ij -> sqrt(a1 a2 a3) K,    1/(8 L_i L_j) -> K/(a_i a_j),    V -> a1 a2 a3 K
    t of edges, 1/(4 |e|^2):                             t -> t/a_i^2
    barrier: kappa V -> a1 a2 a3 kappa V,                1/(64 m1.(m2 x m3)) divided by a1 a2 a3

The paper's weights have no rest lengths in them; of such a solid K stays.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes

REST_ENTRIES = 3
"""Numbers of `rest`, what holds for the body: a_t along u, v and w."""


@functools.cache
def solid_growth(width: int, real: Any, orthogonal: bool) -> SimpleNamespace:
    """Kernels for one lane width, precision and kind of chart.

    Threads begin at row 0 and column 0, in the halo, which is kept in step with the rest of an array.

    Args:
        width: Lane width.
        real: ``wp.float32`` or ``wp.float64``.
        orthogonal: K has twenty-one entries, else sixteen (:mod:`warpdeform.forces.solid_coefficients`).
    """
    words = lanes(width, real)
    L = words.L
    load1, store1, mul, div, root, splat = (
        words.load1, words.store1, words.mul, words.div, words.root, words.splat,
    )  # fmt: skip
    one = real(1.0)
    module = kernel_module(f"solid_growth_{'orthogonal' if orthogonal else 'general'}", width, real)

    @wp.func
    def scaled(rest: wp.array(dtype=real), axis: int, share: wp.array3d(dtype=real), k: int, i: int, j: int):
        """a_i at a place whose share is component k."""
        return splat(one) + (rest[axis] - one) * load1(share, k, i, j)

    @wp.func
    def grown(array: wp.array3d(dtype=real), out: wp.array3d(dtype=real), k: int, i: int, j: int, factor: L):
        store1(out, k, i, j, mul(factor, load1(array, k, i, j)))

    @wp.kernel(module=module)
    def grow_strains(
        rest: wp.array(dtype=real),
        share: wp.array3d(dtype=real),
        q0: wp.array3d(dtype=real),
        q0_out: wp.array3d(dtype=real),
    ):
        """At the edges along u, v, w and the faces uv, uw, vw, whose shares are the six of `share`."""
        i, group = wp.tid()
        j = group * width
        for axis in range(3):
            a = scaled(rest, axis, share, axis, i, j)
            grown(q0, q0_out, axis, i, j, mul(a, a))
        grown(q0, q0_out, 3, i, j, mul(scaled(rest, 0, share, 3, i, j), scaled(rest, 1, share, 3, i, j)))
        grown(q0, q0_out, 4, i, j, mul(scaled(rest, 0, share, 4, i, j), scaled(rest, 2, share, 4, i, j)))
        grown(q0, q0_out, 5, i, j, mul(scaled(rest, 1, share, 5, i, j), scaled(rest, 2, share, 5, i, j)))

    @wp.kernel(module=module)
    def grow_edges(
        rest: wp.array(dtype=real),
        share: wp.array3d(dtype=real),
        t: wp.array3d(dtype=real),
        t_out: wp.array3d(dtype=real),
    ):
        i, group = wp.tid()
        j = group * width
        for axis in range(3):
            a = scaled(rest, axis, share, axis, i, j)
            grown(t, t_out, axis, i, j, div(splat(one), mul(a, a)))

    @wp.kernel(module=module)
    def grow_law(
        rest: wp.array(dtype=real),
        share: wp.array3d(dtype=real),
        K: wp.array3d(dtype=real),
        K_out: wp.array3d(dtype=real),
    ):
        """At the cells."""
        i, group = wp.tid()
        j = group * width
        a1, a2, a3 = scaled(rest, 0, share, 0, i, j), scaled(rest, 1, share, 0, i, j), scaled(rest, 2, share, 0, i, j)
        volume = mul(mul(a1, a2), a3)
        if wp.static(orthogonal):
            f1, f2, f3 = div(splat(one), mul(a1, a1)), div(splat(one), mul(a2, a2)), div(splat(one), mul(a3, a3))
            v1, v2 = mul(volume, f1), mul(volume, f2)
            k11, k12, k13 = mul(v1, f1), mul(v1, f2), mul(v1, f3)
            k22, k23, k33 = mul(v2, f2), mul(v2, f3), mul(mul(volume, f3), f3)
            # Sums of extensions.
            grown(K, K_out, 0, i, j, k11)
            grown(K, K_out, 1, i, j, k12)
            grown(K, K_out, 2, i, j, k13)
            grown(K, K_out, 3, i, j, k22)
            grown(K, K_out, 4, i, j, k23)
            grown(K, K_out, 5, i, j, k33)
            # Slopes, then cross modes.
            grown(K, K_out, 6, i, j, k11)
            grown(K, K_out, 7, i, j, k22)
            grown(K, K_out, 8, i, j, k33)
            grown(K, K_out, 9, i, j, k12)
            grown(K, K_out, 10, i, j, k13)
            grown(K, K_out, 11, i, j, k23)
            grown(K, K_out, 12, i, j, k11)
            grown(K, K_out, 13, i, j, k22)
            grown(K, K_out, 14, i, j, k33)
            # Sums of shears, then their differences.
            grown(K, K_out, 15, i, j, k12)
            grown(K, K_out, 16, i, j, k13)
            grown(K, K_out, 17, i, j, k23)
            grown(K, K_out, 18, i, j, k12)
            grown(K, K_out, 19, i, j, k13)
            grown(K, K_out, 20, i, j, k23)
        else:
            h = root(volume)
            for k in range(6):
                grown(K, K_out, k, i, j, h)
            grown(K, K_out, 6, i, j, div(splat(one), mul(a1, a2)))
            grown(K, K_out, 7, i, j, div(splat(one), mul(a1, a3)))
            grown(K, K_out, 8, i, j, div(splat(one), mul(a2, a3)))
            for k in range(9, 12):
                grown(K, K_out, k, i, j, splat(one))
            for k in range(12, 16):
                grown(K, K_out, k, i, j, volume)

    @wp.kernel(module=module)
    def grow_volume(
        rest: wp.array(dtype=real),
        share: wp.array3d(dtype=real),
        volume: wp.array3d(dtype=real),
        volume_out: wp.array3d(dtype=real),
    ):
        """At the cells."""
        i, group = wp.tid()
        j = group * width
        a1, a2, a3 = scaled(rest, 0, share, 0, i, j), scaled(rest, 1, share, 0, i, j), scaled(rest, 2, share, 0, i, j)
        larger = mul(mul(a1, a2), a3)
        grown(volume, volume_out, 0, i, j, larger)
        grown(volume, volume_out, 1, i, j, div(splat(one), larger))
        grown(volume, volume_out, 2, i, j, splat(one))

    return SimpleNamespace(
        module=module,
        grow_strains=grow_strains,
        grow_edges=grow_edges,
        grow_law=grow_law,
        grow_volume=grow_volume,
    )
