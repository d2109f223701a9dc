"""Signed distances of obstacles with their gradients, in the obstacle's own frame; positive outside.

Every distance is exact outside and inside, so its gradient has length one. A distance function takes the sizes and a
point and returns (n_x, n_y, n_z, f): the outward unit normal grad f and the distance f. `KINDS` is the table.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import lanes

KINDS = ("plane", "sphere", "box", "capsule", "cylinder", "cone", "torus", "mesh")
"""Kinds of obstacles; the place in this table is the code by which kernels know them."""

CONVEX = frozenset(("plane", "sphere", "box", "capsule", "cylinder", "cone"))
"""Kinds whose outside lies beyond the plane through the nearest point, so that a step needs one look only."""

POINT, OUTWARD, DISTANCE, MEMORY = 0, 3, 6, 7
"""Memory of each node for each mesh: the point of the last query [m], n and f found there; number of components."""


@functools.cache
def distances(real: Any, with_mesh: bool) -> SimpleNamespace:
    """The structs `Obstacle` and `Pose` and the distance functions for one precision.

    Args:
        real: ``wp.float32`` or ``wp.float64``.
        with_mesh: Whether meshes are among the obstacles; their queries are compiled only then.
    """
    words = lanes(1, real)
    V, load1, load3, store1, store3 = words.V, words.load1, words.load3, words.store1, words.store3
    F, M = wp.types.vector(4, real), wp.types.matrix((3, 3), real)
    zero, one = real(0.0), real(1.0)

    @wp.struct
    class Obstacle:
        kind: wp.int32
        size: V
        half_thickness: real
        bound: real  # radius of a ball about its origin that holds it [m]; a plane has none
        mesh: wp.uint64
        strength: real  # V^2 / 2 of the field [m2/s2]
        eps: real
        cutoff: real
        gap: real  # distance at rest [m]
        inner: real  # distance towards which the wall grows without bound [m]
        wall: real  # thickness of the wall outside of it [m], 0 for none
        floor: real  # approach that the guard allows to a node that is inside [m]
        friction: real
        lagged: wp.int32  # first component of its lagged friction data, -1 without friction
        memory: wp.int32  # first component of its memory, -1 unless it is a mesh

    @wp.struct
    class Pose:
        position: V  # at the end of the stage
        rotation: M
        shift: V  # translation since the start of the step
        turn: M  # inverse rotation now less that at the start of the step
        spin: V  # rotation since the start of the step, axis times angle

    @wp.func
    def away(d: V, otherwise: V):
        """Direction and length of d; `otherwise` where d is zero."""
        f = wp.length(d)
        n = otherwise
        if f > zero:
            n = d / f
        return F(n[0], n[1], n[2], f)

    @wp.func
    def around(p: V, radial: real, axial: real, f: real):
        """Turn a gradient in the half plane (rho, z) into space."""
        rho = wp.sqrt(p[0] * p[0] + p[1] * p[1])
        c, s = one, zero
        if rho > zero:
            c = p[0] / rho
            s = p[1] / rho
        return F(radial * c, radial * s, axial, f)

    @wp.func
    def plane(o: Obstacle, p: V):
        return F(zero, zero, one, p[2])

    @wp.func
    def sphere(o: Obstacle, p: V):
        d = away(p, V(zero, zero, one))
        return F(d[0], d[1], d[2], d[3] - o.size[0])

    @wp.func
    def box(o: Obstacle, p: V):
        q = V(wp.abs(p[0]) - o.size[0], wp.abs(p[1]) - o.size[1], wp.abs(p[2]) - o.size[2])
        axis = 0
        if q[1] > q[0]:
            axis = 1
        if q[2] > q[axis]:
            axis = 2
        f = q[axis]
        n = V()
        n[axis] = one
        if f > zero:
            d = away(V(wp.max(q[0], zero), wp.max(q[1], zero), wp.max(q[2], zero)), n)
            n = V(d[0], d[1], d[2])
            f = d[3]
        for k in range(3):
            if p[k] < zero:
                n[k] = -n[k]
        return F(n[0], n[1], n[2], f)

    @wp.func
    def capsule(o: Obstacle, p: V):
        d = away(V(p[0], p[1], p[2] - wp.clamp(p[2], -o.size[1], o.size[1])), V(one, zero, zero))
        return F(d[0], d[1], d[2], d[3] - o.size[0])

    @wp.func
    def cylinder(o: Obstacle, p: V):
        side = wp.sqrt(p[0] * p[0] + p[1] * p[1]) - o.size[0]
        end = wp.abs(p[2]) - o.size[1]
        a, b, f = zero, one, end
        if side > zero and end > zero:
            f = wp.sqrt(side * side + end * end)
            a = side / f
            b = end / f
        elif side > end:
            a, b, f = one, zero, side
        if p[2] < zero:
            b = -b
        return around(p, a, b, f)

    @wp.func
    def cone(o: Obstacle, p: V):
        rho = wp.sqrt(p[0] * p[0] + p[1] * p[1])
        slant = wp.sqrt(o.size[0] * o.size[0] + real(4.0) * o.size[1] * o.size[1])
        a, b = real(2.0) * o.size[1] / slant, o.size[0] / slant  # outward normal of the side
        side = a * rho + b * (p[2] - o.size[1])
        along = (b * rho - a * (p[2] - o.size[1])) / slant  # 0 at the tip, 1 at the rim
        base = -o.size[1] - p[2]
        f = side
        if side <= zero and base <= zero:
            if base > side:
                a, b, f = zero, -one, base
        else:
            x, y = rho, p[2] - o.size[1]  # from the tip
            inner = base > zero and rho <= o.size[0]
            if along > zero:
                x, y = rho - o.size[0], -base
            if inner:
                a, b, f = zero, -one, base
            elif along <= zero or along >= one:
                f = wp.sqrt(x * x + y * y)
                if f > zero:
                    a = x / f
                    b = y / f
        return around(p, a, b, f)

    @wp.func
    def torus(o: Obstacle, p: V):
        q = wp.sqrt(p[0] * p[0] + p[1] * p[1]) - o.size[0]
        f = wp.sqrt(q * q + p[2] * p[2])
        a, b = one, zero
        if f > zero:
            a = q / f
            b = p[2] / f
        return around(p, a, b, f - o.size[1])

    @wp.func
    def corner(mesh: wp.uint64, face: int, k: int):
        q = wp.mesh_get_point(mesh, 3 * face + k)
        return V(real(q[0]), real(q[1]), real(q[2]))

    @wp.func
    def from_edge(p: V, a: V, b: V):
        """From the nearest point of the edge a b to p."""
        e = b - a
        t = wp.clamp(wp.dot(p - a, e) / wp.dot(e, e), zero, one)
        return (p - a) - t * e

    @wp.func
    def nearer(d: V, e: V):
        r = d
        if wp.dot(e, e) < wp.dot(d, d):
            r = e
        return r

    @wp.func
    def mesh(o: Obstacle, p: V, reach: real, known_side: real):
        """Over the inside of a triangle of a closed mesh its normal says on which side p lies; over edges and corners
        the winding number does. A thin shell has no inside: there n points to the side that p lies on.
        """
        d = F(zero, zero, zero, reach)
        q = wp.vec3(wp.float32(p[0]), wp.float32(p[1]), wp.float32(p[2]))
        limit = wp.float32(reach + o.half_thickness)
        nearest = wp.mesh_query_point_no_sign(o.mesh, q, limit)
        if nearest.result:
            a = corner(o.mesh, nearest.face, 0)
            b = corner(o.mesh, nearest.face, 1)
            c = corner(o.mesh, nearest.face, 2)
            n = wp.normalize(wp.cross(b - a, c - a))
            h = wp.dot(p - a, n)
            side = one
            if h < zero:
                side = -one
            d = F(side * n[0], side * n[1], side * n[2], side * h)
            ab = wp.dot(wp.cross(b - a, p - a), n)
            bc = wp.dot(wp.cross(c - b, p - b), n)
            ca = wp.dot(wp.cross(a - c, p - c), n)
            if ab < zero or bc < zero or ca < zero:
                e = nearer(nearer(from_edge(p, a, b), from_edge(p, b, c)), from_edge(p, c, a))
                d = away(e, side * n)
                side = known_side
                if o.half_thickness == zero and side == zero:
                    winding = wp.mesh_query_point_sign_winding_number(o.mesh, q, wp.float32(2.0) * limit)
                    side = real(winding.sign)
            if o.half_thickness > zero:
                d[3] = d[3] - o.half_thickness
            elif side < zero:
                d = -d
        return d

    @wp.func(inline=False)  # one copy per module: halves the time to compile the mesh queries
    def signed_distance(o: Obstacle, p: V, reach: real, known_side: real):
        """The outward unit normal and the distance at p.

        Args:
            reach: Meshes are not searched any farther; they give (0, 0, 0, reach) where nothing is found.
            known_side: 1 outside, -1 inside, where this is known of a mesh; else 0.
        """
        d = F()
        # Written out: a loop over the table would need deferred static expressions, whose hash depends on what else the
        # process has compiled, so that a module would be compiled again in the next process.
        if o.kind == wp.static(KINDS.index("plane")):
            d = plane(o, p)
        elif o.kind == wp.static(KINDS.index("sphere")):
            d = sphere(o, p)
        elif o.kind == wp.static(KINDS.index("box")):
            d = box(o, p)
        elif o.kind == wp.static(KINDS.index("capsule")):
            d = capsule(o, p)
        elif o.kind == wp.static(KINDS.index("cylinder")):
            d = cylinder(o, p)
        elif o.kind == wp.static(KINDS.index("cone")):
            d = cone(o, p)
        elif o.kind == wp.static(KINDS.index("torus")):
            d = torus(o, p)
        if wp.static(with_mesh):
            if o.memory >= 0:
                d = mesh(o, p, reach, known_side)
        return d

    @wp.func
    def side_within(d: F, moved: real):
        """The side on which all points up to `moved` [m] from where d was measured lie; 0 if that is not sure."""
        side = zero
        if wp.abs(d[3]) > moved and d[0] * d[0] + d[1] * d[1] + d[2] * d[2] > zero:
            side = wp.sign(d[3])
        return side

    @wp.func
    def remembered_distance(o: Obstacle, memory: wp.array3d(dtype=real), i: int, j: int, p: V, reach: real):
        """`signed_distance`, with what the last query tells: all at its own point, the side near it, nothing near.

        What is sure to be farther than `reach` gives (0, 0, 0, reach), of any kind.
        """
        beyond = wp.length(p) - o.bound
        if o.kind == wp.static(KINDS.index("plane")):
            beyond = p[2]
        if beyond >= reach:
            return F(zero, zero, zero, reach)
        side = zero
        if wp.static(with_mesh):
            if o.memory >= 0:
                moved = wp.length(p - load3(memory, o.memory + POINT, i, j))
                n = load3(memory, o.memory + OUTWARD, i, j)
                d = F(n[0], n[1], n[2], load1(memory, o.memory + DISTANCE, i, j))
                if moved == zero and wp.dot(n, n) > zero:
                    return d
                if d[3] - moved >= reach:
                    return F(zero, zero, zero, reach)
                side = side_within(d, moved)
        return signed_distance(o, p, reach, side)

    @wp.func
    def remember_distance(o: Obstacle, memory: wp.array3d(dtype=real), i: int, j: int, p: V, d: F):
        if wp.static(with_mesh):
            if o.memory >= 0:
                store3(memory, o.memory + POINT, i, j, p)
                store3(memory, o.memory + OUTWARD, i, j, V(d[0], d[1], d[2]))
                store1(memory, o.memory + DISTANCE, i, j, d[3])

    return SimpleNamespace(
        Obstacle=Obstacle,
        Pose=Pose,
        V=V,
        F=F,
        signed_distance=signed_distance,
        side_within=side_within,
        remembered_distance=remembered_distance,
        remember_distance=remember_distance,
    )
