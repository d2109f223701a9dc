"""The vectors of a stage of an implicit step.

The stage problem M (z - y)/tau^2 + grad E(z) - f = 0 is the same for every implicit method (design 6.1); a method is
the weights that make w, y and the start z out of what it keeps of the past, a position p and a vector q,

    stage vector = x + weights[0] (p - x) + weights[1] v + weights[2] q

and those that make the estimate of the step's error out of velocities.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.newton import LENGTH


@functools.cache
def stage(width: int, real: Any) -> SimpleNamespace:
    """Lane kernels that make and finish a stage, for one lane width and precision."""
    words = lanes(width, real)
    load1, load3, store3 = words.load1, words.load3, words.store3
    scale, dot3, splat, sum_lanes = words.scale, words.dot3, words.splat, words.sum_lanes
    root, max_lanes = words.root, words.max_lanes
    module = kernel_module("stage", width, real)

    @wp.kernel(module=module)
    def combine(
        weights: wp.array2d(dtype=real),
        row: int,
        x: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        v: wp.array3d(dtype=real),
        vector: wp.array3d(dtype=real),
        a_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        r = load3(x, 0, i, j)
        change = scale(splat(weights[row, 0]), load3(position, 0, i, j) - r)
        change = change + scale(splat(weights[row, 1]), load3(v, 0, i, j))
        change = change + scale(splat(weights[row, 2]), load3(vector, 0, i, j))
        store3(a_out, 0, i, j, r + change)

    @wp.kernel(module=module)
    def place_pins(free: wp.array3d(dtype=real), target: wp.array3d(dtype=real), a_out: wp.array3d(dtype=real)):
        """Pinned nodes to their targets, to the last bit; the others stay."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        f = load1(free, 0, i, j)
        held = splat(real(1.0)) - f
        store3(a_out, 0, i, j, scale(f, load3(a_out, 0, i, j)) + scale(held, load3(target, 0, i, j)))

    @wp.kernel(module=module)
    def place_pins_halfway(
        free: wp.array3d(dtype=real),
        target: wp.array3d(dtype=real),
        x: wp.array3d(dtype=real),
        a_out: wp.array3d(dtype=real),
    ):
        """Pinned nodes to the middle of their way."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        f, r = load1(free, 0, i, j), load3(x, 0, i, j)
        held = splat(real(1.0)) - f
        middle = r + scale(splat(real(0.5)), load3(target, 0, i, j) - r)
        store3(a_out, 0, i, j, scale(f, load3(a_out, 0, i, j)) + scale(held, middle))

    @wp.kernel(module=module)
    def difference(a: wp.array3d(dtype=real), b: wp.array3d(dtype=real), c_out: wp.array3d(dtype=real)):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store3(c_out, 0, i, j, load3(a, 0, i, j) - load3(b, 0, i, j))

    @wp.kernel(module=module)
    def displace(
        scalars: wp.array(dtype=wp.float64),
        a: wp.array3d(dtype=real),
        d: wp.array3d(dtype=real),
        b_out: wp.array3d(dtype=real),
    ):
        """b = a + length d."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        length = splat(real(scalars[LENGTH]))
        store3(b_out, 0, i, j, load3(a, 0, i, j) + scale(length, load3(d, 0, i, j)))

    @wp.kernel(module=module)
    def clear_partials(partials_out: wp.array2d(dtype=wp.float64)):
        ii, group = wp.tid()
        for k in range(width):
            partials_out[ii + 1, (group + 1) * width + k] = wp.float64(0.0)

    @wp.kernel(module=module)
    def add_inertial_energy(
        mass: wp.array3d(dtype=real),
        inertia: wp.array(dtype=real),
        z: wp.array3d(dtype=real),
        y: wp.array3d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        """|z - y|_M^2 / (2 tau^2); overwrites the lane group's entry, so it comes first."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d = load3(z, 0, i, j) - load3(y, 0, i, j)
        energy = dot3(d, scale(inertia[0] * load1(mass, 0, i, j), d))
        partials_out[i, j] = wp.float64(0.5) * sum_lanes(energy)

    @wp.kernel(module=module)
    def inertial_gradient(
        mass: wp.array3d(dtype=real),
        inertia: wp.array(dtype=real),
        z: wp.array3d(dtype=real),
        y: wp.array3d(dtype=real),
        gradient_out: wp.array3d(dtype=real),
    ):
        """g = g + M (z - y) / tau^2."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d = load3(z, 0, i, j) - load3(y, 0, i, j)
        store3(gradient_out, 0, i, j, load3(gradient_out, 0, i, j) + scale(inertia[0] * load1(mass, 0, i, j), d))

    @wp.kernel(module=module)
    def work_of_loads(
        g: wp.array3d(dtype=real),
        z: wp.array3d(dtype=real),
        x: wp.array3d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        """Work that forces -g do over the step."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d = load3(x, 0, i, j) - load3(z, 0, i, j)
        partials_out[i, j] = partials_out[i, j] + sum_lanes(dot3(load3(g, 0, i, j), d))

    @wp.kernel(module=module)
    def work_of_pins(
        free: wp.array3d(dtype=real),
        g: wp.array3d(dtype=real),
        z: wp.array3d(dtype=real),
        x: wp.array3d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        """Work that the pins do over the step: their reaction is the unbalanced gradient g."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        held = splat(real(1.0)) - load1(free, 0, i, j)
        d = load3(z, 0, i, j) - load3(x, 0, i, j)
        partials_out[i, j] = partials_out[i, j] + sum_lanes(dot3(scale(held, load3(g, 0, i, j)), d))

    @wp.kernel(module=module)
    def accept(
        rate: wp.array(dtype=real),
        z: wp.array3d(dtype=real),
        w: wp.array3d(dtype=real),
        x_out: wp.array3d(dtype=real),
        v_out: wp.array3d(dtype=real),
    ):
        """Position and velocity at the end of a stage: x = z, v = (z - w)/tau."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        r = load3(z, 0, i, j)
        store3(x_out, 0, i, j, r)
        store3(v_out, 0, i, j, scale(splat(rate[0]), r - load3(w, 0, i, j)))

    @wp.kernel(module=module)
    def reflect(
        rate: wp.array(dtype=real),
        free: wp.array3d(dtype=real),
        z: wp.array3d(dtype=real),
        x_out: wp.array3d(dtype=real),
        v_out: wp.array3d(dtype=real),
    ):
        """The end of a step from its middle z: x' = 2 z - x, v' = 2 (z - x)/tau - v; pinned nodes go on straight."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        r, f = load3(z, 0, i, j), load1(free, 0, i, j)
        half = r - load3(x_out, 0, i, j)
        u = scale(splat(rate[0]), half)
        store3(x_out, 0, i, j, r + half)
        store3(v_out, 0, i, j, u + scale(f, u - load3(v_out, 0, i, j)))

    @wp.kernel(module=module)
    def remember(
        x: wp.array3d(dtype=real),
        v: wp.array3d(dtype=real),
        x_before_out: wp.array3d(dtype=real),
        v_before_out: wp.array3d(dtype=real),
    ):
        """The history moves on."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store3(x_before_out, 0, i, j, load3(x, 0, i, j))
        store3(v_before_out, 0, i, j, load3(v, 0, i, j))

    @wp.kernel(module=module)
    def accelerate(
        free: wp.array3d(dtype=real),
        inertia: wp.array(dtype=real),
        z: wp.array3d(dtype=real),
        y: wp.array3d(dtype=real),
        a_out: wp.array3d(dtype=real),
    ):
        """a = (z - y)/tau^2, which holds all forces; none at pins."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d = load3(z, 0, i, j) - load3(y, 0, i, j)
        store3(a_out, 0, i, j, scale(inertia[0] * load1(free, 0, i, j), d))

    @wp.kernel(module=module)
    def estimate(
        weights: wp.array2d(dtype=real),
        row: int,
        rate: wp.array(dtype=real),
        free: wp.array3d(dtype=real),
        v: wp.array3d(dtype=real),
        vector: wp.array3d(dtype=real),
        z: wp.array3d(dtype=real),
        w: wp.array3d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        """Largest magnitude of weights . (v, vector, (z - w)/tau) on the free nodes of each lane group."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        e = scale(splat(weights[row, 0]), load3(v, 0, i, j)) + scale(splat(weights[row, 1]), load3(vector, 0, i, j))
        e = e + scale(splat(weights[row, 2] * rate[0]), load3(z, 0, i, j) - load3(w, 0, i, j))
        e = scale(load1(free, 0, i, j), e)
        partials_out[i, j] = wp.float64(max_lanes(root(dot3(e, e))))

    return SimpleNamespace(
        module=module,
        combine=combine,
        place_pins=place_pins,
        place_pins_halfway=place_pins_halfway,
        difference=difference,
        displace=displace,
        clear_partials=clear_partials,
        add_inertial_energy=add_inertial_energy,
        inertial_gradient=inertial_gradient,
        work_of_loads=work_of_loads,
        work_of_pins=work_of_pins,
        accept=accept,
        reflect=reflect,
        remember=remember,
        accelerate=accelerate,
        estimate=estimate,
    )
