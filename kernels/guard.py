"""What forbids crossing: the guard cuts displacements towards obstacles, the carry moves nodes out of their way.

A finite potential cannot forbid crossing, these rules on displacements do, however badly Newton has converged
(design 5.1). A node may approach an obstacle by at most 0.9 of its distance per update, and never nearer than 0.15 of
the gap: however hard it is pressed, the guard carries what the field does not. Only the approaching component is cut.
All that lies beyond the plane through the nearest point of a convex obstacle is safe; near others the way is traced.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.distance import CONVEX, KINDS, distances
from warpdeform.kernels.lanes import kernel_module, lanes


@functools.cache
def guards(real: Any, with_mesh: bool) -> SimpleNamespace:
    """The kernels for one precision.

    Args:
        real: ``wp.float32`` or ``wp.float64``.
        with_mesh: Whether an obstacle is a mesh.
    """
    words = lanes(1, real)
    V, load1, load3, store3 = words.V, words.load1, words.load3, words.store3
    geometry = distances(real, with_mesh)
    Obstacle, Pose, F = geometry.Obstacle, geometry.Pose, geometry.F
    signed_distance, side_within = geometry.signed_distance, geometry.side_within
    remembered_distance = geometry.remembered_distance
    zero, one, near, nearest = real(0.0), real(1.0), real(0.9), real(0.15)
    hollow_codes = sum(1 << code for code, kind in enumerate(KINDS) if kind not in CONVEX)
    module = kernel_module("guard" + "_mesh" * with_mesh, 1, real)

    @wp.func
    def hollow(o: Obstacle):
        """Whether the obstacle is not convex."""
        return ((hollow_codes >> o.kind) & 1) == 1

    @wp.func
    def turned(pose: Pose, share: real, v: V):
        """The vector v in the obstacle's frame when a share of its motion in the step is done."""
        angle = wp.length(pose.spin)
        w = v
        if angle > zero:
            w = wp.quat_rotate(wp.quat_from_axis_angle(pose.spin / angle, (one - share) * angle), v)
        return wp.transpose(pose.rotation) * w

    @wp.func
    def seen(pose: Pose, share: real, x: V):
        """The point x in the obstacle's frame when a share of its motion in the step is done."""
        return turned(pose, share, x - pose.position + (one - share) * pose.shift)

    @wp.func
    def standing(pose: Pose):
        """The pose at the end of the stage, without the motion that led there."""
        still = Pose()
        still.position = pose.position
        still.rotation = pose.rotation
        return still

    @wp.func
    def free_share(o: Obstacle, pose: Pose, thick: real, x: V, d: V, stop: real):
        """How much of the way from x to x + d a node may go while the obstacle makes its motion (sphere tracing).

        Args:
            thick: Distance of the skin from the node [m].
            stop: Distance of the skins [m].

        It ends where the distance has fallen to `stop` and goes on falling, or when the steps are used up.
        """
        arm = wp.max(wp.length(x - pose.position + pose.shift), wp.length(x + d - pose.position))
        way = wp.length(d - pose.shift) + wp.length(pose.spin) * arm
        share = one
        if way > zero:
            share = zero
            side = zero
            for _ in range(256):
                p = seen(pose, share, x + share * d)
                f = signed_distance(o, p, way + stop + thick, side)
                apart = f[3] - thick
                step = apart - near * stop
                if apart <= stop:
                    drift = turned(pose, share, d - pose.shift) - wp.cross(wp.transpose(pose.rotation) * pose.spin, p)
                    if wp.dot(drift, V(f[0], f[1], f[2])) < zero:
                        return share
                    step = wp.max(wp.abs(apart), real(1e-4) * o.eps)
                side = side_within(f, step)
                share += step / way
                if share >= one:
                    return one
        return share

    @wp.func
    def approach(
        o: Obstacle, pose: Pose, memory: wp.array3d(dtype=real), thick: real, i: int, j: int, z: V, length: real
    ):
        """The outward normal at z and how far a node may go against it; no normal where `length` [m] does no harm."""
        p = wp.transpose(pose.rotation) * (z - pose.position)
        f = remembered_distance(o, memory, i, j, p, real(1.2) * length + nearest * o.gap + o.wall + thick)
        apart = f[3] - thick
        room = o.floor
        if apart > zero:
            room = wp.max(wp.min(near * apart, apart - nearest * o.gap), zero)
            if o.wall > zero:
                # Into the wall half the way at most: its potential must not rise too much in one update.
                edge = o.inner + o.wall
                inside = wp.max(wp.min(apart, edge) - nearest * o.gap, zero)
                room = wp.min(room, wp.max(apart - edge, zero) + real(0.5) * inside)
        result = F(zero, zero, zero, length)
        if length > room:
            n = pose.rotation * V(f[0], f[1], f[2])
            result = F(n[0], n[1], n[2], room)
        return result

    @wp.kernel(module=module)
    def guard_direction(
        halo: int,
        free: wp.array3d(dtype=real),
        skin: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        obstacles: wp.array(dtype=Obstacle),
        poses: wp.array(dtype=Pose),
        memory: wp.array3d(dtype=real),
        direction_out: wp.array3d(dtype=real),
    ):
        row, column = wp.tid()
        i = row + 1
        j = column + halo
        if load1(free, 0, i, j) == zero:
            return
        thick = wp.max(load1(skin, 0, i, j), zero)
        z = load3(position, 0, i, j)
        d = load3(direction_out, 0, i, j)
        length = wp.length(d)
        if length == zero:
            return
        # Sweeps 0 to 2 cut; sweep 3 scales what cutting left of the approach, and traces the way near hollow obstacles.
        sweep = wp.int32(0)
        while sweep < 4:
            limits = wp.int32(0)
            for k in range(obstacles.shape[0]):
                o = obstacles[k]
                pose = poses[k]
                a = approach(o, pose, memory, thick, i, j, z, length)
                n = V(a[0], a[1], a[2])
                if wp.dot(n, n) > zero:
                    limits += 1
                    allow = a[3]
                    toward = -wp.dot(d, n)
                    if sweep < 3:
                        d += wp.max(toward - allow, zero) * n
                    else:
                        if toward > allow + real(1e-6) * length:
                            d = (allow / toward) * d
                        if hollow(o):
                            stop = wp.max(allow / real(9.0), nearest * o.gap)  # where the rule above leaves it
                            d = free_share(o, standing(pose), thick, z, d, stop) * d
            if limits == 0:
                sweep = 4
            elif limits == 1 and sweep < 3:
                sweep = 3
            else:
                sweep += 1
        store3(direction_out, 0, i, j, d)

    @wp.kernel(module=module)
    def carry_nodes(
        halo: int,
        free: wp.array3d(dtype=real),
        skin: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        obstacles: wp.array(dtype=Obstacle),
        poses: wp.array(dtype=Pose),
        start_out: wp.array3d(dtype=real),
    ):
        """Trace each node's way from `position` to `start_out` seen from each obstacle; stop it at half of eps."""
        row, column = wp.tid()
        i = row + 1
        j = column + halo
        if load1(free, 0, i, j) == zero:
            return
        thick = wp.max(load1(skin, 0, i, j), zero)
        x = load3(position, 0, i, j)
        z = load3(start_out, 0, i, j)
        for _ in range(2):
            for k in range(obstacles.shape[0]):
                o = obstacles[k]
                pose = poses[k]
                share = free_share(o, pose, thick, x, z - x, real(0.5) * o.eps)
                if share < one:
                    z = pose.position + pose.rotation * seen(pose, share, x + share * (z - x))
        store3(start_out, 0, i, j, z)

    @wp.kernel(module=module)
    def foresee_impacts(
        halo: int,
        free: wp.array3d(dtype=real),
        skin: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        predicted: wp.array3d(dtype=real),
        obstacles: wp.array(dtype=Obstacle),
        poses: wp.array(dtype=Pose),
        memory: wp.array3d(dtype=real),
        impact_out: wp.array(dtype=wp.int32),
    ):
        """Set the flag if a node on its way to `predicted` comes into a field, and nearer by more than the gap.

        Obstacles are taken to go on as they did in the step before.
        """
        row, column = wp.tid()
        i = row + 1
        j = column + halo
        if load1(free, 0, i, j) == zero:
            return
        thick = wp.max(load1(skin, 0, i, j), zero)
        x = load3(position, 0, i, j)
        d = load3(predicted, 0, i, j) - x
        for k in range(obstacles.shape[0]):
            o = obstacles[k]
            pose = poses[k]
            way = d - pose.shift
            length = wp.length(way)
            if length > o.gap:
                p = wp.transpose(pose.rotation) * (x - pose.position)
                f = remembered_distance(o, memory, i, j, p, length + o.cutoff + thick)
                toward = -wp.dot(wp.transpose(pose.rotation) * way, V(f[0], f[1], f[2]))
                if f[3] - thick < length + o.cutoff and toward > o.gap:
                    if free_share(o, standing(pose), thick, x, way, o.cutoff) < one:
                        impact_out[0] = 1

    return SimpleNamespace(guard_direction=guard_direction, carry_nodes=carry_nodes, foresee_impacts=foresee_impacts)
