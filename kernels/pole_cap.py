"""The membrane that closes the poles of a surface (design 1.3, "Spheres").

Around a pole lie n nodes in a ring, half a step from it, opposite each other. Strip k is the quad with the corners

    r00 = ring[k],   r10 = ring[k + 1],   r01 = ring[k + 1 + n/2],   r11 = ring[k + n/2],      k = 0 to n/2 - 1

from an edge of the ring to the edge on the other side: at rest a rectangle. It obeys the law of a cell
(:mod:`warpdeform.kernels.surface`): D and E are the diameters from ring[k] and to ring[k + 1], so that neighbouring
strips share them. Any even strain of the pole is measured exactly, whatever its direction; there is no node in the pole
that everything depends on, and no cell of three corners.

The strips' forces join those of the cells before they are gathered: a node of the ring finds its force in the flux of a
place behind the pole where no cell is, one component of one place for each node. So whatever ends in a gathering, such
as products with A and the smoother's steps, has the poles in it.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.surface_geometry import geometry

STRIP_FLUX = 9
"""Derivatives of a strip's energy by D, E and x."""


@functools.cache
def pole_cap(real: Any) -> SimpleNamespace:
    """Kernels of the poles for one precision; arrays of strips have the shape (components, poles, n/2).

    `rings` holds rows and columns of the nodes around each pole, shape (poles, n, 2); `slots` row and column of the
    place where each finds its force, and the first of its three components, shape (poles, n, 3); `signs` their signs,
    shape (poles,).
    """
    words, shape = lanes(1, real), geometry(1, real, False)
    V = words.V
    load3, store1, store3, add6 = words.load3, words.store1, words.store3, words.add6
    stress, strains, strain_changes, cell_forces = (
        shape.stress, shape.strains, shape.strain_changes, shape.cell_forces,
    )  # fmt: skip
    store_tension, tensed, corner_block = shape.store_tension, shape.tensed, shape.corner_block
    numbers = shape.numbers
    zero, half, one = real(0.0), real(0.5), real(1.0)
    module = kernel_module("pole_cap", 1, real)

    @wp.func
    def at(r: wp.array3d(dtype=real), rings: wp.array3d(dtype=wp.int32), pole: int, m: int):
        k = m % rings.shape[1]
        return load3(r, 0, rings[pole, k, 0], rings[pole, k, 1])

    @wp.func
    def diagonals(r: wp.array3d(dtype=real), rings: wp.array3d(dtype=wp.int32), pole: int, k: int):
        """D, E and x of a strip."""
        across = rings.shape[1] // 2
        r00, r10 = at(r, rings, pole, k), at(r, rings, pole, k + 1)
        r01, r11 = at(r, rings, pole, k + 1 + across), at(r, rings, pole, k + across)
        return r11 - r00, r10 - r01, (r11 - r10) - (r01 - r00)

    @wp.func
    def store_forces(flux: wp.array3d(dtype=real), pole: int, k: int, fd: V, fe: V, fx: V):
        store3(flux, 0, pole, k, fd)
        store3(flux, 3, pole, k, fe)
        store3(flux, 6, pole, k, fx)

    @wp.kernel(module=module)
    def measure(rings: wp.array3d(dtype=wp.int32), r: wp.array3d(dtype=real), q_out: wp.array3d(dtype=real)):
        pole, k = wp.tid()
        d, e, x = diagonals(r, rings, pole, k)
        s, t, c, u, v = numbers(d, e, x)
        store1(q_out, 0, pole, k, s)
        store1(q_out, 1, pole, k, t)
        store1(q_out, 2, pole, k, c)
        store1(q_out, 3, pole, k, u)
        store1(q_out, 4, pole, k, v)

    @wp.kernel(module=module)
    def stress_strips(
        rings: wp.array3d(dtype=wp.int32),
        r: wp.array3d(dtype=real),
        K: wp.array3d(dtype=real),
        q0: wp.array3d(dtype=real),
        tension_out: wp.array3d(dtype=real),
        flux_out: wp.array3d(dtype=real),
    ):
        pole, k = wp.tid()
        d, e, x = diagonals(r, rings, pole, k)
        s, t, c, u, v = strains(d, e, x, q0, pole, k)
        ss, st, sc, su, sv = stress(K, pole, k, s, t, c, u, v)
        store_tension(tension_out, pole, k, ss, st, sc)
        fd, fe, fx = cell_forces(d, e, x, ss, st, sc, su, sv)
        store_forces(flux_out, pole, k, fd, fe, fx)

    @wp.kernel(module=module)
    def product_strips(
        rings: wp.array3d(dtype=wp.int32),
        r: wp.array3d(dtype=real),
        K: wp.array3d(dtype=real),
        tension: wp.array3d(dtype=real),
        p: wp.array3d(dtype=real),
        flux_out: wp.array3d(dtype=real),
    ):
        pole, k = wp.tid()
        d, e, x = diagonals(r, rings, pole, k)
        pd, pe, px = diagonals(p, rings, pole, k)
        s, t, c, u, v = strain_changes(d, e, x, pd, pe, px)
        ss, st, sc, su, sv = stress(K, pole, k, s, t, c, u, v)
        fd, fe, fx = cell_forces(d, e, x, ss, st, sc, su, sv)
        fd, fe, fx = tensed(tension, pole, k, fd, fe, fx, pd, pe, px)
        store_forces(flux_out, pole, k, fd, fe, fx)

    @wp.kernel(module=module)
    def hand_over(
        slots: wp.array3d(dtype=wp.int32),
        signs: wp.array(dtype=real),
        flux: wp.array3d(dtype=real),
        cells_flux_out: wp.array3d(dtype=real),
    ):
        """Force on a node of the ring, from its two strips, to where the cells' flux is gathered."""
        pole, m = wp.tid()
        across = slots.shape[1] // 2
        # The node begins strip m as its corner r00, or ends it as r11; of the strip before it is the corner r10 or r01.
        own = m % across
        force = load3(flux, 6, pole, own)
        if m < across:
            force -= load3(flux, 0, pole, own)
        else:
            force += load3(flux, 0, pole, own)
        before = (m + across - 1) % across
        force -= load3(flux, 6, pole, before)
        if m >= 1 and m <= across:
            force += load3(flux, 3, pole, before)
        else:
            force -= load3(flux, 3, pole, before)
        store3(cells_flux_out, slots[pole, m, 2], slots[pole, m, 0], slots[pole, m, 1], signs[pole] * force)

    @wp.kernel(module=module)
    def energy_strips(
        rings: wp.array3d(dtype=wp.int32),
        r: wp.array3d(dtype=real),
        K: wp.array3d(dtype=real),
        q0: wp.array3d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        """At the place of the strip's first node."""
        pole, k = wp.tid()
        d, e, x = diagonals(r, rings, pole, k)
        s, t, c, u, v = strains(d, e, x, q0, pole, k)
        ss, st, sc, su, sv = stress(K, pole, k, s, t, c, u, v)
        w = half * (ss * s + st * t + sc * c + su * u + sv * v)
        i, j = rings[pole, k, 0], rings[pole, k, 1]
        partials_out[i, j] = partials_out[i, j] + wp.float64(w)

    @wp.kernel(module=module)
    def block_strips(
        rings: wp.array3d(dtype=wp.int32),
        r: wp.array3d(dtype=real),
        K: wp.array3d(dtype=real),
        tension: wp.array3d(dtype=real),
        blocks_out: wp.array3d(dtype=real),
    ):
        """Diagonal block of a node of the ring, from its two strips."""
        pole, m = wp.tid()
        across = rings.shape[1] // 2
        own, before = m % across, (m + across - 1) % across
        side, end = -one, one
        if m >= across:
            side = one
        if m < 1 or m > across:
            end = -one
        d, e, x = diagonals(r, rings, pole, own)
        block = corner_block(K, tension, pole, own, d, e, x, side, zero, one)
        d, e, x = diagonals(r, rings, pole, before)
        block = block + corner_block(K, tension, pole, before, d, e, x, zero, end, -one)
        add6(blocks_out, 0, rings[pole, m, 0], rings[pole, m, 1], block)

    @wp.kernel(module=module)
    def average_tension(tension: wp.array3d(dtype=real), ratio: real, tension_out: wp.array3d(dtype=real)):
        """Mean over all strips of the pole, for strips that are `ratio` times as wide and as long as before.

        As between the cells of two grids (:mod:`warpdeform.kernels.surface_levels`).
        """
        pole, k = wp.tid()
        count = tension.shape[2]
        shear_d, shear_e, pull_u, pull_v = real(0.0), real(0.0), real(0.0), real(0.0)
        for n in range(count):
            both, difference = tension[2, pole, n], tension[3, pole, n]
            shear_d += tension[0, pole, n] - both
            shear_e += tension[1, pole, n] - both
            pull_u += both + difference
            pull_v += both - difference
        mean = one / real(count)
        pull_u, pull_v = half * mean / ratio * pull_u, half * mean * ratio * pull_v
        store1(tension_out, 0, pole, k, pull_u + pull_v + mean * shear_d)
        store1(tension_out, 1, pole, k, pull_u + pull_v + mean * shear_e)
        store1(tension_out, 2, pole, k, pull_u + pull_v)
        store1(tension_out, 3, pole, k, pull_u - pull_v)

    return SimpleNamespace(
        module=module,
        measure=measure,
        stress_strips=stress_strips,
        product_strips=product_strips,
        hand_over=hand_over,
        energy_strips=energy_strips,
        block_strips=block_strips,
        average_tension=average_tension,
    )
