"""Elastic solids: energy, gradient and Hessian product of cells of twelve edges and six faces (design 1.3).

A cell is a truss. Its strains are differences since rest of squared lengths: of its twelve edges e, and of the two
diagonals of each of its six faces, for the mean edges of a face have m1.m2 = (|D|^2 - |E|^2)/4, where D = r11 - r00 and
E = r10 - r01:

    q = (|e|^2 - |e0|^2)/2,      q = (|D|^2 - |E|^2 - |D0|^2 + |E0|^2)/2

So every force acts along an edge or the diagonal of a face, and all of them follow from one stress per edge and face,
dW/dq = s: the force on an end is s e, or s D and -s E. The four edges along an axis are taken as modes: their sum, the
slopes along the two other axes, the cross mode; the two faces of an orientation as sum and difference. Sums are coupled
by Hooke's law in space, slopes and differences along one axis by that of plane stress, cross modes by nothing. The
coefficients (:mod:`warpdeform.forces.solid_coefficients`) leave no mode without energy and none too stiff: 18 strains
for 24 - 6 motions. In the `orthogonal` variant K multiplies q as it is: of cells that are rectangular boxes, and of the
paper's weights in any chart. Else edges count by t q, relative to their rest length, and K has the metric.

Cells write their eighteen stresses, nodes gather them: an edge adds up those of up to four cells, a face those of two.
A vector per corner of a cell in their place would be 21 numbers instead of 18; formed in the basis of mean edges and
their differences it took 1.1 to 1.5 times as long.

The Hessian is projected: Gauss-Newton part exact; of the geometric stiffness the tension of edges, and of faces the
stress of that diagonal which is in tension, both summed over cells first, so that nothing is clipped that balances.

Axes: u is `u` rows away, v one row, w one column (:class:`warpdeform.grid.Layout`). Kernels start at row `first`.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.solid_geometry import solid_geometry

FLUX_COMPONENTS = 18
"""Stresses of a cell: u-edges at (v, w) = 00, 10, 01, 11, v-edges at (u, w), w-edges at (u, v); uv-faces at w = 0, 1,
uw-faces at v, vw-faces at u."""
NUMBER_COMPONENTS = 6
"""What is kept of edges and faces at the node they begin at: along u, v, w; spanned by uv, uw, vw."""


@functools.cache
def solid(width: int, real: Any, orthogonal: bool) -> SimpleNamespace:
    """Kernels of the elastic solid for one lane width, precision and kind of chart.

    Args:
        width: Lane width.
        real: ``wp.float32`` or ``wp.float64``.
        orthogonal: See above.

    Returns:
        Kernels ``stress_cells``, ``sum_stress``, ``gather_gradient``, ``product_cells``, ``gather_product``,
        ``energy_cells`` and ``measure``.
    """
    words, shape = lanes(width, real), solid_geometry(width, real, orthogonal)
    L, V = words.L, words.V
    load1, load3, store1, store3 = words.load1, words.load3, words.store1, words.store3
    dot3, scale, mul, at_least, sum_lanes = words.dot3, words.scale, words.mul, words.at_least, words.sum_lanes
    numbers, strains, stress = shape.numbers, shape.strains, shape.stress
    zero, quarter, half = real(0.0), real(0.25), real(0.5)
    module = kernel_module("solid_" + ("orthogonal" if orthogonal else "general"), width, real)

    @wp.func
    def square(a: V):
        return dot3(a, a)

    @wp.func
    def store_stress(
        flux: wp.array3d(dtype=real), i: int, j: int,
        u00: L, u10: L, u01: L, u11: L, v00: L, v10: L, v01: L, v11: L, w00: L, w10: L, w01: L, w11: L,
        uv0: L, uv1: L, uw0: L, uw1: L, vw0: L, vw1: L,
    ):  # fmt: skip
        store1(flux, 0, i, j, u00)
        store1(flux, 1, i, j, u10)
        store1(flux, 2, i, j, u01)
        store1(flux, 3, i, j, u11)
        store1(flux, 4, i, j, v00)
        store1(flux, 5, i, j, v10)
        store1(flux, 6, i, j, v01)
        store1(flux, 7, i, j, v11)
        store1(flux, 8, i, j, w00)
        store1(flux, 9, i, j, w10)
        store1(flux, 10, i, j, w01)
        store1(flux, 11, i, j, w11)
        store1(flux, 12, i, j, uv0)
        store1(flux, 13, i, j, uv1)
        store1(flux, 14, i, j, uw0)
        store1(flux, 15, i, j, uw1)
        store1(flux, 16, i, j, vw0)
        store1(flux, 17, i, j, vw1)

    @wp.kernel(module=module)
    def measure(first: int, u: int, r: wp.array3d(dtype=real), q_out: wp.array3d(dtype=real)):
        """|e|^2/2 of the edges that begin at a node, (|D|^2 - |E|^2)/2 of the faces."""
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        r000, r100, r010, r001 = load3(r, 0, i, j), load3(r, 0, i + u, j), load3(r, 0, i + 1, j), load3(r, 0, i, j + 1)
        r110, r101, r011 = load3(r, 0, i + u + 1, j), load3(r, 0, i + u, j + 1), load3(r, 0, i + 1, j + 1)
        store1(q_out, 0, i, j, half * square(r100 - r000))
        store1(q_out, 1, i, j, half * square(r010 - r000))
        store1(q_out, 2, i, j, half * square(r001 - r000))
        store1(q_out, 3, i, j, half * (square(r110 - r000) - square(r100 - r010)))
        store1(q_out, 4, i, j, half * (square(r101 - r000) - square(r100 - r001)))
        store1(q_out, 5, i, j, half * (square(r011 - r000) - square(r010 - r001)))

    @wp.kernel(module=module)
    def stress_cells(
        first: int,
        u: int,
        r: wp.array3d(dtype=real),
        q0: wp.array3d(dtype=real),
        share: wp.array3d(dtype=real),
        K: wp.array3d(dtype=real),
        t: wp.array3d(dtype=real),
        space: real,
        plane: real,
        each: int,
        mean_out: wp.array3d(dtype=real),
        flux_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        (
            u00, u10, u01, u11, v00, v10, v01, v11, w00, w10, w01, w11, uv0, uv1, uw0, uw1, vw0, vw1,
        ) = strains(r, q0, i, j, u)  # fmt: skip
        (
            su00, su10, su01, su11, sv00, sv10, sv01, sv11, sw00, sw10, sw01, sw11, suv0, suv1, suw0, suw1, svw0, svw1,
        ) = stress(
            share, K, t, space, plane, each, i, j, u,
            u00, u10, u01, u11, v00, v10, v01, v11, w00, w10, w01, w11, uv0, uv1, uw0, uw1, vw0, vw1,
        )  # fmt: skip
        store_stress(
            flux_out, i, j,
            su00, su10, su01, su11, sv00, sv10, sv01, sv11, sw00, sw10, sw01, sw11, suv0, suv1, suw0, suw1, svw0, svw1,
        )  # fmt: skip
        # For coarser grids.
        store1(mean_out, 0, i, j, at_least(quarter * (su00 + su10 + su01 + su11), zero))
        store1(mean_out, 1, i, j, at_least(quarter * (sv00 + sv10 + sv01 + sv11), zero))
        store1(mean_out, 2, i, j, at_least(quarter * (sw00 + sw10 + sw01 + sw11), zero))
        store1(mean_out, 3, i, j, half * (suv0 + suv1))
        store1(mean_out, 4, i, j, half * (suw0 + suw1))
        store1(mean_out, 5, i, j, half * (svw0 + svw1))

    @wp.kernel(module=module)
    def product_cells(
        first: int,
        u: int,
        r: wp.array3d(dtype=real),
        share: wp.array3d(dtype=real),
        K: wp.array3d(dtype=real),
        t: wp.array3d(dtype=real),
        space: real,
        plane: real,
        each: int,
        p: wp.array3d(dtype=real),
        flux_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        (
            u00, u10, u01, u11, v00, v10, v01, v11, w00, w10, w01, w11, uv0, uv1, uw0, uw1, vw0, vw1,
        ) = numbers(r, p, i, j, u)  # fmt: skip
        (
            su00, su10, su01, su11, sv00, sv10, sv01, sv11, sw00, sw10, sw01, sw11, suv0, suv1, suw0, suw1, svw0, svw1,
        ) = stress(
            share, K, t, space, plane, each, i, j, u,
            u00, u10, u01, u11, v00, v10, v01, v11, w00, w10, w01, w11, uv0, uv1, uw0, uw1, vw0, vw1,
        )  # fmt: skip
        store_stress(
            flux_out, i, j,
            su00, su10, su01, su11, sv00, sv10, sv01, sv11, sw00, sw10, sw01, sw11, suv0, suv1, suw0, suw1, svw0, svw1,
        )  # fmt: skip

    @wp.kernel(module=module)
    def energy_cells(
        first: int,
        u: int,
        r: wp.array3d(dtype=real),
        q0: wp.array3d(dtype=real),
        share: wp.array3d(dtype=real),
        K: wp.array3d(dtype=real),
        t: wp.array3d(dtype=real),
        space: real,
        plane: real,
        each: int,
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        (
            u00, u10, u01, u11, v00, v10, v01, v11, w00, w10, w01, w11, uv0, uv1, uw0, uw1, vw0, vw1,
        ) = strains(r, q0, i, j, u)  # fmt: skip
        (
            su00, su10, su01, su11, sv00, sv10, sv01, sv11, sw00, sw10, sw01, sw11, suv0, suv1, suw0, suw1, svw0, svw1,
        ) = stress(
            share, K, t, space, plane, each, i, j, u,
            u00, u10, u01, u11, v00, v10, v01, v11, w00, w10, w01, w11, uv0, uv1, uw0, uw1, vw0, vw1,
        )  # fmt: skip
        e = (mul(su00, u00) + mul(su10, u10)) + (mul(su01, u01) + mul(su11, u11))
        e = e + ((mul(sv00, v00) + mul(sv10, v10)) + (mul(sv01, v01) + mul(sv11, v11)))
        e = e + ((mul(sw00, w00) + mul(sw10, w10)) + (mul(sw01, w01) + mul(sw11, w11)))
        f = (mul(suv0, uv0) + mul(suv1, uv1)) + (mul(suw0, uw0) + mul(suw1, uw1)) + (mul(svw0, vw0) + mul(svw1, vw1))
        partials_out[i, j] = partials_out[i, j] + wp.float64(0.5) * sum_lanes(e + f)

    @wp.func
    def edge_stress(flux: wp.array3d(dtype=real), c: int, i: int, j: int, bi: int, bj: int, ci: int, cj: int):
        """Sum over the four cells of an edge; (bi, bj) and (ci, cj) are the steps along the two other axes."""
        return (load1(flux, c, i, j) + load1(flux, c + 1, i - bi, j - bj)) + (
            load1(flux, c + 2, i - ci, j - cj) + load1(flux, c + 3, i - bi - ci, j - bj - cj)
        )

    @wp.func
    def face_stress(flux: wp.array3d(dtype=real), c: int, i: int, j: int, ci: int, cj: int):
        """Sum over the two cells of a face; (ci, cj) is the step along the third axis."""
        return load1(flux, c, i, j) + load1(flux, c + 1, i - ci, j - cj)

    @wp.kernel(module=module)
    def sum_stress(first: int, u: int, flux: wp.array3d(dtype=real), stress_out: wp.array3d(dtype=real)):
        """Stresses of the edges and faces that begin at a node."""
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        store1(stress_out, 0, i, j, edge_stress(flux, 0, i, j, 1, 0, 0, 1))
        store1(stress_out, 1, i, j, edge_stress(flux, 4, i, j, u, 0, 0, 1))
        store1(stress_out, 2, i, j, edge_stress(flux, 8, i, j, u, 0, 1, 0))
        store1(stress_out, 3, i, j, face_stress(flux, 12, i, j, 0, 1))
        store1(stress_out, 4, i, j, face_stress(flux, 14, i, j, 1, 0))
        store1(stress_out, 5, i, j, face_stress(flux, 16, i, j, u, 0))

    @wp.func
    def pull_edges(
        s: wp.array3d(dtype=real), c: int, r: wp.array3d(dtype=real), r0: V, i: int, j: int, ai: int, aj: int
    ):
        """Force on a node of its two edges along an axis with the step (ai, aj)."""
        return scale(load1(s, c, i, j), load3(r, 0, i + ai, j + aj) - r0) + scale(
            load1(s, c, i - ai, j - aj), load3(r, 0, i - ai, j - aj) - r0
        )

    @wp.func
    def pull_faces(
        s: wp.array3d(dtype=real), c: int, r: wp.array3d(dtype=real), r0: V,
        i: int, j: int, ai: int, aj: int, bi: int, bj: int,
    ):  # fmt: skip
        """Force on a node of its four faces spanned by the steps (ai, aj) and (bi, bj): D of two, E of two others."""
        f = scale(load1(s, c, i, j), load3(r, 0, i + ai + bi, j + aj + bj) - r0)
        f = f + scale(load1(s, c, i - ai - bi, j - aj - bj), load3(r, 0, i - ai - bi, j - aj - bj) - r0)
        f = f - scale(load1(s, c, i - bi, j - bj), load3(r, 0, i + ai - bi, j + aj - bj) - r0)
        return f - scale(load1(s, c, i - ai, j - aj), load3(r, 0, i - ai + bi, j - aj + bj) - r0)

    @wp.kernel(module=module)
    def gather_gradient(
        first: int,
        u: int,
        r: wp.array3d(dtype=real),
        s: wp.array3d(dtype=real),
        gradient_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        r0 = load3(r, 0, i, j)
        f = pull_edges(s, 0, r, r0, i, j, u, 0) + pull_edges(s, 1, r, r0, i, j, 1, 0)
        f = f + pull_edges(s, 2, r, r0, i, j, 0, 1) + pull_faces(s, 3, r, r0, i, j, u, 0, 1, 0)
        f = f + pull_faces(s, 4, r, r0, i, j, u, 0, 0, 1) + pull_faces(s, 5, r, r0, i, j, 1, 0, 0, 1)
        store3(gradient_out, 0, i, j, load3(gradient_out, 0, i, j) - f)

    @wp.func
    def pull(
        r: wp.array3d(dtype=real), r0: V, p: wp.array3d(dtype=real), p0: V, ds: L, s: L, i: int, j: int
    ):  # fmt: skip
        """Change of the force that an edge or diagonal to (i, j) exerts: of its stress, and of its direction."""
        return scale(ds, load3(r, 0, i, j) - r0) + scale(s, load3(p, 0, i, j) - p0)

    @wp.func
    def pull_edges_along(
        s: wp.array3d(dtype=real), c: int, r: wp.array3d(dtype=real), r0: V, p: wp.array3d(dtype=real), p0: V,
        flux: wp.array3d(dtype=real), d: int,
        i: int, j: int, ai: int, aj: int, bi: int, bj: int, ci: int, cj: int,
    ):  # fmt: skip
        """Change of `pull_edges`; d is the component of the flux where its edges begin, b and c the other axes."""
        forward, backward = load1(s, c, i, j), load1(s, c, i - ai, j - aj)
        f = pull(
            r, r0, p, p0, edge_stress(flux, d, i, j, bi, bj, ci, cj), at_least(forward, zero), i + ai, j + aj
        )  # fmt: skip
        return f + pull(
            r, r0, p, p0, edge_stress(flux, d, i - ai, j - aj, bi, bj, ci, cj), at_least(backward, zero), i - ai, j - aj
        )

    @wp.func
    def pull_faces_along(
        s: wp.array3d(dtype=real), c: int, r: wp.array3d(dtype=real), r0: V, p: wp.array3d(dtype=real), p0: V,
        flux: wp.array3d(dtype=real), d: int,
        i: int, j: int, ai: int, aj: int, bi: int, bj: int, ci: int, cj: int,
    ):  # fmt: skip
        """Change of `pull_faces`; c is the axis across the faces."""
        d0, d1 = face_stress(flux, d, i, j, ci, cj), face_stress(flux, d, i - ai - bi, j - aj - bj, ci, cj)
        e0, e1 = face_stress(flux, d, i - bi, j - bj, ci, cj), face_stress(flux, d, i - ai, j - aj, ci, cj)
        s0, s1 = at_least(load1(s, c, i, j), zero), at_least(load1(s, c, i - ai - bi, j - aj - bj), zero)
        t0, t1 = at_least(-load1(s, c, i - bi, j - bj), zero), at_least(-load1(s, c, i - ai, j - aj), zero)
        f = pull(r, r0, p, p0, d0, s0, i + ai + bi, j + aj + bj) + pull(r, r0, p, p0, d1, s1, i - ai - bi, j - aj - bj)
        f = f + pull(r, r0, p, p0, -e0, t0, i + ai - bi, j + aj - bj)
        return f + pull(r, r0, p, p0, -e1, t1, i - ai + bi, j - aj + bj)

    @wp.kernel(module=module)
    def gather_product(
        first: int,
        u: int,
        r: wp.array3d(dtype=real),
        s: wp.array3d(dtype=real),
        p: wp.array3d(dtype=real),
        flux: wp.array3d(dtype=real),
        product_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        r0, p0 = load3(r, 0, i, j), load3(p, 0, i, j)
        f = pull_edges_along(s, 0, r, r0, p, p0, flux, 0, i, j, u, 0, 1, 0, 0, 1)
        f = f + pull_edges_along(s, 1, r, r0, p, p0, flux, 4, i, j, 1, 0, u, 0, 0, 1)
        f = f + pull_edges_along(s, 2, r, r0, p, p0, flux, 8, i, j, 0, 1, u, 0, 1, 0)
        f = f + pull_faces_along(s, 3, r, r0, p, p0, flux, 12, i, j, u, 0, 1, 0, 0, 1)
        f = f + pull_faces_along(s, 4, r, r0, p, p0, flux, 14, i, j, u, 0, 0, 1, 1, 0)
        f = f + pull_faces_along(s, 5, r, r0, p, p0, flux, 16, i, j, 1, 0, 0, 1, u, 0)
        store3(product_out, 0, i, j, load3(product_out, 0, i, j) - f)

    return SimpleNamespace(
        module=module,
        measure=measure,
        stress_cells=stress_cells,
        sum_stress=sum_stress,
        gather_gradient=gather_gradient,
        product_cells=product_cells,
        gather_product=gather_product,
        energy_cells=energy_cells,
    )
