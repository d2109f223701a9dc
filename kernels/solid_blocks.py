"""Diagonal blocks of the projected Hessian of elastic solids, for preconditioners.

Compiled only where a preconditioner asks for them. Formulas and coefficients are those of
:mod:`warpdeform.kernels.solid`. Moving a corner of a cell changes the three edges and the three face diagonals that end
there, a of them, by -a.dr: their modes are all the same vector, so the block of a cell is a 6 x 6 law between the six.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.solid import variant_name
from warpdeform.kernels.solid_geometry import solid_geometry
from warpdeform.kernels.solid_volume import solid_volume


@functools.cache
def solid_blocks(width: int, real: Any, orthogonal: bool, barrier: bool) -> SimpleNamespace:
    """Kernel ``block_nodes``; arguments as for :func:`warpdeform.kernels.solid.solid`."""
    words, shape, room = lanes(width, real), solid_geometry(width, real, orthogonal), solid_volume(width, real)
    L = words.L
    load1, load3, load6, store6 = words.load1, words.load3, words.load6, words.store6
    scale, scale6, mul, at_least = words.scale, words.scale6, words.mul, words.at_least
    isotropic, symmetric, outer = words.isotropic, words.symmetric, words.outer
    mean_stress, plane_stress, cross_stress = shape.mean_stress, shape.plane_stress, shape.cross_stress
    face_weights, back, edge_sums, normals = shape.face_weights, shape.back, room.edge_sums, room.normals
    zero = real(0.0)
    module = kernel_module(f"solid_blocks_{variant_name(orthogonal, barrier)}", width, real)

    @wp.func
    def edge_weights(
        share: wp.array3d(dtype=real), t: wp.array3d(dtype=real), ci: int, cj: int, i: int, j: int, ai: int, bi: int
    ):  # fmt: skip
        """What q of the three edges at a corner of the cell (ci, cj) is multiplied with.

        They begin at row ai, at row bi and at column cj, or at the node (i, j).
        """
        if wp.static(orthogonal):
            h = load1(share, 0, ci, cj)
            return h, h, h
        else:
            return load1(t, 0, ai, j), load1(t, 1, bi, j), load1(t, 2, i, cj)

    @wp.func
    def corner_stress(
        K: wp.array3d(dtype=real), space: real, plane: real, i: int, j: int,
        t1: L, t2: L, t3: L, n12: L, n13: L, n23: L, q1: L, q2: L, q3: L, q12: L, q13: L, q23: L,
    ):  # fmt: skip
        """Stresses of the edges and faces at a corner of a cell where q is this and of all others zero."""
        e1, e2, e3 = mul(t1, q1), mul(t2, q2), mul(t3, q3)
        c12, c13, c23 = mul(n12, q12), mul(n13, q13), mul(n23, q23)
        s1, s2, s3, s12, s13, s23 = mean_stress(K, space, i, j, e1, e2, e3, c12, c13, c23)
        a1, a2, a12 = plane_stress(K, plane, i, j, 0, 1, 0, e1, e2, c12)
        b1, b3, b13 = plane_stress(K, plane, i, j, 0, 2, 1, e1, e3, c13)
        c2, c3, d23 = plane_stress(K, plane, i, j, 1, 2, 2, e2, e3, c23)
        return (
            back(t1, (s1 + cross_stress(K, 0, i, j, e1)) + (a1 + b1)),
            back(t2, (s2 + cross_stress(K, 1, i, j, e2)) + (a2 + c2)),
            back(t3, (s3 + cross_stress(K, 2, i, j, e3)) + (b3 + c3)),
            back(n12, s12 + a12),
            back(n13, s13 + b13),
            back(n23, s23 + d23),
        )

    @wp.func
    def corner_block(
        r: wp.array3d(dtype=real), share: wp.array3d(dtype=real), K: wp.array3d(dtype=real), t: wp.array3d(dtype=real),
        space: real, plane: real, each: int, tension: wp.array3d(dtype=real), hardness: wp.array3d(dtype=real),
        i: int, j: int, u: int, a: int, b: int, c: int,
    ):  # fmt: skip
        """Block of a node of the cell on its side a, b, c along u, v, w: 1 where the cell lies ahead, -1 behind."""
        ui = u * a
        r0 = load3(r, 0, i, j)
        a1, a2, a3 = load3(r, 0, i + ui, j) - r0, load3(r, 0, i + b, j) - r0, load3(r, 0, i, j + c) - r0
        # The diagonal D of a face where both steps go the same way, else E, which counts as its negative.
        d12 = real(a * b) * (load3(r, 0, i + ui + b, j) - r0)
        d13 = real(a * c) * (load3(r, 0, i + ui, j + c) - r0)
        d23 = real(b * c) * (load3(r, 0, i + b, j + c) - r0)
        back_u, back_v, back_w = (a - 1) // 2, (b - 1) // 2, (c - 1) // 2
        ci, cj = i + u * back_u + back_v, j + back_w
        ii, jj = ci * each, cj * each
        t1, t2, t3 = edge_weights(share, t, ci, cj, i, j, i + u * back_u, i + back_v)
        n12, n13, n23 = face_weights(share, K, ci, cj, ii, jj)
        x1, x2, x3, x12, x13, x23 = corner_stress(
            K, space, plane, ii, jj, t1, t2, t3, n12, n13, n23, a1[0], a2[0], a3[0], d12[0], d13[0], d23[0]
        )
        y1, y2, y3, y12, y13, y23 = corner_stress(
            K, space, plane, ii, jj, t1, t2, t3, n12, n13, n23, a1[1], a2[1], a3[1], d12[1], d13[1], d23[1]
        )
        z1, z2, z3, z12, z13, z23 = corner_stress(
            K, space, plane, ii, jj, t1, t2, t3, n12, n13, n23, a1[2], a2[2], a3[2], d12[2], d13[2], d23[2]
        )
        block = symmetric(
            scale(x1, a1) + scale(x2, a2) + scale(x3, a3) + (scale(x12, d12) + scale(x13, d13) + scale(x23, d23)),
            scale(y1, a1) + scale(y2, a2) + scale(y3, a3) + (scale(y12, d12) + scale(y13, d13) + scale(y23, d23)),
            scale(z1, a1) + scale(z2, a2) + scale(z3, a3) + (scale(z12, d12) + scale(z13, d13) + scale(z23, d23)),
        )
        # Three edges, and of each face the diagonal that ends here.
        pull = load1(tension, 0, ci, cj) + load1(tension, 1, ci, cj) + load1(tension, 2, ci, cj)
        pull = pull + at_least(real(a * b) * load1(tension, 3, ci, cj), zero)
        pull = pull + at_least(real(a * c) * load1(tension, 4, ci, cj), zero)
        pull = pull + at_least(real(b * c) * load1(tension, 5, ci, cj), zero)
        block = block + isotropic(pull)
        if wp.static(barrier):
            m1, m2, m3 = edge_sums(r, ci, cj, u)
            n1, n2, n3 = normals(m1, m2, m3)
            n = real(a) * n1 + real(b) * n2 + real(c) * n3
            block = block + scale6(load1(hardness, 0, ci, cj), outer(n, n))
        return block

    @wp.kernel(module=module)
    def block_nodes(
        first: int,
        u: int,
        r: wp.array3d(dtype=real),
        share: wp.array3d(dtype=real),
        K: wp.array3d(dtype=real),
        t: wp.array3d(dtype=real),
        space: real,
        plane: real,
        each: int,
        tension: wp.array3d(dtype=real),
        hardness: wp.array3d(dtype=real),
        blocks_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        block = load6(blocks_out, 0, i, j)
        for a in range(-1, 2, 2):
            for b in range(-1, 2, 2):
                for c in range(-1, 2, 2):
                    block = block + corner_block(
                        r, share, K, t, space, plane, each, tension, hardness, i, j, u, a, b, c
                    )  # fmt: skip
        store6(blocks_out, 0, i, j, block)

    return SimpleNamespace(module=module, block_nodes=block_nodes)
