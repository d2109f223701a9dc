"""The field of the obstacles on one body: exponential potential, and friction with stick anchors.

Node by node, one thread each, with a loop over all obstacles inside. Design 5.1, per unit of node mass:

    phi(f)   = (V^2/2) exp(-f/eps),   below f = 0 continued by its quadratic (twice differentiable)
    friction = kt |u|^2 / 2 up to |u| = u0, then mu N (|u| - u0/2),   kt = mu N / u0
    u        = T (u_n + (z - x_n) seen from the obstacle),   T = 1 - n n',   n frozen at the start of the step

The force N that presses a node on an obstacle follows the first Newton iterations and is frozen then. With N and n
frozen, the gradient is the derivative of the energy, and the blocks that of the gradient without the terms that may be
negative (curvature of the surface under pressure, turning of the slip direction).
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.distance import distances
from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.potential import potentials

STICK = 1e-4
"""u0: how far an anchor stretches before it slides [m]."""

LOAD, NORMAL, ANCHOR, LAGGED = 0, 1, 4, 7
"""Lagged data of each node for each obstacle with friction: N [N], n and u_n [m] in the obstacle's frame; number of
components."""


@functools.cache
def fields(real: Any, with_mesh: bool, with_friction: bool) -> SimpleNamespace:
    """The kernels for one precision.

    Args:
        real: ``wp.float32`` or ``wp.float64``.
        with_mesh: Whether an obstacle is a mesh.
        with_friction: Whether an obstacle has friction.
    """
    words = lanes(1, real)
    V, S, outer, isotropic = words.V, words.S, words.outer, words.isotropic
    load1, load3, load6 = words.load1, words.load3, words.load6
    store1, store3, store6, add3, add6 = words.store1, words.store3, words.store6, words.add3, words.add6
    geometry = distances(real, with_mesh)
    Obstacle, Pose = geometry.Obstacle, geometry.Pose
    remembered_distance, remember_distance = geometry.remembered_distance, geometry.remember_distance
    exponential, wall = potentials(real).exponential, potentials(real).wall
    zero, one, half, stick = real(0.0), real(1.0), real(0.5), real(STICK)
    module = kernel_module("fields" + "_mesh" * with_mesh + "_friction" * with_friction, 1, real)

    @wp.func
    def density(o: Obstacle, f: real):
        """phi, phi', phi'' at a distance of the skins."""
        return exponential(o.strength, o.eps, f) + wall(o.strength, o.wall, f - o.inner)

    @wp.func
    def slip(o: Obstacle, pose: Pose, lagged: wp.array3d(dtype=real), i: int, j: int, z: V, x: V):
        """u = T (u_n + (z - x)_rel), x the position at the start of the step."""
        n = load3(lagged, o.lagged + NORMAL, i, j)
        u = load3(lagged, o.lagged + ANCHOR, i, j)
        u += wp.transpose(pose.rotation) * (z - x - pose.shift) + pose.turn * (x + pose.shift - pose.position)
        return u - wp.dot(u, n) * n

    @wp.kernel(module=module)
    def linearise_fields(
        halo: int,
        lagged_iterations: int,
        mass: wp.array3d(dtype=real),
        skin: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        start: wp.array3d(dtype=real),
        iteration: wp.array(dtype=wp.int32),
        obstacles: wp.array(dtype=Obstacle),
        poses: wp.array(dtype=Pose),
        lagged_out: wp.array3d(dtype=real),
        memory_out: wp.array3d(dtype=real),
        gradient_out: wp.array3d(dtype=real),
        block_out: wp.array3d(dtype=real),
    ):
        row, column = wp.tid()
        i = row + 1
        j = column + halo
        m, thick = load1(mass, 0, i, j), load1(skin, 0, i, j)
        if m == zero or thick < zero:
            return
        z = load3(position, 0, i, j)
        g = V()
        b = S()
        for k in range(obstacles.shape[0]):
            o = obstacles[k]
            pose = poses[k]
            p = wp.transpose(pose.rotation) * (z - pose.position)
            # Twice the cutoff, so that a node far from a mesh need not ask again as long as it moves little.
            d = remembered_distance(o, memory_out, i, j, p, real(2.0) * o.cutoff + thick)
            remember_distance(o, memory_out, i, j, p, d)
            d[3] = d[3] - thick
            press = zero
            if d[3] < o.cutoff:
                n = pose.rotation * V(d[0], d[1], d[2])
                phi = density(o, d[3])
                press = -m * phi[1]
                g -= press * n
                b += m * phi[2] * outer(n, n)
            if wp.static(with_friction):
                if o.lagged >= 0:
                    n = load3(lagged_out, o.lagged + NORMAL, i, j)
                    if iteration[0] < lagged_iterations:
                        store1(lagged_out, o.lagged + LOAD, i, j, press * wp.dot(n, n))  # none where n is not known
                    load = o.friction * load1(lagged_out, o.lagged + LOAD, i, j)
                    if load > zero:
                        n = pose.rotation * n
                        u = slip(o, pose, lagged_out, i, j, z, load3(start, 0, i, j))
                        slid = wp.length(u)
                        stiffness = load / wp.max(stick, slid)
                        g += stiffness * (pose.rotation * u)
                        b += stiffness * (isotropic(one) - outer(n, n))
                        if slid > stick:
                            # Slipping on meets no more friction; a hundredth is left, so that the block stays positive.
                            along = pose.rotation * (u / slid)
                            b -= real(0.99) * stiffness * outer(along, along)
        store3(gradient_out, 0, i, j, g)
        store6(block_out, 0, i, j, b)

    @wp.kernel(module=module)
    def add_field_gradient(halo: int, gradient: wp.array3d(dtype=real), gradient_out: wp.array3d(dtype=real)):
        row, column = wp.tid()
        add3(gradient_out, 0, row + 1, column + halo, load3(gradient, 0, row + 1, column + halo))

    @wp.kernel(module=module)
    def add_field_blocks(halo: int, block: wp.array3d(dtype=real), blocks_out: wp.array3d(dtype=real)):
        row, column = wp.tid()
        add6(blocks_out, 0, row + 1, column + halo, load6(block, 0, row + 1, column + halo))

    @wp.kernel(module=module)
    def add_field_energy(
        halo: int,
        mass: wp.array3d(dtype=real),
        skin: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        start: wp.array3d(dtype=real),
        obstacles: wp.array(dtype=Obstacle),
        poses: wp.array(dtype=Pose),
        lagged: wp.array3d(dtype=real),
        memory: wp.array3d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        row, column = wp.tid()
        i = row + 1
        j = column + halo
        m, thick = load1(mass, 0, i, j), load1(skin, 0, i, j)
        if m == zero or thick < zero:
            return
        z = load3(position, 0, i, j)
        e = wp.float64(0.0)
        for k in range(obstacles.shape[0]):
            o = obstacles[k]
            pose = poses[k]
            p = wp.transpose(pose.rotation) * (z - pose.position)
            f = remembered_distance(o, memory, i, j, p, o.cutoff + thick)[3] - thick
            if f < o.cutoff:
                e += wp.float64(m * density(o, f)[0])
            if wp.static(with_friction):
                if o.lagged >= 0:
                    load = o.friction * load1(lagged, o.lagged + LOAD, i, j)
                    if load > zero:
                        u = wp.length(slip(o, pose, lagged, i, j, z, load3(start, 0, i, j)))
                        inner = wp.min(u, stick)
                        e += wp.float64(load * (half * inner * inner / stick + u - inner))
        partials_out[i, j] = partials_out[i, j] + e

    kernels = SimpleNamespace(
        linearise_fields=linearise_fields,
        add_field_gradient=add_field_gradient,
        add_field_blocks=add_field_blocks,
        add_field_energy=add_field_energy,
    )
    if not with_friction:
        return kernels

    @wp.kernel(module=module)
    def begin_friction(
        halo: int,
        mass: wp.array3d(dtype=real),
        skin: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        obstacles: wp.array(dtype=Obstacle),
        poses: wp.array(dtype=Pose),
        memory: wp.array3d(dtype=real),
        start_out: wp.array3d(dtype=real),
        lagged_out: wp.array3d(dtype=real),
    ):
        """Freeze the normals at the start of the step, drop anchors beyond the cutoff, keep the positions for later."""
        row, column = wp.tid()
        i = row + 1
        j = column + halo
        if load1(mass, 0, i, j) == zero or load1(skin, 0, i, j) < zero:
            return
        x = load3(position, 0, i, j)
        store3(start_out, 0, i, j, x)
        for k in range(obstacles.shape[0]):
            o = obstacles[k]
            if o.lagged >= 0:
                pose = poses[k]
                p = (wp.transpose(pose.rotation) - pose.turn) * (x + pose.shift - pose.position)
                thick = load1(skin, 0, i, j)
                reach = real(1e30)  # an exact distance is known anywhere, and what lands in this step rubs in it
                if o.memory >= 0:
                    reach = real(2.0) * o.cutoff + thick
                d = remembered_distance(o, memory, i, j, p, reach)
                store3(lagged_out, o.lagged + NORMAL, i, j, V(d[0], d[1], d[2]))
                if d[3] - thick >= o.cutoff:
                    store3(lagged_out, o.lagged + ANCHOR, i, j, V())

    @wp.kernel(module=module)
    def finish_friction(
        halo: int,
        mass: wp.array3d(dtype=real),
        skin: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        start: wp.array3d(dtype=real),
        obstacles: wp.array(dtype=Obstacle),
        poses: wp.array(dtype=Pose),
        lagged_out: wp.array3d(dtype=real),
    ):
        """Store the anchors at the accepted position, stretched to u0 at most; the step's friction is over."""
        row, column = wp.tid()
        i = row + 1
        j = column + halo
        if load1(mass, 0, i, j) == zero or load1(skin, 0, i, j) < zero:
            return
        z = load3(position, 0, i, j)
        for k in range(obstacles.shape[0]):
            o = obstacles[k]
            if o.lagged >= 0:
                u = slip(o, poses[k], lagged_out, i, j, z, load3(start, 0, i, j))
                store3(lagged_out, o.lagged + ANCHOR, i, j, (stick / wp.max(stick, wp.length(u))) * u)
                store1(lagged_out, o.lagged + LOAD, i, j, zero)

    kernels.begin_friction, kernels.finish_friction = begin_friction, finish_friction
    return kernels
