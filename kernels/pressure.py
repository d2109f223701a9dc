"""Pressure inside a closed surface: the potential -p V of the volume V that it encloses (design 1.1).

A cell is the bilinear patch through its corners, so that the flux of r/3 through it is a third of c.(m1 x m2) with c
the mean of its corners and m1, m2 its mean edges: exactly, and V is the sum of that over a surface without holes.

Ends of an open axis are closed by caps, fans of triangles about the mean g of the rim's n nodes r_k, which carries no
mass: what presses on a cap pulls at its rim, alike at every node. With S = sum of r_k x r_k+1,

    V_cap = (1/6) g.S,    dV_cap/dr_k = (1/6) (S/n + (r_k+1 - r_k-1) x g)

Closed, V does not depend on the origin: its derivative by a node may be taken with the node itself as origin. Then a
cell whose other corners lie at f, d, s from the node, counter-clockwise, adds (f x s + f x d + d x s)/12, and float32
keeps its digits wherever the body is. Energies are differences to the start x of the step, of differences of positions.
The second derivative of -p V is not positive semi-definite, and is left out.

Where both ends close at poles, V is (4 V_nodes - V_centres)/3, with the volume within the surface of the cells' centres
c; its caps are fans from the ring of centres to the same g. On a ring of radius k h around a pole the push on the nodes
within is that on the area within, times 1 + 1/(12 k^2) by V_nodes and 1 + 1/(3 k^2) by V_centres; membrane forces have
no such error, and an 8 % that does not fall with h bent every sphere at its poles. It is the better volume, too: the
corners of both surfaces lie on the shape, their faces within it, and of the error half is left.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes


@functools.cache
def pressure(width: int, real: Any) -> SimpleNamespace:
    """Kernels of the cells for one lane width and precision: ``add_energy`` and ``add_gradient``.

    `push` holds p [Pa], negative where normals point inwards, shape (1,). `cells_u`, (1, rows, 1), and `cells_v`,
    (1, 1, columns), are 1 where there is a cell from a row or column to the next, else 0.
    """
    words = lanes(width, real)
    L, V = words.L, words.V
    load1, load3, add3, along_u = words.load1, words.load3, words.add3, words.along_u
    dot3, cross3, scale, mul, splat = words.dot3, words.cross3, words.scale, words.mul, words.splat
    spread3, sum_lanes = words.spread3, words.sum_lanes
    quarter, half = real(0.25), real(0.5)
    third, twelfth = real(1.0 / 3.0), real(1.0 / 12.0)
    module = kernel_module("pressure", width, real)

    @wp.func
    def patch(r: wp.array3d(dtype=real), i: int, j: int):
        """Sum of the corners and mean edges of the cell at (i, j)."""
        r00, r10 = load3(r, 0, i, j), load3(r, 0, i + 1, j)
        r01, r11 = load3(r, 0, i, j + 1), load3(r, 0, i + 1, j + 1)
        d, e = r11 - r00, r10 - r01
        return (r00 + r10) + (r01 + r11), half * (d + e), half * (d - e)

    @wp.kernel(module=module)
    def add_energy(
        start: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        cells_u: wp.array3d(dtype=real),
        cells_v: wp.array3d(dtype=real),
        whole_start: wp.array3d(dtype=real),
        origin_column: int,
        push: wp.array(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        """The origin is where the first node starts, for whatever rows; `whole_start` has all of them."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        origin = spread3(whole_start, 0, 1, origin_column)
        sum0, m1, m2 = patch(start, i, j)
        sum_z, n1, n2 = patch(position, i, j)
        grown = quarter * dot3(sum_z - sum0, cross3(n1, n2))
        grown = grown + dot3(quarter * sum0 - origin, cross3(n1 - m1, n2) + cross3(m1, n2 - m2))
        cell = mul(along_u(cells_u, 0, i), load1(cells_v, 0, 0, j))
        partials_out[i, j] = partials_out[i, j] - sum_lanes((push[0] * third) * mul(cell, grown))

    @wp.func
    def corner(f: V, d: V, s: V, cell: L):
        """Twelve times what a cell adds whose other corners lie at f, d, s from the node."""
        return scale(cell, cross3(f, s) + (cross3(f, d) + cross3(d, s)))

    @wp.kernel(module=module)
    def add_gradient(
        position: wp.array3d(dtype=real),
        cells_u: wp.array3d(dtype=real),
        cells_v: wp.array3d(dtype=real),
        push: wp.array(dtype=real),
        gradient_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        r = load3(position, 0, i, j)
        up, um = load3(position, 0, i + 1, j) - r, load3(position, 0, i - 1, j) - r
        vp, vm = load3(position, 0, i, j + 1) - r, load3(position, 0, i, j - 1) - r
        next_u, last_u = along_u(cells_u, 0, i), along_u(cells_u, 0, i - 1)
        next_v, last_v = load1(cells_v, 0, 0, j), load1(cells_v, 0, 0, j - 1)
        a = corner(up, load3(position, 0, i + 1, j + 1) - r, vp, mul(next_u, next_v))
        a = a + corner(vp, load3(position, 0, i - 1, j + 1) - r, um, mul(last_u, next_v))
        a = a + corner(um, load3(position, 0, i - 1, j - 1) - r, vm, mul(last_u, last_v))
        a = a + corner(vm, load3(position, 0, i + 1, j - 1) - r, up, mul(next_u, last_v))
        add3(gradient_out, 0, i, j, scale(splat(-push[0] * twelfth), a))

    return SimpleNamespace(module=module, add_energy=add_energy, add_gradient=add_gradient)


@functools.cache
def centres(width: int, real: Any) -> SimpleNamespace:
    """Kernels of the cells' centres for one lane width and precision: ``find_centres`` and ``add_shares``."""
    words = lanes(width, real)
    load3, store3, add3, vector, splat = words.load3, words.store3, words.add3, words.vector, words.splat
    zero, quarter = real(0.0), real(0.25)
    module = kernel_module("pressure_centres", width, real)

    @wp.kernel(module=module)
    def find_centres(
        position: wp.array3d(dtype=real),
        centres_out: wp.array3d(dtype=real),
        centres_gradient_out: wp.array3d(dtype=real),
    ):
        """The mean of its corners at every cell, with no gradient yet; where no cell is it means nothing."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        c = (load3(position, 0, i, j) + load3(position, 0, i + 1, j)) + (
            load3(position, 0, i, j + 1) + load3(position, 0, i + 1, j + 1)
        )
        store3(centres_out, 0, i, j, quarter * c)
        store3(centres_gradient_out, 0, i, j, vector(splat(zero), splat(zero), splat(zero)))

    @wp.kernel(module=module)
    def add_shares(centres_gradient: wp.array3d(dtype=real), gradient_out: wp.array3d(dtype=real)):
        """To every node a quarter of what its cells' centres have, which is zero where no cell is."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        g = (load3(centres_gradient, 0, i, j) + load3(centres_gradient, 0, i - 1, j)) + (
            load3(centres_gradient, 0, i, j - 1) + load3(centres_gradient, 0, i - 1, j - 1)
        )
        add3(gradient_out, 0, i, j, quarter * g)

    return SimpleNamespace(module=module, find_centres=find_centres, add_shares=add_shares)


@functools.cache
def caps(real: Any) -> SimpleNamespace:
    """Kernels of the caps for one precision: ``measure``, one thread per rim, and ``add_energy``, ``add_gradient``.

    `rims` holds rows and columns of the points of each rim in their order, shape (rims, n, 2); `turns` is 1 where that
    is counter-clockwise as seen from outside, else -1. g is the mean of the nodes of `apexes`, of the same shape: the
    rim itself, or the ring of nodes within. `measured` holds g and S of each rim, shape (rims, 6): g as seen from its
    first point [m], S [m2].
    """
    words = lanes(1, real)
    load3, add3, cross3, scale, dot3, V = (
        words.load3, words.add3, words.cross3, words.scale, words.dot3, words.V,
    )  # fmt: skip
    module = kernel_module("caps", 1, real)

    @wp.func
    def point(places: wp.array3d(dtype=wp.int32), k: int, m: int, r: wp.array3d(dtype=real)):
        return load3(r, 0, places[k, m, 0], places[k, m, 1])

    @wp.func
    def cap(
        rims: wp.array3d(dtype=wp.int32),
        k: int,
        r: wp.array3d(dtype=real),
        apexes: wp.array3d(dtype=wp.int32),
        nodes: wp.array3d(dtype=real),
    ):
        """g and S of a rim, as seen from its first point."""
        n = rims.shape[1]
        first = point(rims, k, 0, r)
        g, s, last = point(apexes, k, 0, nodes) - first, V(), V()
        for m in range(1, n):
            here = point(rims, k, m, r) - first
            g += point(apexes, k, m, nodes) - first
            s += cross3(last, here)
            last = here
        return scale(real(1.0) / real(n), g), s

    @wp.kernel(module=module)
    def measure(
        rims: wp.array3d(dtype=wp.int32),
        position: wp.array3d(dtype=real),
        apexes: wp.array3d(dtype=wp.int32),
        nodes: wp.array3d(dtype=real),
        measured_out: wp.array2d(dtype=real),
    ):
        k = wp.tid()
        g, s = cap(rims, k, position, apexes, nodes)
        for c in range(3):
            measured_out[k, c] = g[c]
            measured_out[k, 3 + c] = s[c]

    @wp.kernel(module=module)
    def add_energy(
        rims: wp.array3d(dtype=wp.int32),
        turns: wp.array(dtype=real),
        start: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        apexes: wp.array3d(dtype=wp.int32),
        nodes_start: wp.array3d(dtype=real),
        nodes: wp.array3d(dtype=real),
        origin_column: int,
        push: wp.array(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        """One thread per rim; the origin is where the first point starts."""
        k = wp.tid()
        i, j = rims[k, 0, 0], rims[k, 0, 1]
        g0, s0 = cap(rims, k, start, apexes, nodes_start)
        gz, sz = cap(rims, k, position, apexes, nodes)
        from_origin = load3(start, 0, i, j) - load3(start, 0, 1, origin_column)
        moved = load3(position, 0, i, j) - load3(start, 0, i, j)
        grown = dot3((gz - g0) + moved, sz) + dot3(g0 + from_origin, sz - s0)
        partials_out[i, j] = partials_out[i, j] - wp.float64(push[0] * turns[k] * grown) / wp.float64(6.0)

    @wp.kernel(module=module)
    def add_gradient(
        rims: wp.array3d(dtype=wp.int32),
        turns: wp.array(dtype=real),
        measured: wp.array2d(dtype=real),
        position: wp.array3d(dtype=real),
        push: wp.array(dtype=real),
        gradient_out: wp.array3d(dtype=real),
    ):
        """One thread per point of a rim: what moves S."""
        k, m = wp.tid()
        n = rims.shape[1]
        i, j = rims[k, m, 0], rims[k, m, 1]
        g = V(measured[k, 0], measured[k, 1], measured[k, 2]) - (load3(position, 0, i, j) - point(rims, k, 0, position))
        along = point(rims, k, (m + 1) % n, position) - point(rims, k, (m + n - 1) % n, position)
        add3(gradient_out, 0, i, j, scale(-push[0] * turns[k] / real(6.0), cross3(along, g)))

    @wp.kernel(module=module)
    def add_apex_gradient(
        apexes: wp.array3d(dtype=wp.int32),
        turns: wp.array(dtype=real),
        measured: wp.array2d(dtype=real),
        push: wp.array(dtype=real),
        gradient_out: wp.array3d(dtype=real),
    ):
        """One thread per node of the apexes: what moves g."""
        k, m = wp.tid()
        s = V(measured[k, 3], measured[k, 4], measured[k, 5])
        share = -push[0] * turns[k] / (real(6.0) * real(apexes.shape[1]))
        add3(gradient_out, 0, apexes[k, m, 0], apexes[k, m, 1], scale(share, s))

    return SimpleNamespace(
        module=module,
        measure=measure,
        add_energy=add_energy,
        add_gradient=add_gradient,
        add_apex_gradient=add_apex_gradient,
    )
