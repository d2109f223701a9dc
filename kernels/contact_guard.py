"""What forbids crossing: no pair may come to where its dividing plane no longer divides it (design 5.2).

For a pair with the unit normal n between its closest points, and displacements d of its corners, the smallest
separation along n at the end of the way,

    min over corners i of the first, j of the second side of   n.(x_i - x_j) + n.(d_i - d_j)

is a concave function of how much of the way is gone: if it is positive at the end it is so all the time, and the two
cannot have met. This is a plane that moves with the pair, so it does not hold back what moves together, and it says so
for every pair that it is asked about, whether a force acts or not. A pair is *at risk* if it would lose more than 0.9
of its separation above the floor. Pairs whose boxes cannot meet, given the boxes of their displacements, are not.

Risks are taken away by impulses (:mod:`warpdeform.kernels.contact_impulses`).

Departs from design 5.2, whose planes stand still in the frame of the body's mean motion, share the gap between both
sides, and need a cap of 0.45 of the query radius for what was not found: those hold back layers that move together, and
nodes far from any contact.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.boxes import BLOCK, HALF_CONE, Tables, box_distances, box_words
from warpdeform.kernels.contact_geometry import closest
from warpdeform.kernels.contact_law import contact_law
from warpdeform.kernels.contact_search import contact_search
from warpdeform.kernels.lanes import kernel_module, lanes

HITS = 32
"""Blocks that a thread takes from the tree at a time."""
ALLOWED = 0.9
"""Share of its separation above the floor that a pair may lose in one update."""
WATCHED = 0.5
"""The same from which on a pair is listed: impulses of others may put it at risk."""
INTO_WALL = 0.5
"""Share of its room inside the wall that counts as room: the potential must not rise too much in one update."""
NEARLY = 0.999
"""Largest share of its way that a pair at risk may go."""
TOLERANCE = 1e-3
"""Share of the separation that a pair below the floor may lose all the same: so that round-off is no risk."""
ROUND_OFF = 20.0
"""Units in the last place of the coordinates below which nothing is let come near."""
EPSILONS = {wp.float32: 2.0**-23, wp.float64: 2.0**-52}


@functools.cache
def kept_separation(real: Any) -> Any:
    """The device function that says what is left of a pair's separation, for one precision."""
    Law = contact_law(real)

    @wp.func
    def kept(separation: real, law: Law, allowed: real):
        """Separation after a loss of a share of the room: what is outside of the wall enters it by a part at most."""
        edge = law.inner + law.wall
        room = wp.max(separation - edge, real(0.0))
        room += real(INTO_WALL) * wp.max(wp.min(separation, edge) - law.floor, real(0.0))
        return separation - allowed * room

    return kept


@functools.cache
def contact_guard(width: int, real: Any) -> SimpleNamespace:
    """The search for pairs at risk, for one lane width and precision."""
    words, single = lanes(width, real), lanes(1, real)
    V, load3 = single.V, words.load3
    below, first_lane = words.below, words.first_lane
    exact = closest(real)
    point_triangle, segment_segment = exact.point_triangle, exact.segment_segment
    shape, Law, Scene = box_words(real), contact_law(real), contact_search(width, real).Scene
    Box, at_slot, approach = shape.Box, shape.at_slot, shape.approach
    distances = box_distances(width, real)
    Hits = wp.types.vector(HITS, wp.int32)
    groups = BLOCK // width
    zero, one, tiny = real(0.0), real(1.0), real(1e-30)
    kept = kept_separation(real)
    round_off = real(ROUND_OFF * EPSILONS[real])
    module = kernel_module("contact_guard", width, real)

    @wp.func
    def swept(box: Box, drift: Box, other_drift: Box):
        """The box of all places of a box, as seen from something that moves by another drift."""
        return Box(
            box[0] + wp.min(drift[0] - other_drift[3], zero),
            box[1] + wp.min(drift[1] - other_drift[4], zero),
            box[2] + wp.min(drift[2] - other_drift[5], zero),
            box[3] + wp.max(drift[3] - other_drift[0], zero),
            box[4] + wp.max(drift[4] - other_drift[1], zero),
            box[5] + wp.max(drift[5] - other_drift[2], zero),
        )

    @wp.func
    def turns(drift: Box, spacing: real):
        """How far the normals of a block may turn that drifts so: its diagonals are longer than the spacing."""
        return real(2.0) * wp.length(V(drift[3] - drift[0], drift[4] - drift[1], drift[5] - drift[2])) / spacing

    @wp.func
    def stays_smooth(tables: Tables, scene: Scene, a: int, b: int, drift_a: Box, drift_b: Box, spacing: real):
        """Whether blocks are one or neighbours whose normals are, and stay, so alike that nothing there can touch."""
        away = tables.place[a] - tables.place[b]
        ok = away[0] == 0 and wp.abs(away[1]) <= 1 and wp.abs(away[2]) <= 1
        if ok:
            ca, cb = scene.cones[a], scene.cones[b]
            angle = wp.max(ca[3] + turns(drift_a, spacing), cb[3] + turns(drift_b, spacing))
            apart = V(ca[0] - cb[0], ca[1] - cb[1], ca[2] - cb[2])
            ok = angle + real(0.7854) * wp.length(apart) <= real(HALF_CONE)
        return ok

    @wp.func
    def free_share(separation: real, end: real, law: Law, least: real):
        """How much of its way a pair may go: less than 1 if it is at risk, 1 if it may come to be, else 2.

        What is at risk is never let nearer than half its separation, nor than `least`.
        """
        share = real(2.0)
        if end < kept(separation, law, real(WATCHED)):
            share = one
        need = kept(separation, law, real(ALLOWED)) - real(TOLERANCE) * separation
        if end < need:
            keep = wp.min(need, wp.max(real(0.5) * separation, least))
            share = wp.clamp((separation - keep) / wp.max(separation - end, tiny), zero, real(NEARLY))
        return share

    @wp.func
    def point_share(
        tables: Tables, law: Law, scene: Scene, directions: wp.array3d(dtype=real), least: real, s: int, t: int
    ):
        """`free_share` of the point in slot s and triangle t."""
        i, j = t >> 4, t & 15
        a, b, c = tables.triangle_a[i, j], tables.triangle_b[i, j], tables.triangle_c[i, j]
        share = real(2.0)
        if s != a and s != b and s != c:
            x, d = at_slot(scene.points, s), at_slot(directions, s)
            xa, xb, xc = at_slot(scene.points, a), at_slot(scene.points, b), at_slot(scene.points, c)
            r, _w = point_triangle(x, xa, xb, xc)
            n = r / wp.max(wp.length(r), tiny)
            sa, sb, sc = wp.dot(n, x - xa), wp.dot(n, x - xb), wp.dot(n, x - xc)
            ea = sa + wp.dot(n, d - at_slot(directions, a))
            eb = sb + wp.dot(n, d - at_slot(directions, b))
            ec = sc + wp.dot(n, d - at_slot(directions, c))
            share = free_share(wp.min(sa, wp.min(sb, sc)), wp.min(ea, wp.min(eb, ec)), law, least)
        return share

    @wp.func
    def edge_share(
        tables: Tables, law: Law, scene: Scene, directions: wp.array3d(dtype=real), least: real, e: int, g: int
    ):
        """`free_share` of two edges."""
        i, j, k, m = e >> 4, e & 15, g >> 4, g & 15
        p, q, a, b = tables.edge_a[i, j], tables.edge_b[i, j], tables.edge_a[k, m], tables.edge_b[k, m]
        share = real(2.0)
        if p != a and p != b and q != a and q != b:
            xp, xq, xa, xb = (
                at_slot(scene.points, p),
                at_slot(scene.points, q),
                at_slot(scene.points, a),
                at_slot(scene.points, b),
            )
            r, _s, _t = segment_segment(xp, xq, xa, xb)
            n = r / wp.max(wp.length(r), tiny)
            dp, dq = wp.dot(n, at_slot(directions, p)), wp.dot(n, at_slot(directions, q))
            da, db = wp.dot(n, at_slot(directions, a)), wp.dot(n, at_slot(directions, b))
            pa, pb, qa, qb = wp.dot(n, xp - xa), wp.dot(n, xp - xb), wp.dot(n, xq - xa), wp.dot(n, xq - xb)
            start = wp.min(wp.min(pa, pb), wp.min(qa, qb))
            end = wp.min(wp.min(pa + dp - da, pb + dp - db), wp.min(qa + dq - da, qb + dq - db))
            share = free_share(start, end, law, least)
        return share

    @wp.func
    def risky_points(
        tables: Tables, scene: Scene, directions: wp.array3d(dtype=real), drifts: wp.array(dtype=Box),
        least: real,
        b: int, leaf: int, part: int, parts: int, row: int, found: int,
        share_out: wp.array(dtype=real), points_out: wp.array2d(dtype=wp.int32),
    ):  # fmt: skip
        """Points of block b at risk with triangles of another; the number of pairs found so far."""
        law = scene.laws[tables.body[b] * tables.bodies + tables.body[leaf]]
        drift, other_drift = drifts[tables.leaf_box[b]], drifts[tables.leaf_box[leaf]]
        other_box = swept(scene.boxes[tables.leaf_box[leaf]], other_drift, drift)
        count = wp.int32(found)
        for group in range(part, groups, parts):
            p = load3(scene.points, 0, b, group * width)
            near_block = below(distances(p, p, other_box), law.floor)
            while near_block != 0:
                slot = group * width + first_lane(near_block)
                near_block = near_block & (near_block - 1)
                if slot < tables.present[b]:
                    s = BLOCK * b + slot
                    x, d = at_slot(scene.points, s), at_slot(directions, s)
                    own_drift = Box(d[0], d[1], d[2], d[0], d[1], d[2])
                    box = swept(Box(x[0], x[1], x[2], x[0], x[1], x[2]), own_drift, other_drift)
                    for i in range(tables.triangle_row_start[leaf], tables.triangle_row_start[leaf + 1]):
                        for g in range(groups):
                            low = load3(scene.triangle_boxes, 0, i, g * width)
                            high = load3(scene.triangle_boxes, 3, i, g * width)
                            near = below(distances(low, high, box), law.floor)
                            while near != 0:
                                j = g * width + first_lane(near)
                                near = near & (near - 1)
                                if j < tables.triangle_count[i]:
                                    share = point_share(tables, law, scene, directions, least, s, BLOCK * i + j)
                                    if share <= one:
                                        wp.atomic_min(share_out, 0, share)
                                        if 2 * count < points_out.shape[1]:
                                            points_out[row, 2 * count] = s
                                            points_out[row, 2 * count + 1] = BLOCK * i + j
                                        count += 1
        return count

    @wp.func
    def risky_edges(
        tables: Tables, scene: Scene, directions: wp.array3d(dtype=real), drifts: wp.array(dtype=Box),
        least: real,
        b: int, leaf: int, part: int, parts: int, row: int, found: int,
        share_out: wp.array(dtype=real), edges_out: wp.array2d(dtype=wp.int32),
    ):  # fmt: skip
        """Edges of block b at risk with later ones of another or the same; the number of pairs found so far."""
        law = scene.laws[tables.body[b] * tables.bodies + tables.body[leaf]]
        drift, other_drift = drifts[tables.leaf_box[b]], drifts[tables.leaf_box[leaf]]
        other_box = swept(scene.boxes[tables.leaf_box[leaf]], other_drift, drift)
        count = wp.int32(found)
        first_row = tables.edge_row_start[b]
        for group in range(part, groups * (tables.edge_row_start[b + 1] - first_row), parts):
            edge_row, start = first_row + group // groups, (group % groups) * width
            low, high = load3(scene.edge_boxes, 0, edge_row, start), load3(scene.edge_boxes, 3, edge_row, start)
            near_block = below(distances(low, high, other_box), law.floor)
            while near_block != 0:
                k = start + first_lane(near_block)
                near_block = near_block & (near_block - 1)
                if k < tables.edge_count[edge_row]:
                    e = BLOCK * edge_row + k
                    dp, dq = (
                        at_slot(directions, tables.edge_a[edge_row, k]),
                        at_slot(directions, tables.edge_b[edge_row, k]),
                    )
                    own_drift = shape.grow(Box(dp[0], dp[1], dp[2], dp[0], dp[1], dp[2]), dq)
                    box = swept(shape.box_at(scene.edge_boxes, e), own_drift, other_drift)
                    for i in range(tables.edge_row_start[leaf], tables.edge_row_start[leaf + 1]):
                        for g in range(groups):
                            j = g * width
                            near_by = distances(load3(scene.edge_boxes, 0, i, j), load3(scene.edge_boxes, 3, i, j), box)
                            near = below(near_by, law.floor)
                            while near != 0:
                                m = j + first_lane(near)
                                near = near & (near - 1)
                                other = BLOCK * i + m
                                if e < other and m < tables.edge_count[i]:
                                    share = edge_share(tables, law, scene, directions, least, e, other)
                                    if share <= one:
                                        wp.atomic_min(share_out, 0, share)
                                        if 2 * count < edges_out.shape[1]:
                                            edges_out[row, 2 * count] = e
                                            edges_out[row, 2 * count + 1] = other
                                        count += 1
        return count

    @wp.kernel(module=module)
    def find_risks(
        parts: int,
        spacing: real,
        tables: Tables,
        scene: Scene,
        directions: wp.array3d(dtype=real),
        drifts: wp.array(dtype=Box),
        stirred: wp.array(dtype=wp.int32),
        lost_out: wp.array(dtype=wp.int32),
        share_out: wp.array(dtype=real),
        found_out: wp.array(dtype=wp.int32),
        points_out: wp.array2d(dtype=wp.int32),
        edges_out: wp.array2d(dtype=wp.int32),
    ):
        """Find all pairs at risk of which the point, or the first edge, belongs to a block.

        Args:
            parts: Threads that share a block.
            spacing: Smallest node spacing [m].
            tables: The tables.
            scene: Boxes, cones and positions.
            directions: Displacements in slots [m].
            drifts: Boxes of the tree around them.
            stirred: 1 for blocks whose displacements have changed since all pairs were looked at.
            lost_out: Counts pairs that do not fit, shape (1,).
            share_out: How much of the displacement every pair allows, shape (1,); 1 before.
            found_out: Pairs in each row, those of points, then those of edges, shape (2 rows,).
            points_out: Slot and triangle of each pair, shape (rows, 2 capacity).
            edges_out: Both edges of each pair, shape (rows, 2 capacity).
        """
        b, part = wp.tid()
        row = b * parts + part
        box, drift = scene.boxes[tables.leaf_box[b]], drifts[tables.leaf_box[b]]
        all_boxes = scene.boxes[0]
        far = wp.max(wp.max(-all_boxes[0], -all_boxes[1]), -all_boxes[2])
        far = wp.max(far, wp.max(all_boxes[3], wp.max(all_boxes[4], all_boxes[5])))
        least = round_off * far
        first_reach = tables.body[b] * tables.bodies
        points_found, edges_found = wp.int32(0), wp.int32(0)
        hits = Hits()
        size = tables.skip.shape[0]
        k = wp.int32(0)
        while k < size:
            count = wp.int32(0)
            while k < size and count < HITS:
                floor = scene.largest_floor
                if tables.tree_body[k] >= 0:
                    floor = real(scene.floors[first_reach + tables.tree_body[k]])
                if floor >= zero and approach(box, scene.boxes[k], drift, drifts[k]) <= floor:
                    leaf = tables.leaf[k]
                    if leaf >= 0 and stirred[b] + stirred[leaf] > 0:
                        if not stays_smooth(tables, scene, b, leaf, drift, drifts[k], spacing):
                            hits[count] = leaf
                            count += 1
                    k += 1
                else:
                    k = tables.skip[k]
            for h in range(count):
                leaf = hits[h]
                points_found = risky_points(
                    tables,
                    scene,
                    directions,
                    drifts,
                    least,
                    b,
                    leaf,
                    part,
                    parts,
                    row,
                    points_found,
                    share_out,
                    points_out,
                )
                if leaf >= b:
                    edges_found = risky_edges(
                        tables,
                        scene,
                        directions,
                        drifts,
                        least,
                        b,
                        leaf,
                        part,
                        parts,
                        row,
                        edges_found,
                        share_out,
                        edges_out,
                    )
        points_kept = wp.min(points_found, points_out.shape[1] / 2)
        edges_kept = wp.min(edges_found, edges_out.shape[1] / 2)
        found_out[row] = points_kept
        found_out[points_out.shape[0] + row] = edges_kept
        lost = points_found - points_kept + edges_found - edges_kept
        if lost > 0:
            wp.atomic_add(lost_out, 0, lost)

    return SimpleNamespace(module=module, find_risks=find_risks)
