"""The force of an elastic surface alone, for steps that ask for no Hessian: fluxes, and normals with their scatter.

Formulas, arrays and the word that gathers are those of :mod:`warpdeform.kernels.surface`; what is left out is what only
a Hessian needs: tensions are not clipped and stored, nor are Christoffel symbols.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.surface import variant_name
from warpdeform.kernels.surface_geometry import geometry


@functools.cache
def surface_force(width: int, real: Any, orthogonal: bool, bending: bool) -> SimpleNamespace:
    """Kernels ``force_cells`` and ``force_nodes``; arguments as for :func:`warpdeform.kernels.surface.surface`."""
    words, shape = lanes(width, real), geometry(width, real, orthogonal)
    load1, store3 = words.load1, words.store3
    dot3, scale, mul = words.dot3, words.scale, words.mul
    diagonals, stress, strains, cell_forces = shape.diagonals, shape.stress, shape.strains, shape.cell_forces
    unit_normal, christoffel = shape.unit_normal, shape.christoffel
    tangent_u, tangent_v, second_u, second_v = shape.tangent_u, shape.tangent_v, shape.second_u, shape.second_v
    store_scatter = shape.store_scatter
    module = kernel_module(f"surface_force_{variant_name(orthogonal, bending)}", width, real)

    @wp.kernel(module=module)
    def force_cells(
        r: wp.array3d(dtype=real),
        K: wp.array3d(dtype=real),
        q0: wp.array3d(dtype=real),
        K12: wp.array3d(dtype=real),
        b0: wp.array3d(dtype=real),
        floor: real,
        flux_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d, e, x = diagonals(r, i, j)
        s, t, c, u, v = strains(d, e, x, q0, i, j)
        ss, st, sc, su, sv = stress(K, i, j, s, t, c, u, v)
        fd, fe, fx = cell_forces(d, e, x, ss, st, sc, su, sv)
        if wp.static(bending):
            n = unit_normal(e, d, floor)
            gamma_d, gamma_e = christoffel(d, e, x, floor)
            moment = mul(load1(K12, 0, i, j), dot3(n, x) - load1(b0, 2, i, j))
            fd = fd - scale(mul(gamma_d, moment), n)
            fe = fe - scale(mul(gamma_e, moment), n)
            fx = fx + scale(moment, n)
        store3(flux_out, 0, i, j, fd)
        store3(flux_out, 3, i, j, fe)
        store3(flux_out, 6, i, j, fx)

    @wp.kernel(module=module)
    def force_nodes(
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
        e1, e2 = dot3(n, s1) - load1(b0, 0, i, j), dot3(n, s2) - load1(b0, 1, i, j)
        k12 = load1(KB, 1, i, j)
        moment1 = mul(load1(KB, 0, i, j), e1) + mul(k12, e2)
        moment2 = mul(k12, e1) + mul(load1(KB, 2, i, j), e2)
        g1, g2 = mul(moment1, g111) + mul(moment2, g122), mul(moment1, g211) + mul(moment2, g222)
        store_scatter(scatter_out, alpha_u, alpha_v, i, j, moment1, moment2, g1, g2)

    return SimpleNamespace(module=module, force_cells=force_cells, force_nodes=force_nodes)
