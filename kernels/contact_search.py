"""Which points and triangles, and which edges, are near enough for a force (design 5.2).

One thread per block, or several that share its points and edges, goes down the tree; everything of the block is held
against everything of the blocks that are near. A point counts against a triangle if it lies over its inside, or over an
edge or corner that all triangles there see as closest; edges count where both are sharp, both closest points are inside
and the way between them leaves the triangles on both sides, and always below a tenth of the gap. What is near each
other at rest counts only from 0.9 of that distance on.

Every thread writes what it finds into a row of its own, in the order in which it finds it: no atomic decides an order.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.boxes import BLOCK, Tables, box_distances, box_words
from warpdeform.kernels.contact_geometry import closest
from warpdeform.kernels.contact_law import contact_law
from warpdeform.kernels.lanes import kernel_module, lanes

HITS = 32
"""Blocks that a thread takes from the tree at a time."""
REST_SHARE = 0.9
"""Share of the distance at rest at which neighbours begin to feel each other."""
CLOSE = 0.1
"""Share of the gap below which edges always feel each other."""
LEAVES = -0.25
"""Largest cosine between the way from an edge and a triangle beside it that the way leaves."""


@functools.cache
def contact_search(width: int, real: Any) -> SimpleNamespace:
    """The kernel ``find_pairs`` for one lane width and precision."""
    words = lanes(width, real)
    V, load1, load3 = lanes(1, real).V, words.load1, words.load3
    below, first_lane = words.below, words.first_lane
    exact = closest(real)
    point_triangle, segment_segment = exact.point_triangle, exact.segment_segment
    shape, Law = box_words(real), contact_law(real)
    Box, Cone, at_slot, between, smooth = shape.Box, shape.Cone, shape.at_slot, shape.between, shape.smooth
    distances = box_distances(width, real)
    Hits = wp.types.vector(HITS, wp.int32)
    groups = BLOCK // width
    zero, one = real(0.0), real(1.0)
    module = kernel_module("contact_search", width, real)

    @wp.func
    def beside_edge(points: wp.array3d(dtype=real), p: V, a: int, b: int, c: int):
        """Whether the triangle (a, b, c) sees p beyond its edge (a, b)."""
        e, q = at_slot(points, b) - at_slot(points, a), at_slot(points, c) - at_slot(points, a)
        inward = q - (wp.dot(q, e) / wp.max(wp.dot(e, e), real(1e-30))) * e
        return wp.dot(p - at_slot(points, a), inward) <= zero

    @wp.func
    def corner(tables: Tables, t: int, k: int):
        """Slot of corner k, counted on from 2 to 0, of triangle t."""
        s = wp.int32(tables.triangle_a[t >> 4, t & 15])
        if k % 3 == 1:
            s = wp.int32(tables.triangle_b[t >> 4, t & 15])
        if k % 3 == 2:
            s = wp.int32(tables.triangle_c[t >> 4, t & 15])
        return s

    @wp.func
    def across(tables: Tables, t: int, k: int):
        """The triangle beyond the edge opposite corner k of triangle t."""
        other = wp.int32(tables.across_a[t >> 4, t & 15])
        if k == 1:
            other = wp.int32(tables.across_b[t >> 4, t & 15])
        if k == 2:
            other = wp.int32(tables.across_c[t >> 4, t & 15])
        return other

    @wp.func
    def seen_by_all(tables: Tables, points: wp.array3d(dtype=real), p: V, t: int, w: V):
        """Whether all triangles at the closest point of triangle t see it as closest, and t is the first of them."""
        corners, at, opposite = wp.int32(0), wp.int32(0), wp.int32(0)
        for k in range(3):
            if w[k] > zero:
                corners += 1
                at = k
            else:
                opposite = k
        ok = True
        if corners == 2:
            other = across(tables, t, opposite)
            if other >= 0:
                ok = t < other
                if ok:
                    a, b = corner(tables, t, opposite + 1), corner(tables, t, opposite + 2)
                    c = corner(tables, other, 0) + corner(tables, other, 1) + corner(tables, other, 2) - a - b
                    ok = beside_edge(points, p, a, b, c)
        if corners == 1:
            s = corner(tables, t, at)
            ok = tables.owner[s] == t
            if ok:
                x = at_slot(points, s)
                for n in range(tables.ring_start[s], tables.ring_start[s + 1]):
                    ok = ok and wp.dot(p - x, at_slot(points, tables.ring[n]) - x) <= zero
        return ok

    @wp.func
    def point_counts(
        tables: Tables,
        law: Law,
        points: wp.array3d(dtype=real),
        rest: wp.array3d(dtype=real),
        own: bool,
        s: int,
        t: int,
    ):
        """Whether the point in slot s and triangle t feel each other."""
        a, b, c = corner(tables, t, 0), corner(tables, t, 1), corner(tables, t, 2)
        if s == a or s == b or s == c:
            return False
        p = at_slot(points, s)
        r, w = point_triangle(p, at_slot(points, a), at_slot(points, b), at_slot(points, c))
        f = wp.length(r) - law.offset
        ok = f < law.cutoff and seen_by_all(tables, points, p, t, w)
        if ok and own:
            r, w = point_triangle(at_slot(rest, s), at_slot(rest, a), at_slot(rest, b), at_slot(rest, c))
            ok = f < real(REST_SHARE) * wp.length(r) - law.offset
        return ok

    @wp.func
    def leaves(points: wp.array3d(dtype=real), wing: int, x: V, way: V):
        """Whether the way from the point x of an edge leaves the triangle with that wing."""
        ok = True
        if wing >= 0:
            q = at_slot(points, wing) - x
            ok = wp.dot(q, way) <= real(LEAVES) * wp.length(q) * wp.length(way)
        return ok

    @wp.func
    def edges_count(
        tables: Tables,
        law: Law,
        points: wp.array3d(dtype=real),
        rest: wp.array3d(dtype=real),
        own: bool,
        e: int,
        g: int,
    ):
        """Whether edges e and g feel each other: 1 over the whole range, -1 only when very close, 0 not."""
        i, j, m, n = e >> 4, e & 15, g >> 4, g & 15
        p, q, a, b = tables.edge_a[i, j], tables.edge_b[i, j], tables.edge_a[m, n], tables.edge_b[m, n]
        if p == a or p == b or q == a or q == b:
            return 0
        xp, xq, xa, xb = at_slot(points, p), at_slot(points, q), at_slot(points, a), at_slot(points, b)
        r, s, t = segment_segment(xp, xq, xa, xb)
        f = wp.length(r) - law.offset
        kind = wp.int32(0)
        if f < law.cutoff and s > zero and s < one and t > zero and t < one:
            x, y = xp + s * (xq - xp), xa + t * (xb - xa)
            free = leaves(points, tables.wing_a[i, j], x, -r) and leaves(points, tables.wing_b[i, j], x, -r)
            if free and leaves(points, tables.wing_a[m, n], y, r) and leaves(points, tables.wing_b[m, n], y, r):
                kind = 1
        if kind == 0 and f < real(CLOSE) * law.gap:
            kind = -1
        if kind != 0 and own:
            r, s, t = segment_segment(at_slot(rest, p), at_slot(rest, q), at_slot(rest, a), at_slot(rest, b))
            if f >= real(REST_SHARE) * wp.length(r) - law.offset:
                kind = 0
        return kind

    @wp.struct
    class Scene:
        """What a search reads.

        Attributes:
            points: Positions in slots [m].
            rest: Rest positions in slots [m].
            boxes: Boxes of the tree.
            cones: Cones of the blocks.
            triangle_boxes, edge_boxes, sharp: Of :func:`warpdeform.kernels.boxes.boxes`.
            laws: What holds between bodies.
            reaches: Distance at which they begin to feel each other, negative for never [m].
            floors: Distance below which the guard lets nothing come nearer, negative for bodies that may cross [m].
            largest_floor: The largest of them.
        """

        points: wp.array3d(dtype=real)
        rest: wp.array3d(dtype=real)
        boxes: wp.array(dtype=Box)
        cones: wp.array(dtype=Cone)
        triangle_boxes: wp.array3d(dtype=real)
        edge_boxes: wp.array3d(dtype=real)
        sharp: wp.array3d(dtype=real)
        laws: wp.array(dtype=Law)
        reaches: wp.array(dtype=real)
        floors: wp.array(dtype=real)
        largest_floor: real

    @wp.func
    def match_points(
        tables: Tables, scene: Scene, b: int, leaf: int, part: int, parts: int,
        row: int, found: int, points_out: wp.array2d(dtype=wp.int32),
    ):  # fmt: skip
        """Points of block b against triangles of another; the number of pairs found so far."""
        law = scene.laws[tables.body[b] * tables.bodies + tables.body[leaf]]
        reach, own = law.cutoff + law.offset, tables.body[b] == tables.body[leaf]
        other_box = scene.boxes[tables.leaf_box[leaf]]
        count = wp.int32(found)
        for group in range(part, groups, parts):
            p = load3(scene.points, 0, b, group * width)
            near_block = below(distances(p, p, other_box), reach)
            while near_block != 0:
                slot = group * width + first_lane(near_block)
                near_block = near_block & (near_block - 1)
                if slot < tables.present[b]:
                    s = BLOCK * b + slot
                    x = at_slot(scene.points, s)
                    point_box = Box(x[0], x[1], x[2], x[0], x[1], x[2])
                    for i in range(tables.triangle_row_start[leaf], tables.triangle_row_start[leaf + 1]):
                        for g in range(groups):
                            low = load3(scene.triangle_boxes, 0, i, g * width)
                            high = load3(scene.triangle_boxes, 3, i, g * width)
                            near = below(distances(low, high, point_box), reach)
                            while near != 0:
                                j = g * width + first_lane(near)
                                near = near & (near - 1)
                                t = BLOCK * i + j
                                if j < tables.triangle_count[i]:
                                    if point_counts(tables, law, scene.points, scene.rest, own, s, t):
                                        if 2 * count < points_out.shape[1]:
                                            points_out[row, 2 * count] = s
                                            points_out[row, 2 * count + 1] = t
                                        count += 1
        return count

    @wp.func
    def match_edges(
        tables: Tables, scene: Scene, b: int, leaf: int, part: int, parts: int,
        row: int, found: int, edges_out: wp.array2d(dtype=wp.int32),
    ):  # fmt: skip
        """Edges of block b against later ones of another or the same; the number of pairs found so far."""
        law = scene.laws[tables.body[b] * tables.bodies + tables.body[leaf]]
        own, always = tables.body[b] == tables.body[leaf], real(CLOSE) * law.gap + law.offset
        reach, more = law.cutoff + law.offset, law.cutoff - real(CLOSE) * law.gap
        other_box = scene.boxes[tables.leaf_box[leaf]]
        count = wp.int32(found)
        first_row = tables.edge_row_start[b]
        for group in range(part, groups * (tables.edge_row_start[b + 1] - first_row), parts):
            edge_row, start = first_row + group // groups, (group % groups) * width
            low, high = load3(scene.edge_boxes, 0, edge_row, start), load3(scene.edge_boxes, 3, edge_row, start)
            near_block = below(distances(low, high, other_box), reach)
            while near_block != 0:
                k = start + first_lane(near_block)
                near_block = near_block & (near_block - 1)
                if k < tables.edge_count[edge_row]:
                    e = BLOCK * edge_row + k
                    edge_box = shape.box_at(scene.edge_boxes, e)
                    # Sharp edges feel sharp edges from afar.
                    far = more * scene.sharp[0, edge_row, k]
                    for i in range(tables.edge_row_start[leaf], tables.edge_row_start[leaf + 1]):
                        for g in range(groups):
                            j = g * width
                            near_by = distances(
                                load3(scene.edge_boxes, 0, i, j), load3(scene.edge_boxes, 3, i, j), edge_box
                            )
                            near = below(near_by - far * load1(scene.sharp, 0, i, j), always)
                            while near != 0:
                                m = j + first_lane(near)
                                near = near & (near - 1)
                                other = BLOCK * i + m
                                if e < other and m < tables.edge_count[i]:
                                    kind = edges_count(tables, law, scene.points, scene.rest, own, e, other)
                                    if kind != 0:
                                        if 2 * count < edges_out.shape[1]:
                                            edges_out[row, 2 * count] = e
                                            edges_out[row, 2 * count + 1] = wp.where(kind > 0, other, -1 - other)
                                        count += 1
        return count

    @wp.kernel(module=module)
    def find_pairs(
        parts: int,
        tables: Tables,
        scene: Scene,
        lost_out: wp.array(dtype=wp.int32),
        found_out: wp.array(dtype=wp.int32),
        points_out: wp.array2d(dtype=wp.int32),
        edges_out: wp.array2d(dtype=wp.int32),
    ):
        """Find all pairs of which the point, or the first edge, belongs to a block.

        Args:
            parts: Threads that share a block.
            tables: The tables.
            scene: What the search reads.
            lost_out: Counts pairs that do not fit, shape (1,).
            found_out: Pairs in each row, those of points, then those of edges, shape (2 rows,).
            points_out: Slot and triangle of each pair, shape (rows, 2 capacity).
            edges_out: Both edges of each pair, shape (rows, 2 capacity); the second as -1 - number if only close.
        """
        b, part = wp.tid()
        row = b * parts + part
        box = scene.boxes[tables.leaf_box[b]]
        first_reach = tables.body[b] * tables.bodies
        largest = real(-1.0)
        for k in range(tables.bodies):
            largest = wp.max(largest, scene.reaches[first_reach + k])
        points_found, edges_found = wp.int32(0), wp.int32(0)
        hits = Hits()
        size = tables.skip.shape[0]
        k = wp.int32(0)
        while k < size:
            count = wp.int32(0)
            while k < size and count < HITS:
                reach = largest
                if tables.tree_body[k] >= 0:
                    reach = real(scene.reaches[first_reach + tables.tree_body[k]])
                if reach >= zero and between(box, scene.boxes[k]) < reach:
                    leaf = tables.leaf[k]
                    if leaf >= 0:
                        if not smooth(tables, scene.cones, b, leaf):
                            hits[count] = leaf
                            count += 1
                    k += 1
                else:
                    k = tables.skip[k]
            for h in range(count):
                leaf = hits[h]
                points_found = match_points(tables, scene, b, leaf, part, parts, row, points_found, points_out)
                if leaf >= b:
                    edges_found = match_edges(tables, scene, b, leaf, part, parts, row, edges_found, edges_out)
        points_kept = wp.min(points_found, points_out.shape[1] / 2)
        edges_kept = wp.min(edges_found, edges_out.shape[1] / 2)
        found_out[row] = points_kept
        found_out[points_out.shape[0] + row] = edges_kept
        lost = points_found - points_kept + edges_found - edges_kept
        if lost > 0:
            wp.atomic_add(lost_out, 0, lost)

    return SimpleNamespace(module=module, Scene=Scene, find_pairs=find_pairs)
