"""Elastic surfaces: membrane and bending energy, gradient and Hessian product (design 1.3).

Membrane, per cell with corners r00, r10, r01, r11. Everything is a function of three differences,

    D = r11 - r00,   E = r10 - r01      the diagonals: D + E and D - E are twice the mean u- and v-edges m1, m2
    x = r11 - r10 - r01 + r00           the warp: the u-edges are m1 -+ x/2, the v-edges m2 -+ x/2

through five numbers, linear in the squared lengths of the four edges (s, t, u, v) and the shear m1.m2 (c),

    q = (s, t, c, u, v),   s = (|D|^2 + |E|^2 + |x|^2)/2,   t = D.E,   c = (|D|^2 - |E|^2)/2,   u = D.x,   v = E.x
    W = (q - q0)' K (q - q0)/2

K, 5 x 5, holds material, chart and cell area (:mod:`warpdeform.forces.surface_coefficients`). Cells with right angles
and opposite edges alike have six different entries, the `orthogonal` variant: ss, st, tt, cc, uu = vv, uv. The basis of
diagonals needs 20 % fewer operations than mean edges, and shear stress is diagonal in it.

Bending, with unit normal n and second difference s of the positions along an axis (or s = x across a cell),

    b = n.s,    delta b = n.(delta s - Gamma^k delta r_k),    Gamma^k = G^kl r_l.s

b11, b22 at the nodes with n from central differences (one-sided at a border), b12 at the cells with n along
m1 x m2 = E x D / 2; energies (b - b0)' K (b - b0)/2. All differences are undivided: K carries the spacings. On charts
whose axes are not orthogonal :mod:`warpdeform.kernels.surface_coupling` adds what couples b12 to b11 and b22.

The Hessian is projected: Gauss-Newton part exact; tension of each pair of edges (their mean: its variation within a
cell would cost 12 % more operations and changes the rate of convergence only) and shear stress clipped to what is
positive semi-definite; geometric part of bending left out (design 2.1).
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.products import Gathering
from warpdeform.kernels.surface_geometry import geometry

FLUX_COMPONENTS = 9
"""Derivatives of a cell's energy by D, E and x."""
TENSION_COMPONENTS = 4
"""Clipped geometric stiffness of a cell, a symmetric matrix over (D, E, x): DD, EE, xx, DE."""
TWIST_COMPONENTS = 5
"""Linearised b12 of a cell: n, Gamma^D, Gamma^E."""
FLEXURE_COMPONENTS = 7
"""Linearised b11, b22 of a node: n, Gamma^1_11, Gamma^2_11, Gamma^1_22, Gamma^2_22."""
SCATTER_COMPONENTS = 4
"""Bending force of a node sample along its n on the neighbours i + 1, i - 1, j + 1, j - 1; the node gets the rest."""


def variant_name(orthogonal: bool, bending: bool) -> str:
    """What the modules of a variant are called."""
    return ("orthogonal" if orthogonal else "general") + ("_bending" if bending else "")


@functools.cache
def surface(width: int, real: Any, orthogonal: bool, bending: bool) -> SimpleNamespace:
    """Kernels of the elastic surface for one lane width, precision, kind of chart, with or without bending.

    Args:
        width: Lane width.
        real: ``wp.float32`` or ``wp.float64``.
        orthogonal: K has only the entries ss, st, tt, cc, uu = vv, uv (six components); else its upper triangle, row by
            row (fifteen components).
        bending: Include the curvature terms; False compiles none of them.

    Returns:
        Kernels ``stress_cells``, ``stress_nodes``, ``product_cells``, ``product_nodes``, ``gather``, ``energy_cells``,
        ``energy_nodes``, ``measure_membrane`` and ``measure_bending``; ``gathering``, for products with A.
    """
    words, shape = lanes(width, real), geometry(width, real, orthogonal)
    load1, load3, store1, store3 = words.load1, words.load3, words.store1, words.store3
    add3, sum_lanes = words.add3, words.sum_lanes
    dot3, scale, mul = words.dot3, words.scale, words.mul
    diagonals, stress, numbers = shape.diagonals, shape.stress, shape.numbers
    strains, strain_changes = shape.strains, shape.strain_changes
    cell_forces, store_tension, tensed = shape.cell_forces, shape.store_tension, shape.tensed
    unit_normal, christoffel = shape.unit_normal, shape.christoffel
    tangent_u, tangent_v, second_u, second_v = shape.tangent_u, shape.tangent_v, shape.second_u, shape.second_v
    flexed, store_scatter = shape.flexed, shape.store_scatter
    two = real(2.0)
    module = kernel_module(f"surface_{variant_name(orthogonal, bending)}", width, real)

    @wp.kernel(module=module)
    def stress_cells(
        r: wp.array3d(dtype=real),
        K: wp.array3d(dtype=real),
        q0: wp.array3d(dtype=real),
        K12: wp.array3d(dtype=real),
        b0: wp.array3d(dtype=real),
        floor: real,
        tension_out: wp.array3d(dtype=real),
        twist_out: wp.array3d(dtype=real),
        flux_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d, e, x = diagonals(r, i, j)
        s, t, c, u, v = strains(d, e, x, q0, i, j)
        ss, st, sc, su, sv = stress(K, i, j, s, t, c, u, v)
        store_tension(tension_out, i, j, ss, st, sc)
        fd, fe, fx = cell_forces(d, e, x, ss, st, sc, su, sv)
        if wp.static(bending):
            n = unit_normal(e, d, floor)
            gamma_d, gamma_e = christoffel(d, e, x, floor)
            store3(twist_out, 0, i, j, n)
            store1(twist_out, 3, i, j, gamma_d)
            store1(twist_out, 4, i, j, gamma_e)
            moment = mul(load1(K12, 0, i, j), dot3(n, x) - load1(b0, 2, i, j))
            fd = fd - scale(mul(gamma_d, moment), n)
            fe = fe - scale(mul(gamma_e, moment), n)
            fx = fx + scale(moment, n)
        store3(flux_out, 0, i, j, fd)
        store3(flux_out, 3, i, j, fe)
        store3(flux_out, 6, i, j, fx)

    @wp.kernel(module=module)
    def product_cells(
        r: wp.array3d(dtype=real),
        K: wp.array3d(dtype=real),
        tension: wp.array3d(dtype=real),
        K12: wp.array3d(dtype=real),
        twist: wp.array3d(dtype=real),
        p: wp.array3d(dtype=real),
        flux_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d, e, x = diagonals(r, i, j)
        pd, pe, px = diagonals(p, i, j)
        s, t, c, u, v = strain_changes(d, e, x, pd, pe, px)
        ss, st, sc, su, sv = stress(K, i, j, s, t, c, u, v)
        fd, fe, fx = cell_forces(d, e, x, ss, st, sc, su, sv)
        fd, fe, fx = tensed(tension, i, j, fd, fe, fx, pd, pe, px)
        if wp.static(bending):
            n, gamma_d, gamma_e = load3(twist, 0, i, j), load1(twist, 3, i, j), load1(twist, 4, i, j)
            db = dot3(n, px) - mul(gamma_d, dot3(n, pd)) - mul(gamma_e, dot3(n, pe))
            moment = mul(load1(K12, 0, i, j), db)
            fd = fd - scale(mul(gamma_d, moment), n)
            fe = fe - scale(mul(gamma_e, moment), n)
            fx = fx + scale(moment, n)
        store3(flux_out, 0, i, j, fd)
        store3(flux_out, 3, i, j, fe)
        store3(flux_out, 6, i, j, fx)

    @wp.kernel(module=module)
    def stress_nodes(
        r: wp.array3d(dtype=real),
        KB: wp.array3d(dtype=real),
        b0: wp.array3d(dtype=real),
        alpha_u: wp.array3d(dtype=real),
        alpha_v: wp.array3d(dtype=real),
        floor: real,
        flexure_out: wp.array3d(dtype=real),
        scatter_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        r1, r2 = tangent_u(r, alpha_u, i, j), tangent_v(r, alpha_v, i, j)
        s1, s2 = second_u(r, i, j), second_v(r, i, j)
        n = unit_normal(r1, r2, floor)
        g111, g211 = christoffel(r1, r2, s1, floor)
        g122, g222 = christoffel(r1, r2, s2, floor)
        store3(flexure_out, 0, i, j, n)
        store1(flexure_out, 3, i, j, g111)
        store1(flexure_out, 4, i, j, g211)
        store1(flexure_out, 5, i, j, g122)
        store1(flexure_out, 6, i, j, g222)
        e1, e2 = dot3(n, s1) - load1(b0, 0, i, j), dot3(n, s2) - load1(b0, 1, i, j)
        k12 = load1(KB, 1, i, j)
        moment1 = mul(load1(KB, 0, i, j), e1) + mul(k12, e2)
        moment2 = mul(k12, e1) + mul(load1(KB, 2, i, j), e2)
        g1, g2 = mul(moment1, g111) + mul(moment2, g122), mul(moment1, g211) + mul(moment2, g222)
        store_scatter(scatter_out, alpha_u, alpha_v, i, j, moment1, moment2, g1, g2)

    @wp.kernel(module=module)
    def product_nodes(
        KB: wp.array3d(dtype=real),
        alpha_u: wp.array3d(dtype=real),
        alpha_v: wp.array3d(dtype=real),
        flexure: wp.array3d(dtype=real),
        p: wp.array3d(dtype=real),
        scatter_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        e1, e2 = flexed(flexure, alpha_u, alpha_v, p, i, j)
        g111, g211 = load1(flexure, 3, i, j), load1(flexure, 4, i, j)
        g122, g222 = load1(flexure, 5, i, j), load1(flexure, 6, i, j)
        k12 = load1(KB, 1, i, j)
        moment1 = mul(load1(KB, 0, i, j), e1) + mul(k12, e2)
        moment2 = mul(k12, e1) + mul(load1(KB, 2, i, j), e2)
        g1, g2 = mul(moment1, g111) + mul(moment2, g122), mul(moment1, g211) + mul(moment2, g222)
        store_scatter(scatter_out, alpha_u, alpha_v, i, j, moment1, moment2, g1, g2)

    @wp.struct
    class Fluxes:
        flux: wp.array3d(dtype=real)
        flexure: wp.array3d(dtype=real)
        scatter: wp.array3d(dtype=real)

    @wp.func
    def gathered(fluxes: Fluxes, i: int, j: int):
        """What the fluxes of its cells and of the samples around it make of a node's force."""
        flux, flexure, scatter = fluxes.flux, fluxes.flexure, fluxes.scatter
        # The node is corner 00, 10, 01 and 11 of its four cells.
        f = (load3(flux, 6, i, j) - load3(flux, 0, i, j)) + (load3(flux, 3, i - 1, j) - load3(flux, 6, i - 1, j))
        f = f + (load3(flux, 0, i - 1, j - 1) + load3(flux, 6, i - 1, j - 1))
        f = f - (load3(flux, 3, i, j - 1) + load3(flux, 6, i, j - 1))
        if wp.static(bending):
            own = (load1(scatter, 0, i, j) + load1(scatter, 1, i, j)) + (
                load1(scatter, 2, i, j) + load1(scatter, 3, i, j)
            )
            f = f + (
                scale(load1(scatter, 0, i - 1, j), load3(flexure, 0, i - 1, j))
                + scale(load1(scatter, 1, i + 1, j), load3(flexure, 0, i + 1, j))
            )
            f = f + (
                scale(load1(scatter, 2, i, j - 1), load3(flexure, 0, i, j - 1))
                + scale(load1(scatter, 3, i, j + 1), load3(flexure, 0, i, j + 1))
            )
            f = f - scale(own, load3(flexure, 0, i, j))
        return f

    @wp.kernel(module=module)
    def gather(fluxes: Fluxes, force_out: wp.array3d(dtype=real)):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        add3(force_out, 0, i, j, gathered(fluxes, i, j))

    @wp.kernel(module=module)
    def energy_cells(
        r: wp.array3d(dtype=real),
        K: wp.array3d(dtype=real),
        q0: wp.array3d(dtype=real),
        K12: wp.array3d(dtype=real),
        b0: wp.array3d(dtype=real),
        floor: real,
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d, e, x = diagonals(r, i, j)
        s, t, c, u, v = strains(d, e, x, q0, i, j)
        ss, st, sc, su, sv = stress(K, i, j, s, t, c, u, v)
        w = (mul(ss, s) + mul(st, t)) + (mul(sc, c) + (mul(su, u) + mul(sv, v)))
        if wp.static(bending):
            b = dot3(unit_normal(e, d, floor), x) - load1(b0, 2, i, j)
            w = w + mul(load1(K12, 0, i, j), mul(b, b))
        partials_out[i, j] = partials_out[i, j] + wp.float64(0.5) * sum_lanes(w)

    @wp.kernel(module=module)
    def energy_nodes(
        r: wp.array3d(dtype=real),
        KB: wp.array3d(dtype=real),
        b0: wp.array3d(dtype=real),
        alpha_u: wp.array3d(dtype=real),
        alpha_v: wp.array3d(dtype=real),
        floor: real,
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        n = unit_normal(tangent_u(r, alpha_u, i, j), tangent_v(r, alpha_v, i, j), floor)
        e1, e2 = dot3(n, second_u(r, i, j)) - load1(b0, 0, i, j), dot3(n, second_v(r, i, j)) - load1(b0, 1, i, j)
        w = mul(load1(KB, 0, i, j), mul(e1, e1)) + mul(load1(KB, 2, i, j), mul(e2, e2))
        w = w + two * mul(load1(KB, 1, i, j), mul(e1, e2))
        partials_out[i, j] = partials_out[i, j] + wp.float64(0.5) * sum_lanes(w)

    @wp.kernel(module=module)
    def measure_membrane(r: wp.array3d(dtype=real), q_out: wp.array3d(dtype=real)):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d, e, x = diagonals(r, i, j)
        s, t, c, u, v = numbers(d, e, x)
        store1(q_out, 0, i, j, s)
        store1(q_out, 1, i, j, t)
        store1(q_out, 2, i, j, c)
        store1(q_out, 3, i, j, u)
        store1(q_out, 4, i, j, v)

    @wp.kernel(module=module)
    def measure_bending(
        r: wp.array3d(dtype=real),
        alpha_u: wp.array3d(dtype=real),
        alpha_v: wp.array3d(dtype=real),
        floor: real,
        b_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        n = unit_normal(tangent_u(r, alpha_u, i, j), tangent_v(r, alpha_v, i, j), floor)
        d, e, x = diagonals(r, i, j)
        store1(b_out, 0, i, j, dot3(n, second_u(r, i, j)))
        store1(b_out, 1, i, j, dot3(n, second_v(r, i, j)))
        store1(b_out, 2, i, j, dot3(unit_normal(e, d, floor), x))

    return SimpleNamespace(
        module=module,
        stress_cells=stress_cells,
        product_cells=product_cells,
        stress_nodes=stress_nodes,
        product_nodes=product_nodes,
        gather=gather,
        gathering=Gathering(f"surface_{variant_name(orthogonal, bending)}", gathered, Fluxes),
        energy_cells=energy_cells,
        energy_nodes=energy_nodes,
        measure_membrane=measure_membrane,
        measure_bending=measure_bending,
    )
