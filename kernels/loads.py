"""Loads on nodes: gravity, drag, springs (design 1.1). z is the unknown position, (z - w)/tau its velocity.

    term     incremental potential, per node                   gradient                     block
    gravity  -m g.(z - x)                                      -m g                         0
    drag     (gamma m/(2 tau)) |z - w|^2                       (gamma m/tau) (z - w)        (gamma m/tau) 1
    springs  (k/2) (|z - p|^2 - |x - p|^2)                     k (z - p)                    k 1

m: mass; x: start of the step. Potentials are relative (to z = x, for drag to z = w): with constants left out they keep
their digits in float32. Outside the body m is zero, and so is every result.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes


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
