"""Boxes around blocks of nodes and what belongs to them, boxes around those, and cones around normals (design 5.2).

A block is 16 slots, one row of an array [3, blocks, 16]; what its slots, triangles and edges are is told in tables that
do not change (:mod:`warpdeform.forces.contact_mesh`). Triangles and edges stand in rows of 16 as well, each block's
from a row of its own on: number k is at [k // 16, k % 16]. The tree is in preorder: box k is followed by its first
child, and `skip[k]` is where a search goes on that has no interest in box k.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes

BLOCK = 16
"""Slots of a block, and things in a row."""
HALF_CONE = 1.047
"""Normals of smooth neighbours lie within a cone of this half angle, 60 degrees."""
ANY_WAY = 4.0
"""Half angle of a cone that holds every direction."""
FLAT = 0.15
"""Half angle of the normals of a block below which it has no sharp edge inside."""
SHARP = -0.87
"""Cosine between the triangles on both sides of an edge above which the edge is sharp: folded by 30 degrees."""


@wp.struct
class Tables:
    """What is constant of blocks, simplices and tree; told in :class:`~warpdeform.forces.contact_mesh.ContactMesh`."""

    bodies: wp.int32
    body: wp.array(dtype=wp.int32)
    place: wp.array(dtype=wp.vec3i)
    present: wp.array(dtype=wp.int32)
    triangle_a: wp.array2d(dtype=wp.int32)
    triangle_b: wp.array2d(dtype=wp.int32)
    triangle_c: wp.array2d(dtype=wp.int32)
    triangle_count: wp.array(dtype=wp.int32)
    triangle_row_start: wp.array(dtype=wp.int32)
    across_a: wp.array2d(dtype=wp.int32)
    across_b: wp.array2d(dtype=wp.int32)
    across_c: wp.array2d(dtype=wp.int32)
    edge_a: wp.array2d(dtype=wp.int32)
    edge_b: wp.array2d(dtype=wp.int32)
    edge_count: wp.array(dtype=wp.int32)
    edge_row_start: wp.array(dtype=wp.int32)
    wing_a: wp.array2d(dtype=wp.int32)
    wing_b: wp.array2d(dtype=wp.int32)
    ring: wp.array(dtype=wp.int32)
    ring_start: wp.array(dtype=wp.int32)
    owner: wp.array(dtype=wp.int32)
    border: wp.array(dtype=wp.int32)
    border_start: wp.array(dtype=wp.int32)
    skip: wp.array(dtype=wp.int32)
    leaf: wp.array(dtype=wp.int32)
    tree_body: wp.array(dtype=wp.int32)
    leaf_box: wp.array(dtype=wp.int32)


@functools.cache
def box_words(real: Any) -> SimpleNamespace:
    """Device functions on boxes (low x, y, z, high x, y, z) and cones (axis, half angle), for one precision."""
    words = lanes(1, real)
    V = words.V
    Box, Cone = wp.types.vector(6, real), wp.types.vector(4, real)

    @wp.func
    def at_slot(points: wp.array3d(dtype=real), s: int):
        """The vector in slot s, or of number s in rows of 16."""
        return words.load3(points, 0, s >> 4, s & 15)

    @wp.func
    def grow(box: Box, p: V):
        return Box(
            wp.min(box[0], p[0]), wp.min(box[1], p[1]), wp.min(box[2], p[2]),
            wp.max(box[3], p[0]), wp.max(box[4], p[1]), wp.max(box[5], p[2]),
        )  # fmt: skip

    @wp.func
    def union(a: Box, b: Box):
        return Box(
            wp.min(a[0], b[0]), wp.min(a[1], b[1]), wp.min(a[2], b[2]),
            wp.max(a[3], b[3]), wp.max(a[4], b[4]), wp.max(a[5], b[5]),
        )  # fmt: skip

    @wp.func
    def between(a: Box, b: Box):
        """Distance of boxes along the axis where it is largest; negative where they overlap."""
        x = wp.max(a[0] - b[3], b[0] - a[3])
        y = wp.max(a[1] - b[4], b[1] - a[4])
        z = wp.max(a[2] - b[5], b[2] - a[5])
        return wp.max(x, wp.max(y, z))

    @wp.func
    def approach(a: Box, b: Box, drift_a: Box, drift_b: Box):
        """Least distance, along the axis where it is largest, of boxes whose contents move by drifts."""
        still = real(0.0)
        x = wp.max(
            a[0] + wp.min(drift_a[0] - drift_b[3], still) - b[3], b[0] - a[3] - wp.max(drift_a[3] - drift_b[0], still)
        )
        y = wp.max(
            a[1] + wp.min(drift_a[1] - drift_b[4], still) - b[4], b[1] - a[4] - wp.max(drift_a[4] - drift_b[1], still)
        )
        z = wp.max(
            a[2] + wp.min(drift_a[2] - drift_b[5], still) - b[5], b[2] - a[5] - wp.max(drift_a[5] - drift_b[2], still)
        )
        return wp.max(x, wp.max(y, z))

    @wp.func
    def box_at(boxes: wp.array3d(dtype=real), k: int):
        """Box number k of rows of 16."""
        low, high = words.load3(boxes, 0, k >> 4, k & 15), words.load3(boxes, 3, k >> 4, k & 15)
        return Box(low[0], low[1], low[2], high[0], high[1], high[2])

    @wp.func
    def smooth(tables: Tables, cones: wp.array(dtype=Cone), a: int, b: int):
        """Whether blocks are one or neighbours and their normals so alike that nothing there can touch."""
        away = tables.place[a] - tables.place[b]
        ok = away[0] == 0 and wp.abs(away[1]) <= 1 and wp.abs(away[2]) <= 1
        if ok:
            ca, cb = cones[a], cones[b]
            apart = V(ca[0] - cb[0], ca[1] - cb[1], ca[2] - cb[2])
            # Half the angle between unit vectors is at most pi/4 of their distance.
            ok = wp.max(ca[3], cb[3]) + real(0.7854) * wp.length(apart) <= real(HALF_CONE)
        return ok

    return SimpleNamespace(
        Box=Box, Cone=Cone, at_slot=at_slot, grow=grow, union=union, between=between, approach=approach,
        box_at=box_at, smooth=smooth,
    )  # fmt: skip


@functools.cache
def box_distances(width: int, real: Any) -> Any:
    """The device function that gives the distances of a group of boxes, by their corners, from one box."""
    words = lanes(width, real)
    V, most, splat = words.V, words.most, words.splat
    Box = box_words(real).Box

    @wp.func
    def distances(low: V, high: V, box: Box):
        """Along the axis where each is largest; negative where they overlap."""
        x = most(splat(box[0]) - high[0], low[0] - splat(box[3]))
        y = most(splat(box[1]) - high[1], low[1] - splat(box[4]))
        z = most(splat(box[2]) - high[2], low[2] - splat(box[5]))
        return most(x, most(y, z))

    return distances


@functools.cache
def boxes(width: int, real: Any) -> SimpleNamespace:
    """The kernels for one lane width and precision; `width` divides 16."""
    words = lanes(width, real)
    load3, store1, store3, pick3, vector = words.load3, words.store1, words.store3, words.pick3, words.vector
    min_lanes, max_lanes, least, most = words.min_lanes, words.max_lanes, words.least, words.most
    scale, dot3, cross3, root, div, splat = words.scale, words.dot3, words.cross3, words.root, words.div, words.splat
    at_least, where1, spread = words.at_least, words.where1, words.spread
    V, P = words.V, lanes(1, real).V
    shape = box_words(real)
    Box, Cone, at_slot, grow, union = shape.Box, shape.Cone, shape.at_slot, shape.grow, shape.union
    groups = BLOCK // width
    zero, one, tiny = real(0.0), real(1.0), real(1e-30)
    module = kernel_module("boxes", width, real)

    @wp.func
    def lower(a: V, b: V):
        return vector(least(a[0], b[0]), least(a[1], b[1]), least(a[2], b[2]))

    @wp.func
    def upper(a: V, b: V):
        return vector(most(a[0], b[0]), most(a[1], b[1]), most(a[2], b[2]))

    @wp.kernel(module=module)
    def gather(
        first_block: int,
        nodes: wp.array2d(dtype=wp.int32),
        a: wp.array3d(dtype=real),
        slots_out: wp.array3d(dtype=real),
    ):
        """Vectors of a body's nodes, shape (3, 1, places), into the slots of its blocks."""
        block, group = wp.tid()
        b, j = first_block + block, group * width
        store3(slots_out, 0, b, j, pick3(a, 0, 0, nodes, b, j))

    @wp.kernel(module=module)
    def fit_leaves(tables: Tables, points: wp.array3d(dtype=real), boxes_out: wp.array(dtype=Box)):
        """Boxes around the slots of every block and what its simplices reach of others."""
        b = wp.tid()
        low = load3(points, 0, b, 0)
        high = low
        for g in range(1, groups):
            p = load3(points, 0, b, g * width)
            low, high = lower(low, p), upper(high, p)
        box = Box(
            min_lanes(low[0]), min_lanes(low[1]), min_lanes(low[2]),
            max_lanes(high[0]), max_lanes(high[1]), max_lanes(high[2]),
        )  # fmt: skip
        for k in range(tables.border_start[b], tables.border_start[b + 1]):
            box = grow(box, at_slot(points, tables.border[k]))
        boxes_out[tables.leaf_box[b]] = box

    @wp.kernel(module=module)
    def fit_level(tables: Tables, level: wp.array(dtype=wp.int32), boxes_out: wp.array(dtype=Box)):
        """Boxes of one level of the tree around their children."""
        k = level[wp.tid()]
        child = k + 1
        box = boxes_out[child]
        child = tables.skip[child]
        while child < tables.skip[k]:
            box = union(box, boxes_out[child])
            child = tables.skip[child]
        boxes_out[k] = box

    @wp.func
    def wing_side(points: wp.array3d(dtype=real), a: V, d: V, wings: wp.array2d(dtype=wp.int32), row: int, j: int):
        """Unit vectors from a group of edges (a, along d) into the triangles with those wings."""
        q = pick3(points, 0, 0, wings, row, j) - a
        q = q - scale(div(dot3(q, d), at_least(dot3(d, d), tiny)), d)
        return scale(div(splat(one), root(at_least(dot3(q, q), tiny))), q)

    @wp.func
    def cone_of(low: V, high: V):
        """A cone that holds unit vectors whose components lie between bounds."""
        bx, by, bz = min_lanes(low[0]), min_lanes(low[1]), min_lanes(low[2])
        tx, ty, tz = max_lanes(high[0]), max_lanes(high[1]), max_lanes(high[2])
        middle = real(0.5) * P(bx + tx, by + ty, bz + tz)
        spread, length = real(0.5) * wp.length(P(tx - bx, ty - by, tz - bz)), wp.length(middle)
        cone = Cone(zero, zero, zero, real(ANY_WAY))
        if spread < length:
            cone = Cone(middle[0] / length, middle[1] / length, middle[2] / length, wp.asin(spread / length))
        return cone

    @wp.kernel(module=module)
    def fit_simplices(
        tables: Tables,
        flat: wp.array3d(dtype=real),
        border: wp.array3d(dtype=real),
        cones_out: wp.array(dtype=Cone),
        triangle_boxes_out: wp.array3d(dtype=real),
        edge_boxes_out: wp.array3d(dtype=real),
        sharp_out: wp.array3d(dtype=real),
    ):
        """Cones of blocks, boxes around triangles and edges, (6, rows, 16), and which edges are sharp, (1, rows, 16).

        Args:
            tables: The tables.
            flat: The slots, shape (3, 1, 16 blocks).
            border: 1 at edges that do not have a triangle on either side, which are sharp, shape (1, rows, 16).
            cones_out: Axis and half angle; blocks without triangles, or with one of no area, get every direction.
            triangle_boxes_out: Boxes.
            edge_boxes_out: Boxes.
            sharp_out: 1 at sharp edges, 0 at others.
        """
        b = wp.tid()
        least_normal, most_normal = spread(P(one, one, one)), spread(P(-one, -one, -one))
        for row in range(tables.triangle_row_start[b], tables.triangle_row_start[b + 1]):
            for g in range(groups):
                j = g * width
                p, q = pick3(flat, 0, 0, tables.triangle_a, row, j), pick3(flat, 0, 0, tables.triangle_b, row, j)
                r = pick3(flat, 0, 0, tables.triangle_c, row, j)
                store3(triangle_boxes_out, 0, row, j, lower(lower(p, q), r))
                store3(triangle_boxes_out, 3, row, j, upper(upper(p, q), r))
                n = cross3(q - p, r - p)
                n = scale(div(splat(one), root(at_least(dot3(n, n), tiny))), n)
                least_normal, most_normal = lower(least_normal, n), upper(most_normal, n)
        cone = cone_of(least_normal, most_normal)
        cones_out[b] = cone
        for row in range(tables.edge_row_start[b], tables.edge_row_start[b + 1]):
            for g in range(groups):
                j = g * width
                p, q = pick3(flat, 0, 0, tables.edge_a, row, j), pick3(flat, 0, 0, tables.edge_b, row, j)
                store3(edge_boxes_out, 0, row, j, lower(p, q))
                store3(edge_boxes_out, 3, row, j, upper(p, q))
                sharp = words.load1(border, 0, row, j)
                if cone[3] > real(FLAT):
                    cosine = dot3(
                        wing_side(flat, p, q - p, tables.wing_a, row, j),
                        wing_side(flat, p, q - p, tables.wing_b, row, j),
                    )
                    sharp = most(sharp, where1(cosine - splat(real(SHARP)), splat(one), splat(zero)))
                store1(sharp_out, 0, row, j, sharp)

    return SimpleNamespace(
        module=module,
        gather=gather,
        fit_leaves=fit_leaves,
        fit_level=fit_level,
        fit_simplices=fit_simplices,
    )
