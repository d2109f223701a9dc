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

Squared lengths do not tell a cell from its mirror image. The `barrier` variant adds an energy that does, in the signed
volume J of the mean edges over its value at rest (:mod:`warpdeform.kernels.solid_volume`).

Cells write the forces on their corners, nodes gather them (:mod:`warpdeform.kernels.solid_gather`), whatever the
variant. Seven corners are written, the eighth has minus their sum.
In the basis of mean edges and their differences the same product took 1.1 to 1.3 times as long; eighteen stresses in
place of the forces, and forces formed at the nodes, took as long as this, but read the positions twice.

The Hessian is projected: Gauss-Newton part exact; of the geometric stiffness the tension of edges and of that diagonal
of a face which is in tension, by the mean stress of the cell, the rest left out (design 2.1); so of the volume.

Axes: u is `u` rows away, v one row, w one column (:class:`warpdeform.grid.Layout`). Kernels start at row `first`.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.solid_geometry import solid_geometry
from warpdeform.kernels.solid_volume import solid_volume

NUMBER_COMPONENTS = 6
"""What is kept of the edges along u, v, w and of the faces uv, uw, vw that begin at a node."""
TENSION_COMPONENTS = 6
"""Mean stresses of a cell: of its edges along u, v, w where in tension, of its faces uv, uw, vw."""


def variant_name(orthogonal: bool, barrier: bool) -> str:
    """What the modules of a variant are called."""
    return ("orthogonal" if orthogonal else "general") + ("_barrier" if barrier else "")


@functools.cache
def solid(width: int, real: Any, orthogonal: bool, barrier: bool) -> SimpleNamespace:
    """Kernels of the elastic solid for one lane width, precision and kind of chart, with or without barrier.

    Args:
        width: Lane width.
        real: ``wp.float32`` or ``wp.float64``.
        orthogonal: See above.
        barrier: Include the barrier against inversion; False compiles none of it.

    Returns:
        Kernels ``measure``, ``stress_cells``, ``product_cells`` and ``energy_cells``.
    """
    words, shape, room = lanes(width, real), solid_geometry(width, real, orthogonal), solid_volume(width, real)
    L, V = words.L, words.V
    load1, load3, store1, store3 = words.load1, words.load3, words.store1, words.store3
    dot3, scale, mul, at_least = words.dot3, words.scale, words.mul, words.at_least
    splat, sum_lanes = words.splat, words.sum_lanes
    numbers, strains, stress = shape.numbers, shape.strains, shape.stress
    edge_sums, normals, relative_volume = room.edge_sums, room.normals, room.relative_volume
    barrier_energy, push_of, hardness_of = room.barrier_energy, room.push, room.hardness
    zero, quarter, half = real(0.0), real(0.25), real(0.5)
    module = kernel_module(f"solid_{variant_name(orthogonal, barrier)}", width, real)

    @wp.func
    def square(a: V):
        return dot3(a, a)

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

    @wp.func
    def pull(s: L, t: L, r0: V, r1: V, p0: V, p1: V):
        """Force on the end r1 of an edge or diagonal with stress s and, for a displacement p, tension t."""
        return scale(s, r1 - r0) + scale(t, p1 - p0)

    @wp.func
    def store_forces(
        r: wp.array3d(dtype=real), p: wp.array3d(dtype=real), flux: wp.array3d(dtype=real), i: int, j: int, u: int,
        u00: L, u10: L, u01: L, u11: L, v00: L, v10: L, v01: L, v11: L, w00: L, w10: L, w01: L, w11: L,
        uv0: L, uv1: L, uw0: L, uw1: L, vw0: L, vw1: L,
        t1: L, t2: L, t3: L, t12: L, t13: L, t23: L, push: L,
    ):  # fmt: skip
        """Forces on the corners of a cell from its stresses, and the tensions t that go with the displacement p.

        `push` is the derivative of the barrier by y1.(y2 x y3), y the sums of the edges along the axes.
        """
        r000, r100 = load3(r, 0, i, j), load3(r, 0, i + u, j)
        r010, r110 = load3(r, 0, i + 1, j), load3(r, 0, i + u + 1, j)
        r001, r101 = load3(r, 0, i, j + 1), load3(r, 0, i + u, j + 1)
        r011, r111 = load3(r, 0, i + 1, j + 1), load3(r, 0, i + u + 1, j + 1)
        p000, p100 = load3(p, 0, i, j), load3(p, 0, i + u, j)
        p010, p110 = load3(p, 0, i + 1, j), load3(p, 0, i + u + 1, j)
        p001, p101 = load3(p, 0, i, j + 1), load3(p, 0, i + u, j + 1)
        p011, p111 = load3(p, 0, i + 1, j + 1), load3(p, 0, i + u + 1, j + 1)
        # Edges along w.
        f001 = pull(w00, t3, r000, r001, p000, p001)
        f101 = pull(w10, t3, r100, r101, p100, p101)
        f011 = pull(w01, t3, r010, r011, p010, p011)
        f111 = pull(w11, t3, r110, r111, p110, p111)
        f100, f010, f110 = -f101, -f011, -f111
        # Edges along u.
        f100 = f100 + pull(u00, t1, r000, r100, p000, p100)
        e = pull(u10, t1, r010, r110, p010, p110)
        f010, f110 = f010 - e, f110 + e
        e = pull(u01, t1, r001, r101, p001, p101)
        f001, f101 = f001 - e, f101 + e
        e = pull(u11, t1, r011, r111, p011, p111)
        f011, f111 = f011 - e, f111 + e
        # Edges along v.
        f010 = f010 + pull(v00, t2, r000, r010, p000, p010)
        e = pull(v10, t2, r100, r110, p100, p110)
        f100, f110 = f100 - e, f110 + e
        e = pull(v01, t2, r001, r011, p001, p011)
        f001, f011 = f001 - e, f011 + e
        e = pull(v11, t2, r101, r111, p101, p111)
        f101, f111 = f101 - e, f111 + e
        # Faces uv: D of the lower one, its E, D of the upper one, its E.
        d = at_least(t12, zero)
        g = d - t12
        f110 = f110 + pull(uv0, d, r000, r110, p000, p110)
        e = pull(-uv0, g, r010, r100, p010, p100)
        f100, f010 = f100 + e, f010 - e
        e = pull(uv1, d, r001, r111, p001, p111)
        f001, f111 = f001 - e, f111 + e
        e = pull(-uv1, g, r011, r101, p011, p101)
        f101, f011 = f101 + e, f011 - e
        # Faces uw.
        d = at_least(t13, zero)
        g = d - t13
        f101 = f101 + pull(uw0, d, r000, r101, p000, p101)
        e = pull(-uw0, g, r001, r100, p001, p100)
        f100, f001 = f100 + e, f001 - e
        e = pull(uw1, d, r010, r111, p010, p111)
        f010, f111 = f010 - e, f111 + e
        e = pull(-uw1, g, r011, r110, p011, p110)
        f110, f011 = f110 + e, f011 - e
        # Faces vw.
        d = at_least(t23, zero)
        g = d - t23
        f011 = f011 + pull(vw0, d, r000, r011, p000, p011)
        e = pull(-vw0, g, r001, r010, p001, p010)
        f010, f001 = f010 + e, f001 - e
        e = pull(vw1, d, r100, r111, p100, p111)
        f100, f111 = f100 - e, f111 + e
        e = pull(-vw1, g, r101, r110, p101, p110)
        f110, f101 = f110 + e, f101 - e
        if wp.static(barrier):
            y1, y2, y3 = edge_sums(r, i, j, u)
            n1, n2, n3 = normals(y1, y2, y3)
            low, high = scale(push, n1 - n2), scale(push, n1 + n2)
            side = scale(push, n3)
            f100, f010, f110 = f100 + (low - side), f010 - (low + side), f110 + (high - side)
            f001, f101 = f001 + (side - high), f101 + (low + side)
            f011, f111 = f011 + (side - low), f111 + (high + side)
        store3(flux, 0, i, j, f100)
        store3(flux, 3, i, j, f010)
        store3(flux, 6, i, j, f110)
        store3(flux, 9, i, j, f001)
        store3(flux, 12, i, j, f101)
        store3(flux, 15, i, j, f011)
        store3(flux, 18, i, j, f111)

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
        volume: wp.array3d(dtype=real),
        tension_out: wp.array3d(dtype=real),
        hardness_out: wp.array3d(dtype=real),
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
        none = splat(zero)
        push = none
        if wp.static(barrier):
            J = relative_volume(r, volume, i, j, u)
            push = push_of(J, volume, i, j)
            store1(hardness_out, 0, i, j, hardness_of(J, volume, i, j))
        store1(tension_out, 0, i, j, at_least(quarter * (su00 + su10 + su01 + su11), zero))
        store1(tension_out, 1, i, j, at_least(quarter * (sv00 + sv10 + sv01 + sv11), zero))
        store1(tension_out, 2, i, j, at_least(quarter * (sw00 + sw10 + sw01 + sw11), zero))
        store1(tension_out, 3, i, j, half * (suv0 + suv1))
        store1(tension_out, 4, i, j, half * (suw0 + suw1))
        store1(tension_out, 5, i, j, half * (svw0 + svw1))
        store_forces(
            r, r, flux_out, i, j, u,
            su00, su10, su01, su11, sv00, sv10, sv01, sv11, sw00, sw10, sw01, sw11, suv0, suv1, suw0, suw1, svw0, svw1,
            none, none, none, none, none, none, push,
        )  # fmt: skip

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
        tension: wp.array3d(dtype=real),
        hardness: wp.array3d(dtype=real),
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
        push = splat(zero)
        if wp.static(barrier):
            y1, y2, y3 = edge_sums(r, i, j, u)
            p1, p2, p3 = edge_sums(p, i, j, u)
            n1, n2, n3 = normals(y1, y2, y3)
            push = mul(load1(hardness, 0, i, j), dot3(n1, p1) + dot3(n2, p2) + dot3(n3, p3))
        store_forces(
            r, p, flux_out, i, j, u,
            su00, su10, su01, su11, sv00, sv10, sv01, sv11, sw00, sw10, sw01, sw11, suv0, suv1, suw0, suw1, svw0, svw1,
            load1(tension, 0, i, j), load1(tension, 1, i, j), load1(tension, 2, i, j),
            load1(tension, 3, i, j), load1(tension, 4, i, j), load1(tension, 5, i, j), push,
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
        volume: wp.array3d(dtype=real),
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
        energy = half * (e + f)
        if wp.static(barrier):
            energy = energy + barrier_energy(relative_volume(r, volume, i, j, u), volume, i, j)
        partials_out[i, j] = partials_out[i, j] + sum_lanes(energy)

    return SimpleNamespace(
        module=module,
        measure=measure,
        stress_cells=stress_cells,
        product_cells=product_cells,
        energy_cells=energy_cells,
    )
