"""Whether anything can come near on the way: what spares search and guard where nothing touches (design 5.2).

Boxes tell blocks that are apart from each other, but a sheet is everywhere close to itself. That it does not meet
itself there follows from its edges. In a rectangle of nodes let the edges along u lie in a box around c1 with the half
diagonal r1, those along v in one around c2 with r2. The line between two points a and b of the rectangle, s and t cells
apart, stays in it, and every triangle that it goes through has an edge of either kind, so that

    |x(a) - x(b)|  >=  |s c1 + t c2| - r1 |s| - r2 |t|  >=  m sqrt(|c1|^2 s^2 + |c2|^2 t^2),
    m = sqrt(1 - |cos(c1, c2)|) - sqrt((r1 / |c1|)^2 + (r2 / |c2|)^2).

With m > 0 the rectangle nowhere meets itself. On a straight way edges stay in the box around what they are at its start
and at its end, so this holds all the way. It is exact for triangles, and says nothing of the rest shape.

Rectangles with m of at least `MARGIN`, whose normals then lie within 45 degrees of one direction, are passed over, from
the largest to the smallest; neighbouring blocks that no such rectangle holds, by the rectangle of the four around their
common corner. Points of blocks that are no neighbours are four cells apart, so they feel no force either, if what the
bound says of four cells is beyond its reach; neighbours that are so smooth feel none in a search
(:mod:`warpdeform.kernels.contact_search`).
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.boxes import BLOCK, Tables, box_words
from warpdeform.kernels.contact_search import contact_search
from warpdeform.kernels.lanes import kernel_module, lanes

MARGIN = 0.3
"""Least m of rectangles that are passed over."""
CELLS_BETWEEN = 4
"""Cells between points of blocks that are no neighbours."""
BOUNDLESS = 1.0e15
"""Components of edges that no box is to be found for [m]."""


@functools.cache
def contact_lookout(width: int, real: Any) -> SimpleNamespace:
    """The kernels for one lane width and precision."""
    words = lanes(width, real)
    load1, load3, pick3, vector, spread = words.load1, words.load3, words.pick3, words.vector, words.spread
    min_lanes, max_lanes, least, most = words.min_lanes, words.max_lanes, words.least, words.most
    P, shape = lanes(1, real).V, box_words(real)
    Box, union, approach = shape.Box, shape.union, shape.approach
    Scene = contact_search(width, real).Scene
    groups = BLOCK // width
    zero, one, half, tiny, boundless = real(0.0), real(1.0), real(0.5), real(1e-30), real(BOUNDLESS)
    module = kernel_module("contact_lookout", width, real)

    @wp.kernel(module=module)
    def box_edges(
        blocks: int,
        ends: wp.array2d(dtype=wp.int32),
        masks: wp.array3d(dtype=real),
        points: wp.array3d(dtype=real),
        directions: wp.array3d(dtype=real),
        flat_points: wp.array3d(dtype=real),
        flat_directions: wp.array3d(dtype=real),
        boxes_out: wp.array(dtype=Box),
    ):
        """Boxes around the edges that begin at the nodes of each block, at the start of the way and at its end.

        Args:
            blocks: How many there are.
            ends: Slot at the end of the edge of each slot, those along u, then those along v, shape (2 blocks, 16).
            masks: 0 for edges, `BOUNDLESS` for slots without one, -`BOUNDLESS` for any length, shape (2, blocks, 16).
            points: Positions in slots [m].
            directions: Displacements in slots [m].
            flat_points, flat_directions: The same in one row.
            boxes_out: Boxes along u, then those along v.
        """
        b, axis = wp.tid()
        low, high = spread(P(boundless, boundless, boundless)), spread(P(-boundless, -boundless, -boundless))
        for g in range(groups):
            j = g * width
            mask = load1(masks, axis, b, j)
            e = pick3(flat_points, 0, 0, ends, axis * blocks + b, j) - load3(points, 0, b, j)
            f = e + (pick3(flat_directions, 0, 0, ends, axis * blocks + b, j) - load3(directions, 0, b, j))
            low = vector(
                least(low[0], least(e[0], f[0]) + mask), least(low[1], least(e[1], f[1]) + mask),
                least(low[2], least(e[2], f[2]) + mask),
            )  # fmt: skip
            high = vector(
                most(high[0], most(e[0], f[0]) - mask), most(high[1], most(e[1], f[1]) - mask),
                most(high[2], most(e[2], f[2]) - mask),
            )  # fmt: skip
        boxes_out[axis * blocks + b] = Box(
            min_lanes(low[0]), min_lanes(low[1]), min_lanes(low[2]),
            max_lanes(high[0]), max_lanes(high[1]), max_lanes(high[2]),
        )  # fmt: skip

    @wp.kernel(module=module)
    def close_rectangles(
        blocks: int,
        tables: Tables,
        joined: wp.array2d(dtype=wp.int32),
        boxes: wp.array(dtype=Box),
        along_u_out: wp.array(dtype=Box),
        along_v_out: wp.array(dtype=Box),
    ):
        """Boxes around the edges of each block's rectangle, up to where the next begin, into the leaves of the tree."""
        b = wp.tid()
        first, second = joined[0, b], joined[1, b]
        u = union(union(boxes[b], boxes[first]), boxes[second])
        v = union(union(boxes[blocks + b], boxes[blocks + first]), boxes[blocks + second])
        along_u_out[tables.leaf_box[b]] = u
        along_v_out[tables.leaf_box[b]] = v

    @wp.func
    def is_smooth(u: Box, v: Box, reach: real):
        """Whether a rectangle meets itself nowhere, and points `CELLS_BETWEEN` cells apart are beyond the reach."""
        c, d = half * P(u[0] + u[3], u[1] + u[4], u[2] + u[5]), half * P(v[0] + v[3], v[1] + v[4], v[2] + v[5])
        r, q = half * P(u[3] - u[0], u[4] - u[1], u[5] - u[2]), half * P(v[3] - v[0], v[4] - v[1], v[5] - v[2])
        first, second = wp.max(wp.length(c), tiny), wp.max(wp.length(d), tiny)
        r, q = r / first, q / second
        cosine = wp.abs(wp.dot(c / first, d / second))
        m = wp.sqrt(wp.max(one - cosine, zero)) - wp.sqrt(wp.dot(r, r) + wp.dot(q, q))
        return m >= real(MARGIN) and real(CELLS_BETWEEN) * m * wp.min(first, second) >= reach

    @wp.func
    def is_smooth_around(
        tables: Tables,
        around: wp.array2d(dtype=wp.int32),
        along_u: wp.array(dtype=Box),
        along_v: wp.array(dtype=Box),
        a: int,
        b: int,
    ):
        """Whether blocks are neighbours, in a rectangle of four that nowhere meets itself."""
        way = tables.place[b] - tables.place[a]
        smooth = way[0] == 0 and wp.abs(way[1]) <= 1 and wp.abs(way[2]) <= 1
        if smooth:
            beside, below = around[3 * (way[1] + 1) + 1, a], around[3 + way[2] + 1, a]
            smooth = beside >= 0 and below >= 0
            if smooth:
                i, j = tables.leaf_box[a], tables.leaf_box[b]
                k, n = tables.leaf_box[beside], tables.leaf_box[below]
                u = union(union(along_u[i], along_u[j]), union(along_u[k], along_u[n]))
                v = union(union(along_v[i], along_v[j]), union(along_v[k], along_v[n]))
                smooth = is_smooth(u, v, zero)
        return smooth

    @wp.kernel(module=module)
    def look_around(
        tables: Tables,
        scene: Scene,
        drifts: wp.array(dtype=Box),
        around: wp.array2d(dtype=wp.int32),
        along_u: wp.array(dtype=Box),
        along_v: wp.array(dtype=Box),
        near_out: wp.array(dtype=wp.int32),
    ):
        """Whether anything of a block may come near anything; nothing is looked at once something has been found.

        Args:
            tables: The tables.
            scene: What the search reads; only boxes and reaches are read.
            drifts: Boxes of the tree around displacements [m].
            around: Blocks around each, by rows, -1 for none, shape (9, blocks).
            along_u, along_v: Boxes of the tree around edges, at the start of the way and at its end [m].
            near_out: Set to 1 if so, shape (1,).
        """
        b = wp.tid()
        own = tables.leaf_box[b]
        box, drift = scene.boxes[own], drifts[own]
        first_reach = tables.body[b] * tables.bodies
        largest = scene.largest_floor
        for k in range(tables.bodies):
            largest = wp.max(largest, scene.reaches[first_reach + k])
        size = tables.skip.shape[0]
        k = wp.int32(0)
        if near_out[0] != 0:
            k = size
        while k < size:
            body = tables.tree_body[k]
            reach = largest
            if body >= 0:
                reach = wp.max(scene.reaches[first_reach + body], scene.floors[first_reach + body])
            # Both, or neither, are negative for bodies that do not feel each other.
            passed = reach < zero or approach(box, scene.boxes[k], drift, drifts[k]) > reach
            if not passed and body >= 0 and k <= own and own < tables.skip[k]:
                passed = is_smooth(along_u[k], along_v[k], reach)
            if not passed and tables.leaf[k] >= 0:
                passed = is_smooth_around(tables, around, along_u, along_v, b, tables.leaf[k])
                if not passed:
                    near_out[0] = 1
                    k = size
            if k < size:
                if passed:
                    k = tables.skip[k]
                else:
                    k += 1

    return SimpleNamespace(
        module=module,
        box_edges=box_edges,
        close_rectangles=close_rectangles,
        look_around=look_around,
    )
