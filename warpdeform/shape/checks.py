"""What is refused of a rest shape: arrays that are no grid, and grids that are no body."""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from warpdeform.errors import Mistake
from warpdeform.grid import ParameterGrid
from warpdeform.measure import cell_measures, mean_edges, strip_corners
from warpdeform.shape.numbers import AXES, FEWEST_PERIODIC, KINDS

Array = NDArray[np.float64]

COINCIDENT = 1e-6
"""Neighbouring nodes nearer than this part of the longest edge count as one point."""
FEWEST_AROUND_POLES = 6
"""Nodes around a pole at least: three strips across it."""
WIDEST_POLE = 2.0
"""Nodes across a pole must be so many steps apart at most, and at least the inverse."""
TOUCHING = 0.1
"""Nodes of a closed shape that are no neighbours must lie further apart than this part of the shortest edge."""

_FORMS = (
    "(n, 3) or (n, strands, 3) with at least 2 nodes: a strand of one node has no length",
    "(nu, nv, 3) with at least 2 x 2 nodes",
    "(nu, nv, nw, 3) with at least 2 x 2 x 2 nodes",
)


def array_mistakes(positions: Array, kind: str, periodic: tuple[bool, ...]) -> list[Mistake]:
    """What is wrong with an array of positions, shape (*nodes, 3), whatever it looks like."""
    dimension, shape = KINDS.index(kind) + 1, positions.shape
    axes = max(dimension, 2)
    if len(shape) != axes + 1 or shape[-1] != 3 or min(shape[:dimension], default=0) < 2 or 0 in shape:
        remedy = f"Give positions of shape {_FORMS[dimension - 1]}."
        return [Mistake("positions", shape, f"is not the shape of a {kind} grid", remedy)]
    if len(periodic) != axes:
        return [Mistake("periodic", periodic, f"must be {dimension} of true and false", "Use one for each axis.")]
    for axis in range(dimension):
        if periodic[axis] and shape[axis] < FEWEST_PERIODIC:
            problem = f"has {shape[axis]} nodes along {AXES[axis]}, which is periodic"
            return [Mistake("positions", shape, problem, f"Use at least {FEWEST_PERIODIC} nodes.")]
    finite = np.isfinite(positions).all(axis=-1)
    if not finite.all():
        node = _first(~finite)
        return [Mistake("positions", positions[node], f"is not finite at node {list(node)}", "Give finite metres.")]
    return []


def pole_mistakes(
    kind: str, nodes: tuple[int, ...], periodic: tuple[bool, ...], poles: tuple[bool, ...]
) -> list[Mistake]:
    """What is wrong with poles, wherever the nodes lie."""
    if len(poles) != 2:
        return [Mistake("poles", poles, "must be two of true and false", "Use one for each end of the open axis.")]
    if not any(poles):
        return []
    if kind != "surface" or sum(periodic) != 1:
        problem = "close the ends of an axis around which the other one is periodic, which this shape has not"
        return [Mistake("poles", poles, problem, "Make one axis of a surface periodic, or leave poles out.")]
    around = periodic.index(True)
    if nodes[around] % 2 or nodes[around] < FEWEST_AROUND_POLES:
        problem = f"has {nodes[around]} nodes along {AXES[around]}, of which every one needs another across a pole"
        remedy = f"Use an even number of nodes along {AXES[around]}, at least {FEWEST_AROUND_POLES}."
        return [Mistake("positions", nodes, problem, remedy)]
    return []


def geometry_mistakes(positions: Array, grid: ParameterGrid) -> list[Mistake]:
    """What is wrong with a grid of finite positions, shape (*nodes, 3): the first thing found."""
    edges = [np.linalg.norm(grid.differences(positions, axis), axis=-1) for axis in range(grid.dimension)]
    limit = COINCIDENT * max(edge.max() for edge in edges)
    for axis, edge in enumerate(edges):
        if edge.min() <= limit:
            return [_coincident(positions, grid, axis, edge <= limit)]
    if grid.dimension == 2 and (mistakes := _area_mistakes(positions, grid, limit)):
        return mistakes
    if grid.dimension == 3 and (mistakes := _volume_mistakes(positions, grid, limit)):
        return mistakes
    if any(grid.poles) and (mistakes := _closing_mistakes(positions, grid)):
        return mistakes
    if any(grid.periodic):
        return _touching(positions, grid, TOUCHING * min(edge.min() for edge in edges))
    return []


def _coincident(positions: Array, grid: ParameterGrid, axis: int, short: NDArray[np.bool_]) -> Mistake:
    """Edges of no length along an axis: a pole where a whole end of another axis has none, else two nodes in one."""
    for across in range(grid.dimension):
        for end, name in ((0, "start"), (-1, "end")):
            if across != axis and np.take(short, end, axis=across).all():
                problem = f"has a pole: no edge along {AXES[axis]} has a length at the {name} of {AXES[across]}"
                remedy = f"Let {AXES[across]} {name} half a step beside the pole, and say so with poles."
                return Mistake("positions", None, problem, remedy)
    node = _first(short)
    following = list(node)
    following[axis] = (following[axis] + 1) % grid.nodes[axis]
    problem = f"coincides at nodes {list(node)} and {following}"
    return Mistake("positions", positions[node], problem, "Move the nodes apart.")


def _area_mistakes(positions: Array, grid: ParameterGrid, limit: float) -> list[Mistake]:
    area = cell_measures(grid, positions)
    if area.min() <= limit**2:
        problem = f"leaves the cell at node {list(_first(area <= limit**2))} without area"
        return [Mistake("positions", None, problem, "Spread its four nodes over a surface.")]
    return []


def _closing_mistakes(positions: Array, grid: ParameterGrid) -> list[Mistake]:
    """Rings of nodes that do not lie half a step around a pole: too far or too near, twisted, or inside out."""
    along = grid.periodic.index(False)
    steps = np.linalg.norm(grid.differences(positions, along), axis=-1)
    for ring, end in zip(grid.rings, np.flatnonzero(grid.poles), strict=True):
        name = f"{('start', 'end')[end]} of {AXES[along]}"
        points, half = positions[tuple(ring.T)], len(ring) // 2
        across = np.linalg.norm(points - np.roll(points, half, axis=0), axis=-1)
        ratio = across / np.take(steps, -end, axis=along)
        if ratio.max() > WIDEST_POLE or ratio.min() < 1.0 / WIDEST_POLE:
            wrong = int(np.argmax(np.abs(np.log(np.maximum(ratio, 1e-9)))))
            problem = f"does not close at the {name}: the node across from {ring[wrong].tolist()} is "
            problem += f"{ratio[wrong]:.3g} steps of {AXES[along]} away, not about one"
            remedy = f"Let the nodes at the {name} lie half a step around the pole, or leave poles out."
            return [Mistake("positions", positions[tuple(ring[wrong])], problem, remedy)]
        r00, r10, r01, r11 = strip_corners(points)
        normals = np.cross(r11 - r00, r01 - r10)
        middle = normals.sum(axis=0)
        if (normals @ middle <= 1e-3 * np.linalg.norm(normals, axis=-1) * np.linalg.norm(middle)).any():
            problem = f"crosses itself in the pole at the {name}"
            return [Mistake("positions", None, problem, "Put the nodes around the pole in order.")]
    return []


def _volume_mistakes(positions: Array, grid: ParameterGrid, limit: float) -> list[Mistake]:
    m1, m2, m3 = mean_edges(grid, positions)
    volume = np.sum(m1 * np.cross(m2, m3), axis=-1)
    if volume.max() < -(limit**3):
        problem = "is left-handed: u, v and w turn the wrong way"
        return [Mistake("positions", None, problem, "Exchange two axes, or reverse one.")]
    if volume.min() <= limit**3:
        problem = f"leaves the cell at node {list(_first(volume <= limit**3))} without volume, or inside out"
        return [Mistake("positions", None, problem, "Move its eight nodes apart.")]
    return []


def _touching(positions: Array, grid: ParameterGrid, distance: float) -> list[Mistake]:
    """Nodes nearer than `distance`, which no two neighbours are: found by sorting into boxes of twice that size.

    Two such nodes share a box of at least one of eight gratings, half a box apart along each axis.
    """
    points = positions.reshape(-1, 3) - positions.reshape(-1, 3).min(axis=0)
    for offset in product((0.0, 0.5), repeat=3):
        box = np.floor(points / (2.0 * distance) + offset).astype(np.int64)
        key = (box[:, 0] * 73856093) ^ (box[:, 1] * 19349663) ^ (box[:, 2] * 83492791)
        order = np.argsort(key, kind="stable")
        same = np.flatnonzero(np.diff(key[order]) == 0)
        a, b = order[same], order[same + 1]
        near = np.linalg.norm(points[a] - points[b], axis=1) < distance
        first, second = (np.array(np.unravel_index(nodes[near], grid.nodes)).T for nodes in (a, b))
        if grid.dimension == 1:
            one_strand = first[:, 1] == second[:, 1]
            first, second = first[one_strand], second[one_strand]
        if len(first):
            one, other = sorted((first[0].tolist(), second[0].tolist()))
            problem = f"touches itself: nodes {one} and {other} lie closer than a tenth of the shortest edge"
            return [Mistake("positions", positions[tuple(one)], problem, "Keep parts of a closed shape apart.")]
    return []


def _first(mask: NDArray[np.bool_] | np.bool_) -> tuple[int, ...]:
    """Index of the first true element."""
    return tuple(int(i) for i in np.argwhere(mask)[0])
