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
the largest to the smallest; blocks that no such rectangle holds, but which are near in the grid, by the rectangle
between them. Points of blocks that are no neighbours are four cells apart, so they feel no force either, if what the
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
BLOCKS_BETWEEN = 3
"""Rows and columns that blocks are apart at most to be held against each other by the rectangle between them."""
BOUNDLESS = 1.0e15
"""Components of edges that no box is to be found for [m]."""


@functools.cache
def contact_lookout(width: int, real: Any) -> SimpleNamespace:
    """The kernels for one lane width and precision."""
    words = lanes(width, real)
    load1, load3, pick3, vector, spread = words.load1, words.load3, words.pick3, words.vector, words.spread
    min_lanes, max_lanes, least, most = words.min_lanes, words.max_lanes, words.least, words.most
    L, V, P, shape = words.L, words.V, lanes(1, real).V, box_words(real)
    Box, union, approach = shape.Box, shape.union, shape.approach
    Scene = contact_search(width, real).Scene
    groups = BLOCK // width
    zero, one, half, tiny, boundless = real(0.0), real(1.0), real(0.5), real(1e-30), real(BOUNDLESS)
    module = kernel_module("contact_lookout", width, real)

    @wp.func
    def lower(low: V, e: V, f: V, mask: L):
        """Least components of what was before and of edges that are not masked."""
        return vector(
            least(low[0], least(e[0], f[0]) + mask), least(low[1], least(e[1], f[1]) + mask),
            least(low[2], least(e[2], f[2]) + mask),
        )  # fmt: skip

    @wp.func
    def upper(high: V, e: V, f: V, mask: L):
        return vector(
            most(high[0], most(e[0], f[0]) - mask), most(high[1], most(e[1], f[1]) - mask),
            most(high[2], most(e[2], f[2]) - mask),
        )  # fmt: skip

    @wp.func
    def box_of(low: V, high: V):
        return Box(
            min_lanes(low[0]), min_lanes(low[1]), min_lanes(low[2]),
            max_lanes(high[0]), max_lanes(high[1]), max_lanes(high[2]),
        )  # fmt: skip

    @wp.kernel(module=module)
    def box_edges(
        blocks: int,
        ends: wp.array2d(dtype=wp.int32),
        masks: wp.array3d(dtype=real),
        points: wp.array3d(dtype=real),
        directions: wp.array3d(dtype=real),
        flat_points: wp.array3d(dtype=real),
        flat_directions: wp.array3d(dtype=real),
        all_out: wp.array(dtype=Box),
        first_out: wp.array(dtype=Box),
    ):
        """Boxes around the edges that begin at the nodes of each block, at the start of the way and at its end.

        Args:
            blocks: How many there are.
            ends: Slot at the end of the edge of each slot, those along u, then those along v, shape (2 blocks, 16).
            masks: 0 for edges, `BOUNDLESS` for slots without one, -`BOUNDLESS` for any length, of edges along u, of
                those along v; then only of those along u in the first column, along v in the first row, shape
                (4, blocks, 16).
            points: Positions in slots [m].
            directions: Displacements in slots [m].
            flat_points, flat_directions: The same in one row.
            all_out: Boxes along u, then those along v; of blocks without edges their low ends lie above the high ones.
            first_out: The same of the first column and row.
        """
        b, axis = wp.tid()
        row = axis * blocks + b
        low, high = spread(P(boundless, boundless, boundless)), spread(P(-boundless, -boundless, -boundless))
        first_low, first_high = low, high
        for g in range(groups):
            j = g * width
            mask, first = load1(masks, axis, b, j), load1(masks, 2 + axis, b, j)
            e = pick3(flat_points, 0, 0, ends, row, j) - load3(points, 0, b, j)
            f = e + (pick3(flat_directions, 0, 0, ends, row, j) - load3(directions, 0, b, j))
            low, high = lower(low, e, f, mask), upper(high, e, f, mask)
            first_low, first_high = lower(first_low, e, f, first), upper(first_high, e, f, first)
        all_out[row] = box_of(low, high)
        first_out[row] = box_of(first_low, first_high)

    @wp.kernel(module=module)
    def close_rectangles(
        tables: Tables,
        joined: wp.array2d(dtype=wp.int32),
        boxes: wp.array(dtype=Box),
        first: wp.array(dtype=Box),
        along_u_out: wp.array(dtype=Box),
        along_v_out: wp.array(dtype=Box),
    ):
        """Boxes around the edges of each block's rectangle, up to where the next begin, into the leaves of the tree.

        Args:
            tables: The tables.
            joined: Entries of `boxes`, then of `first`, that belong to each block along u, the same along v, shape
                (4, blocks).
            boxes, first: Of `box_edges`.
            along_u_out, along_v_out: Boxes of the tree.
        """
        b = wp.tid()
        along_u_out[tables.leaf_box[b]] = union(boxes[joined[0, b]], first[joined[1, b]])
        along_v_out[tables.leaf_box[b]] = union(boxes[joined[2, b]], first[joined[3, b]])

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
    def is_smooth_between(
        tables: Tables,
        tiles: wp.array3d(dtype=wp.int32),
        along_u: wp.array(dtype=Box),
        along_v: wp.array(dtype=Box),
        a: int,
        b: int,
        reach: real,
    ):
        """Whether blocks lie near each other in a rectangle of blocks that nowhere meets itself."""
        p, q = tables.place[a], tables.place[b]
        rows, columns = wp.abs(p[1] - q[1]), wp.abs(p[2] - q[2])
        smooth = p[0] == q[0] and rows <= BLOCKS_BETWEEN and columns <= BLOCKS_BETWEEN
        if smooth:
            u, v = Box(along_u[tables.leaf_box[a]]), Box(along_v[tables.leaf_box[a]])
            for i in range(wp.min(p[1], q[1]), wp.min(p[1], q[1]) + rows + 1):
                for j in range(wp.min(p[2], q[2]), wp.min(p[2], q[2]) + columns + 1):
                    other = tiles[p[0], i, j]
                    smooth = smooth and other >= 0
                    if smooth:
                        k = tables.leaf_box[other]
                        u = union(u, along_u[k])
                        v = union(v, along_v[k])
            smooth = smooth and is_smooth(u, v, wp.where(wp.max(rows, columns) > 1, reach, zero))
        return smooth

    @wp.kernel(module=module)
    def look_around(
        tables: Tables,
        scene: Scene,
        drifts: wp.array(dtype=Box),
        tiles: wp.array3d(dtype=wp.int32),
        along_u: wp.array(dtype=Box),
        along_v: wp.array(dtype=Box),
        near_out: wp.array(dtype=wp.int32),
    ):
        """Whether anything of a block may come near anything; nothing is looked at once something has been found.

        Args:
            tables: The tables.
            scene: What the search reads; only boxes and reaches are read.
            drifts: Boxes of the tree around displacements [m].
            tiles: Block at each place, -1 for none, shape (patches, rows, columns).
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
                passed = is_smooth_between(tables, tiles, along_u, along_v, b, tables.leaf[k], reach)
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
