"""Bending where the axes of the chart are not orthogonal: what couples b12 to b11 and b22 (design 1.3).

Every corner of a cell sees b = (b11, b22) of its node and b12 of the cell. Its energy (b - b0)' C (b - b0)/2 has the
entries of a node, which add up in KB, that of the cell, which adds up in K12, both as for charts with right angles
(:mod:`warpdeform.kernels.surface`), and C13 and C23, which mix samples that live in different places:

    W = sum over cells, corners c of (b12 - b0_12) (KC_c (b11 - b0_11)_c + KC_4+c (b22 - b0_22)_c)

KC holds C13, then C23, of the corners 00, 10, 01, 11; corners that lack b11 or b22 (at a border) have zeros there. The
changes of all three b are measured first, then nodes and cells read each other's and form their moments. Hence one pass
more than with right angles in a Hessian product: `change_along` in place of ``product_nodes``, then `couple`. It is the
Gauss-Newton product of the whole energy, mixed terms included, and so are the diagonal blocks.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.surface_geometry import geometry

CHANGE_COMPONENTS = 3
"""Changes of b11, b22 at a node and of b12 at the cell of the same index."""
COUPLING_KERNELS = ("change", "change_along", "couple", "energy_coupling", "block_coupling")
"""Names of the kernels."""


@functools.cache
def surface_coupling(width: int, real: Any) -> SimpleNamespace:
    """Kernels of coupled bending for one lane width and precision.

    Args:
        width: Lane width.
        real: ``wp.float32`` or ``wp.float64``.

    Returns:
        The kernels of `COUPLING_KERNELS`.
    """
    words, shape = lanes(width, real), geometry(width, real, False)
    L, V = words.L, words.V
    load1, load3, store1 = words.load1, words.load3, words.store1
    add3, add6, along_u, sum_lanes = words.add3, words.add6, words.along_u, words.sum_lanes
    dot3, scale, scale6, mul, outer, splat = words.dot3, words.scale, words.scale6, words.mul, words.outer, words.splat
    diagonals, unit_normal = shape.diagonals, shape.unit_normal
    flexed, store_scatter = shape.flexed, shape.store_scatter
    tangent_u, tangent_v, second_u, second_v = shape.tangent_u, shape.tangent_v, shape.second_u, shape.second_v
    zero, one, two = real(0.0), real(1.0), real(2.0)
    module = kernel_module("surface_coupling", width, real)

    @wp.kernel(module=module)
    def change(
        r: wp.array3d(dtype=real),
        b0: wp.array3d(dtype=real),
        alpha_u: wp.array3d(dtype=real),
        alpha_v: wp.array3d(dtype=real),
        node_floor: real,
        cell_floor: real,
        change_out: wp.array3d(dtype=real),
    ):
        """b - b0."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        n = unit_normal(tangent_u(r, alpha_u, i, j), tangent_v(r, alpha_v, i, j), node_floor)
        d, e, x = diagonals(r, i, j)
        store1(change_out, 0, i, j, dot3(n, second_u(r, i, j)) - load1(b0, 0, i, j))
        store1(change_out, 1, i, j, dot3(n, second_v(r, i, j)) - load1(b0, 1, i, j))
        store1(change_out, 2, i, j, dot3(unit_normal(e, d, cell_floor), x) - load1(b0, 2, i, j))

    @wp.kernel(module=module)
    def change_along(
        alpha_u: wp.array3d(dtype=real),
        alpha_v: wp.array3d(dtype=real),
        flexure: wp.array3d(dtype=real),
        twist: wp.array3d(dtype=real),
        p: wp.array3d(dtype=real),
        change_out: wp.array3d(dtype=real),
    ):
        """Changes of b under the displacement p, linearised."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        e1, e2 = flexed(flexure, alpha_u, alpha_v, p, i, j)
        pd, pe, px = diagonals(p, i, j)
        n, gamma_d, gamma_e = load3(twist, 0, i, j), load1(twist, 3, i, j), load1(twist, 4, i, j)
        store1(change_out, 0, i, j, e1)
        store1(change_out, 1, i, j, e2)
        store1(change_out, 2, i, j, dot3(n, px) - mul(gamma_d, dot3(n, pd)) - mul(gamma_e, dot3(n, pe)))

    @wp.func
    def from_corners(KC: wp.array3d(dtype=real), b: wp.array3d(dtype=real), i: int, j: int):
        """Moment of a cell that is due to b11 and b22 at its corners."""
        u = mul(load1(KC, 0, i, j), load1(b, 0, i, j)) + mul(load1(KC, 1, i, j), load1(b, 0, i + 1, j))
        u = u + (mul(load1(KC, 2, i, j), load1(b, 0, i, j + 1)) + mul(load1(KC, 3, i, j), load1(b, 0, i + 1, j + 1)))
        v = mul(load1(KC, 4, i, j), load1(b, 1, i, j)) + mul(load1(KC, 5, i, j), load1(b, 1, i + 1, j))
        v = v + (mul(load1(KC, 6, i, j), load1(b, 1, i, j + 1)) + mul(load1(KC, 7, i, j), load1(b, 1, i + 1, j + 1)))
        return u + v

    @wp.func
    def from_cells(KC: wp.array3d(dtype=real), b: wp.array3d(dtype=real), first: int, i: int, j: int):
        """Moment of a node that is due to b12 of the cells of which it is corner 00, 10, 01 and 11; `first`: 0 or 4."""
        m = mul(load1(KC, first, i, j), load1(b, 2, i, j))
        m = m + mul(load1(KC, first + 1, i - 1, j), load1(b, 2, i - 1, j))
        m = m + mul(load1(KC, first + 2, i, j - 1), load1(b, 2, i, j - 1))
        return m + mul(load1(KC, first + 3, i - 1, j - 1), load1(b, 2, i - 1, j - 1))

    @wp.kernel(module=module)
    def couple(
        KB: wp.array3d(dtype=real),
        KC: wp.array3d(dtype=real),
        alpha_u: wp.array3d(dtype=real),
        alpha_v: wp.array3d(dtype=real),
        flexure: wp.array3d(dtype=real),
        twist: wp.array3d(dtype=real),
        b: wp.array3d(dtype=real),
        flux_out: wp.array3d(dtype=real),
        scatter_out: wp.array3d(dtype=real),
    ):
        """Adds the cells' moments to their flux, where K12 is in already; writes the whole scatter of the nodes."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        moment = from_corners(KC, b, i, j)
        n = load3(twist, 0, i, j)
        add3(flux_out, 0, i, j, scale(splat(zero) - mul(load1(twist, 3, i, j), moment), n))
        add3(flux_out, 3, i, j, scale(splat(zero) - mul(load1(twist, 4, i, j), moment), n))
        add3(flux_out, 6, i, j, scale(moment, n))
        e1, e2, k12 = load1(b, 0, i, j), load1(b, 1, i, j), load1(KB, 1, i, j)
        moment1 = mul(load1(KB, 0, i, j), e1) + mul(k12, e2) + from_cells(KC, b, 0, i, j)
        moment2 = mul(k12, e1) + mul(load1(KB, 2, i, j), e2) + from_cells(KC, b, 4, i, j)
        g1 = mul(moment1, load1(flexure, 3, i, j)) + mul(moment2, load1(flexure, 5, i, j))
        g2 = mul(moment1, load1(flexure, 4, i, j)) + mul(moment2, load1(flexure, 6, i, j))
        store_scatter(scatter_out, alpha_u, alpha_v, i, j, moment1, moment2, g1, g2)

    @wp.kernel(module=module)
    def energy_coupling(
        KC: wp.array3d(dtype=real), b: wp.array3d(dtype=real), partials_out: wp.array2d(dtype=wp.float64)
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        w = mul(load1(b, 2, i, j), from_corners(KC, b, i, j))
        partials_out[i, j] = partials_out[i, j] + sum_lanes(w)

    @wp.func
    def twist_slope(twist: wp.array3d(dtype=real), i: int, j: int, on_d: real, on_e: real, on_x: real):
        """Derivative of a cell's b12 by the corner whose motion dr gives dD = on_d dr, dE = on_e dr, dx = on_x dr."""
        gamma_d, gamma_e = load1(twist, 3, i, j), load1(twist, 4, i, j)
        return scale(splat(on_x) - on_d * gamma_d - on_e * gamma_e, load3(twist, 0, i, j))

    @wp.func
    def cross_block(flexure: wp.array3d(dtype=real), i: int, j: int, s1: L, s2: L, a1: L, a2: L, c13: V, c23: V):
        """Mixed terms of a sample (i, j) and its cells, for a node in its second differences and tangents.

        The node enters the second differences with s1, s2 and the tangents with a1, a2; c13 and c23 are the derivatives
        by it of the moments that the cells lend to b11 and b22.
        """
        e1 = s1 - mul(load1(flexure, 3, i, j), a1) - mul(load1(flexure, 4, i, j), a2)
        e2 = s2 - mul(load1(flexure, 5, i, j), a1) - mul(load1(flexure, 6, i, j), a2)
        return scale6(splat(two), outer(load3(flexure, 0, i, j), scale(e1, c13) + scale(e2, c23)))

    @wp.kernel(module=module)
    def block_coupling(
        KC: wp.array3d(dtype=real),
        alpha_u: wp.array3d(dtype=real),
        alpha_v: wp.array3d(dtype=real),
        flexure: wp.array3d(dtype=real),
        twist: wp.array3d(dtype=real),
        blocks_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        none, once, centre = splat(zero), splat(one), splat(-two)
        # The node is corner 00, 10, 01 and 11 of its four cells; four neighbours are each a corner of two of them.
        t00, t10 = twist_slope(twist, i, j, -one, zero, one), twist_slope(twist, i - 1, j, zero, one, -one)
        t01, t11 = twist_slope(twist, i, j - 1, zero, -one, -one), twist_slope(twist, i - 1, j - 1, one, zero, one)
        own1 = along_u(alpha_u, 1, i) - along_u(alpha_u, 0, i)
        own2 = load1(alpha_v, 1, 0, j) - load1(alpha_v, 0, 0, j)
        block = cross_block(
            flexure, i, j, centre, centre, own1, own2,
            scale(load1(KC, 0, i, j), t00) + scale(load1(KC, 1, i - 1, j), t10)
            + scale(load1(KC, 2, i, j - 1), t01) + scale(load1(KC, 3, i - 1, j - 1), t11),
            scale(load1(KC, 4, i, j), t00) + scale(load1(KC, 5, i - 1, j), t10)
            + scale(load1(KC, 6, i, j - 1), t01) + scale(load1(KC, 7, i - 1, j - 1), t11),
        )  # fmt: skip
        block = block + cross_block(
            flexure, i - 1, j, once, none, along_u(alpha_u, 0, i - 1), none,
            scale(load1(KC, 0, i - 1, j), t10) + scale(load1(KC, 2, i - 1, j - 1), t11),
            scale(load1(KC, 4, i - 1, j), t10) + scale(load1(KC, 6, i - 1, j - 1), t11),
        )  # fmt: skip
        block = block + cross_block(
            flexure, i + 1, j, once, none, none - along_u(alpha_u, 1, i + 1), none,
            scale(load1(KC, 1, i, j), t00) + scale(load1(KC, 3, i, j - 1), t01),
            scale(load1(KC, 5, i, j), t00) + scale(load1(KC, 7, i, j - 1), t01),
        )  # fmt: skip
        block = block + cross_block(
            flexure, i, j - 1, none, once, none, load1(alpha_v, 0, 0, j - 1),
            scale(load1(KC, 0, i, j - 1), t01) + scale(load1(KC, 1, i - 1, j - 1), t11),
            scale(load1(KC, 4, i, j - 1), t01) + scale(load1(KC, 5, i - 1, j - 1), t11),
        )  # fmt: skip
        block = block + cross_block(
            flexure, i, j + 1, none, once, none, none - load1(alpha_v, 1, 0, j + 1),
            scale(load1(KC, 2, i, j), t00) + scale(load1(KC, 3, i - 1, j), t10),
            scale(load1(KC, 6, i, j), t00) + scale(load1(KC, 7, i - 1, j), t10),
        )  # fmt: skip
        add6(blocks_out, 0, i, j, block)

    return SimpleNamespace(
        module=module,
        change=change,
        change_along=change_along,
        couple=couple,
        energy_coupling=energy_coupling,
        block_coupling=block_coupling,
    )
