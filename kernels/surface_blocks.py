"""Diagonal blocks of the projected Hessian of elastic surfaces, for preconditioners.

Compiled only where a preconditioner asks for them. Formulas and coefficients are those of
:mod:`warpdeform.kernels.surface`.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.surface import variant_name
from warpdeform.kernels.surface_geometry import geometry


@functools.cache
def surface_blocks(width: int, real: Any, orthogonal: bool, bending: bool) -> SimpleNamespace:
    """Kernels ``block_cells`` and ``block_nodes``; arguments as for :func:`warpdeform.kernels.surface.surface`."""
    words, shape = lanes(width, real), geometry(width, real, orthogonal)
    L = words.L
    load1, load3, add6, along_u = words.load1, words.load3, words.add6, words.along_u
    scale6, mul, splat, outer = words.scale6, words.mul, words.splat, words.outer
    diagonals, corner_block = shape.diagonals, shape.corner_block
    zero, one, two = real(0.0), real(1.0), real(2.0)
    module = kernel_module(f"surface_blocks_{variant_name(orthogonal, bending)}", width, real)

    @wp.func
    def cell_block(
        r: wp.array3d(dtype=real),
        K: wp.array3d(dtype=real),
        tension: wp.array3d(dtype=real),
        K12: wp.array3d(dtype=real),
        twist: wp.array3d(dtype=real),
        i: int,
        j: int,
        on_d: real,
        on_e: real,
        on_x: real,
    ):
        """Diagonal block of the corner whose motion dr gives dD = on_d dr, dE = on_e dr, dx = on_x dr (0, 1 or -1)."""
        d, e, x = diagonals(r, i, j)
        block = corner_block(K, tension, i, j, d, e, x, on_d, on_e, on_x)
        if wp.static(bending):
            n = load3(twist, 0, i, j)
            b = splat(on_x) - on_d * load1(twist, 3, i, j) - on_e * load1(twist, 4, i, j)
            block = block + scale6(mul(load1(K12, 0, i, j), mul(b, b)), outer(n, n))
        return block

    @wp.kernel(module=module)
    def block_cells(
        r: wp.array3d(dtype=real),
        K: wp.array3d(dtype=real),
        tension: wp.array3d(dtype=real),
        K12: wp.array3d(dtype=real),
        twist: wp.array3d(dtype=real),
        blocks_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        block = cell_block(r, K, tension, K12, twist, i, j, -one, zero, one)
        block = block + cell_block(r, K, tension, K12, twist, i - 1, j, zero, one, -one)
        block = block + cell_block(r, K, tension, K12, twist, i, j - 1, zero, -one, -one)
        block = block + cell_block(r, K, tension, K12, twist, i - 1, j - 1, one, zero, one)
        add6(blocks_out, 0, i, j, block)

    @wp.func
    def flexure_block(
        KB: wp.array3d(dtype=real), flexure: wp.array3d(dtype=real), i: int, j: int, s1: L, s2: L, a1: L, a2: L
    ):
        """Block of a node that enters a sample's second differences with s1, s2 and its tangents with a1, a2."""
        n = load3(flexure, 0, i, j)
        e1 = s1 - mul(load1(flexure, 3, i, j), a1) - mul(load1(flexure, 4, i, j), a2)
        e2 = s2 - mul(load1(flexure, 5, i, j), a1) - mul(load1(flexure, 6, i, j), a2)
        w = mul(load1(KB, 0, i, j), mul(e1, e1)) + mul(load1(KB, 2, i, j), mul(e2, e2))
        return scale6(w + two * mul(load1(KB, 1, i, j), mul(e1, e2)), outer(n, n))

    @wp.kernel(module=module)
    def block_nodes(
        KB: wp.array3d(dtype=real),
        alpha_u: wp.array3d(dtype=real),
        alpha_v: wp.array3d(dtype=real),
        flexure: wp.array3d(dtype=real),
        blocks_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        none, once, centre = splat(zero), splat(one), splat(-two)
        own1 = along_u(alpha_u, 1, i) - along_u(alpha_u, 0, i)
        own2 = load1(alpha_v, 1, 0, j) - load1(alpha_v, 0, 0, j)
        block = flexure_block(KB, flexure, i, j, centre, centre, own1, own2)
        block = block + flexure_block(KB, flexure, i - 1, j, once, none, along_u(alpha_u, 0, i - 1), none)
        block = block + flexure_block(KB, flexure, i + 1, j, once, none, none - along_u(alpha_u, 1, i + 1), none)
        block = block + flexure_block(KB, flexure, i, j - 1, none, once, none, load1(alpha_v, 0, 0, j - 1))
        block = block + flexure_block(KB, flexure, i, j + 1, none, once, none, none - load1(alpha_v, 1, 0, j + 1))
        add6(blocks_out, 0, i, j, block)

    return SimpleNamespace(module=module, block_cells=block_cells, block_nodes=block_nodes)
