"""Loads on nodes: gravity, wind, drag, springs (design 1.1). z is the unknown position, (z - w)/tau its velocity.

    term     incremental potential, per node                   gradient                     block
    gravity  -m g.(z - x)                                      -m g                         0
    drag     (gamma m/(2 tau)) |z - w|^2                       (gamma m/tau) (z - w)        (gamma m/tau) 1
    springs  (k/2) (|z - p|^2 - |x - p|^2)                     k (z - p)                    k 1
    wind     c A q (q/(2 tau) - s),  q = n.(z - w), s = n.u    -c A (s - q/tau) n           (c A/tau) n n'

m, A: mass and share of the rest area; x: start of the step; u: velocity of the air; n: unit normal. Wind is the paper's
viscous force c (n.v) n with v = u - (z - w)/tau; n and u are frozen where gradients are taken, so that the force is the
exact gradient of its potential. Potentials are relative (to z = x, for wind and drag to z = w): with constants left out
they keep their digits in float32. Outside the body m, A and the weights of n are zero, and so is every result.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes

FACING_COMPONENTS = 4
"""What the wind stores of a node: unit normal n and the component n.u of the stream along it."""


@functools.cache
def gravity(width: int, real: Any) -> SimpleNamespace:
    """Kernels of gravity for one lane width and precision: ``add_energy`` and ``add_gradient``."""
    words = lanes(width, real)
    load1, add1, mul, sum_lanes = words.load1, words.add1, words.mul, words.sum_lanes
    module = kernel_module("gravity", width, real)

    @wp.kernel(module=module)
    def add_energy(
        mass: wp.array3d(dtype=real),
        start: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        acceleration: wp.array(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        fall = acceleration[0] * (load1(position, 0, i, j) - load1(start, 0, i, j))
        fall = fall + acceleration[1] * (load1(position, 1, i, j) - load1(start, 1, i, j))
        fall = fall + acceleration[2] * (load1(position, 2, i, j) - load1(start, 2, i, j))
        partials_out[i, j] = partials_out[i, j] - sum_lanes(mul(load1(mass, 0, i, j), fall))

    @wp.kernel(module=module)
    def add_gradient(
        mass: wp.array3d(dtype=real), acceleration: wp.array(dtype=real), gradient_out: wp.array3d(dtype=real)
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        m = load1(mass, 0, i, j)
        for c in range(3):
            add1(gradient_out, c, i, j, -acceleration[c] * m)

    return SimpleNamespace(add_energy=add_energy, add_gradient=add_gradient)


@functools.cache
def drag(width: int, real: Any) -> SimpleNamespace:
    """Kernels of drag for one lane width and precision: ``add_energy``, ``add_gradient`` and ``add_blocks``.

    `damping` holds gamma/tau [1/s2], shape (1,).
    """
    words = lanes(width, real)
    load1, load3, add3, add6, mul = words.load1, words.load3, words.add3, words.add6, words.mul
    dot3, scale, isotropic, sum_lanes = words.dot3, words.scale, words.isotropic, words.sum_lanes
    half = real(0.5)
    module = kernel_module("drag", width, real)

    @wp.kernel(module=module)
    def add_energy(
        mass: wp.array3d(dtype=real),
        base: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        damping: wp.array(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d = load3(position, 0, i, j) - load3(base, 0, i, j)
        energy = sum_lanes(half * damping[0] * mul(load1(mass, 0, i, j), dot3(d, d)))
        partials_out[i, j] = partials_out[i, j] + energy

    @wp.kernel(module=module)
    def add_gradient(
        mass: wp.array3d(dtype=real),
        base: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        damping: wp.array(dtype=real),
        gradient_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d = load3(position, 0, i, j) - load3(base, 0, i, j)
        add3(gradient_out, 0, i, j, scale(damping[0] * load1(mass, 0, i, j), d))

    @wp.kernel(module=module)
    def add_blocks(mass: wp.array3d(dtype=real), damping: wp.array(dtype=real), blocks_out: wp.array3d(dtype=real)):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        add6(blocks_out, 0, i, j, isotropic(damping[0] * load1(mass, 0, i, j)))

    return SimpleNamespace(add_energy=add_energy, add_gradient=add_gradient, add_blocks=add_blocks)


@functools.cache
def springs(real: Any) -> SimpleNamespace:
    """Kernels of springs, one thread per sprung node, for one precision: energy, gradient and blocks.

    `places` holds row and column of each sprung node, shape (n, 2), no node twice; `points` its p [m], shape (n, 3).
    """
    words = lanes(1, real)
    load3, add3, add6, isotropic = words.load3, words.add3, words.add6, words.isotropic
    dot3, scale, sum_lanes, V = words.dot3, words.scale, words.sum_lanes, words.V
    half = real(0.5)
    module = kernel_module("springs", 1, real)

    @wp.kernel(module=module)
    def add_energy(
        places: wp.array2d(dtype=int),
        stiffness: wp.array(dtype=real),
        points: wp.array2d(dtype=real),
        start: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        n = wp.tid()
        i, j = places[n, 0], places[n, 1]
        p = V(points[n, 0], points[n, 1], points[n, 2])
        z, x = load3(position, 0, i, j), load3(start, 0, i, j)
        energy = sum_lanes(half * stiffness[n] * dot3(z - x, (z - p) + (x - p)))
        partials_out[i, j] = partials_out[i, j] + energy

    @wp.kernel(module=module)
    def add_gradient(
        places: wp.array2d(dtype=int),
        stiffness: wp.array(dtype=real),
        points: wp.array2d(dtype=real),
        position: wp.array3d(dtype=real),
        gradient_out: wp.array3d(dtype=real),
    ):
        n = wp.tid()
        i, j = places[n, 0], places[n, 1]
        p = V(points[n, 0], points[n, 1], points[n, 2])
        add3(gradient_out, 0, i, j, scale(stiffness[n], load3(position, 0, i, j) - p))

    @wp.kernel(module=module)
    def add_blocks(places: wp.array2d(dtype=int), stiffness: wp.array(dtype=real), blocks_out: wp.array3d(dtype=real)):
        n = wp.tid()
        add6(blocks_out, 0, places[n, 0], places[n, 1], isotropic(stiffness[n]))

    return SimpleNamespace(add_energy=add_energy, add_gradient=add_gradient, add_blocks=add_blocks)


def _unit_normal(width: int, real: Any) -> Any:
    """The unit normal of a node: the cross product of central differences, one-sided at a border, over its length.

    `slopes_u`, (2, rows, 1), and `slopes_v`, (2, 1, columns), weigh the differences to the next and from the last node.
    Where the sheet is folded to a point (tangents shorter than about 1e-8 m) the normal shrinks to zero.
    """
    words = lanes(width, real)
    load1, load3, along_u, splat = words.load1, words.load3, words.along_u, words.splat
    dot3, cross3, scale, div, root, at_least = (
        words.dot3, words.cross3, words.scale, words.div, words.root, words.at_least,
    )  # fmt: skip

    @wp.func
    def unit_normal(
        position: wp.array3d(dtype=real), slopes_u: wp.array3d(dtype=real), slopes_v: wp.array3d(dtype=real),
        i: int, j: int,
    ):  # fmt: skip
        r = load3(position, 0, i, j)
        along = scale(along_u(slopes_u, 0, i), load3(position, 0, i + 1, j) - r)
        along = along + scale(along_u(slopes_u, 1, i), r - load3(position, 0, i - 1, j))
        across = scale(load1(slopes_v, 0, 0, j), load3(position, 0, i, j + 1) - r)
        across = across + scale(load1(slopes_v, 1, 0, j), r - load3(position, 0, i, j - 1))
        a = cross3(along, across)
        return scale(div(splat(real(1.0)), root(at_least(dot3(a, a), real(1.0e-30)))), a)

    return unit_normal


@functools.cache
def wind(width: int, real: Any) -> SimpleNamespace:
    """Kernels of the viscous force of the air for one lane width and precision.

    `air` holds c [kg/(m2 s)] and 1/tau [1/s].

    Returns:
        Kernels ``face_stream`` (n and n.u for a stream that is the same everywhere), ``add_energy``, ``add_gradient``
        and ``add_blocks``.
    """
    words = lanes(width, real)
    load1, load3, store1, store3, add3, add6 = (
        words.load1, words.load3, words.store1, words.store3, words.add3, words.add6,
    )  # fmt: skip
    dot3, scale, scale6, mul, outer, sum_lanes = (
        words.dot3, words.scale, words.scale6, words.mul, words.outer, words.sum_lanes,
    )  # fmt: skip
    half = real(0.5)
    module = kernel_module("wind", width, real)
    unit_normal = _unit_normal(width, real)

    @wp.kernel(module=module)
    def face_stream(
        iteration: wp.array(dtype=int),
        frozen_from: int,
        position: wp.array3d(dtype=real),
        slopes_u: wp.array3d(dtype=real),
        slopes_v: wp.array3d(dtype=real),
        stream: wp.array(dtype=real),
        facing_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        if iteration[0] < frozen_from:
            store3(facing_out, 0, i, j, unit_normal(position, slopes_u, slopes_v, i, j))
            s = stream[0] * load1(facing_out, 0, i, j) + stream[1] * load1(facing_out, 1, i, j)
            store1(facing_out, 3, i, j, s + stream[2] * load1(facing_out, 2, i, j))

    @wp.kernel(module=module)
    def add_energy(
        area: wp.array3d(dtype=real),
        facing: wp.array3d(dtype=real),
        base: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        air: wp.array(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        q = dot3(load3(facing, 0, i, j), load3(position, 0, i, j) - load3(base, 0, i, j))
        density = mul(q, half * air[1] * q - load1(facing, 3, i, j))
        partials_out[i, j] = partials_out[i, j] + sum_lanes(air[0] * mul(load1(area, 0, i, j), density))

    @wp.kernel(module=module)
    def add_gradient(
        area: wp.array3d(dtype=real),
        facing: wp.array3d(dtype=real),
        base: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        air: wp.array(dtype=real),
        gradient_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        n = load3(facing, 0, i, j)
        q = dot3(n, load3(position, 0, i, j) - load3(base, 0, i, j))
        slip = air[1] * q - load1(facing, 3, i, j)
        add3(gradient_out, 0, i, j, scale(air[0] * mul(load1(area, 0, i, j), slip), n))

    @wp.kernel(module=module)
    def add_blocks(
        area: wp.array3d(dtype=real),
        facing: wp.array3d(dtype=real),
        air: wp.array(dtype=real),
        blocks_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        n = load3(facing, 0, i, j)
        add6(blocks_out, 0, i, j, scale6(air[0] * air[1] * load1(area, 0, i, j), outer(n, n)))

    return SimpleNamespace(
        face_stream=face_stream, add_energy=add_energy, add_gradient=add_gradient, add_blocks=add_blocks
    )


@functools.cache
def gusts(width: int, real: Any) -> SimpleNamespace:
    """The kernel of a gusting stream (:class:`warpdeform.wind.Wind`) for one lane width and precision.

    `waves` holds wave vectors [1/m] and amplitudes [m/s], shape (m, 6); `phases` is in turns, shape (m,).

    Returns:
        ``face_gusts``: n and n.u at the positions of the nodes.
    """
    words = lanes(width, real)
    load1, store1, store3, mul, splat, L = (
        words.load1, words.store1, words.store3, words.mul, words.splat, words.L,
    )  # fmt: skip
    module = kernel_module("gusts", width, real)
    unit_normal = _unit_normal(width, real)
    # Added and taken away again, it rounds a number to an integer: beyond it a real has no digits behind the point.
    rounder = real(1.5 * 2.0 ** (23 if real is wp.float32 else 52))

    @wp.func
    def cosine_of_turns(turns: L):
        """cos(2 pi turns), to 1.2e-10: a Chebyshev fit in the square of what is left of whole turns."""
        q = turns - ((turns + splat(rounder)) - splat(rounder))
        s = mul(q, q)
        p = splat(real(7.800131424886704)) - real(1.4531122995535755) * s
        p = mul(p, s) - splat(real(26.404668183346548))
        p = mul(p, s) + splat(real(60.242131337659366))
        p = mul(p, s) - splat(real(85.45665831471976))
        p = mul(p, s) + splat(real(64.93938907588694))
        p = mul(p, s) - splat(real(19.739208743453563))
        return mul(p, s) + splat(real(0.9999999998855438))

    @wp.kernel(module=module)
    def face_gusts(
        iteration: wp.array(dtype=int),
        frozen_from: int,
        position: wp.array3d(dtype=real),
        slopes_u: wp.array3d(dtype=real),
        slopes_v: wp.array3d(dtype=real),
        mean: wp.array(dtype=real),
        waves: wp.array2d(dtype=real),
        phases: wp.array(dtype=real),
        facing_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        if iteration[0] < frozen_from:
            store3(facing_out, 0, i, j, unit_normal(position, slopes_u, slopes_v, i, j))
            x, y, z = load1(position, 0, i, j), load1(position, 1, i, j), load1(position, 2, i, j)
            u, v, w = splat(mean[0]), splat(mean[1]), splat(mean[2])
            for m in range(phases.shape[0]):
                turns = waves[m, 0] * x + waves[m, 1] * y + waves[m, 2] * z + splat(phases[m])
                wave = cosine_of_turns(turns)
                u = u + waves[m, 3] * wave
                v = v + waves[m, 4] * wave
                w = w + waves[m, 5] * wave
            s = mul(u, load1(facing_out, 0, i, j)) + mul(v, load1(facing_out, 1, i, j))
            store1(facing_out, 3, i, j, s + mul(w, load1(facing_out, 2, i, j)))

    return SimpleNamespace(face_gusts=face_gusts)
