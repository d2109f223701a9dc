"""Which nodes of a body are meant: corners, ends, edges and faces of its grid, or indices."""

import operator
import re
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from warpdeform.errors import InputError, Mistake

NodeSelector = str | Sequence[Sequence[int]] | Sequence[int]
"""Which nodes: "all"; of a curve "end:0" (the first node of every strand), "end:1,2" (the last two: a clamp); of a
surface "corner:0,1" (start or end of u, of v), "edge:u,0" (the row u = start), "edge:v,1,2" (the last two rows of v: a
clamp); of a solid "corner:0,0,1", "edge:u,0,1" (the edge along u at the start of v and the end of w), "face:u,0" (the
layer u = start), "face:w,1,2" (the last two layers of w). Or indices: [[i, j], ...], [[i, j, k], ...] of a solid,
[[i, strand], ...] of a curve, or [i, ...]: those nodes of every strand."""

REMEDIES = {
    "curve": 'Use "end:0", "end:1,2" (two nodes), "all", or indices [[i, strand], ...] or [i, ...].',
    "surface": 'Use "corner:0,1", "edge:u,0", "edge:v,1,2" (two rows), "all" or index pairs [[i, j], ...].',
    "solid": 'Use "corner:0,0,1", "edge:u,0,1", "face:u,0", "face:w,1,2" (two layers), "all" or [[i, j, k], ...].',
}
"""What there is for each kind of body."""
_INDICES = {"curve": "a list of indices", "surface": "a list of index pairs", "solid": "a list of index triples"}
_LAYERS = {"curve": "nodes", "surface": "rows", "solid": "layers"}

_ENDS = re.compile(r"([01])(?:,(\d+))?")
_LAYER = re.compile(r"([uvw]),([01])(?:,(\d+))?")
_SIDES = re.compile(r"(?:([uvw]),)?([01](?:,[01])*)")


def select_nodes(selector: NodeSelector, nodes: Sequence[int], kind: str = "surface") -> NDArray[np.int64]:
    """Indices of the selected nodes.

    Args:
        selector: See `NodeSelector`.
        nodes: Nodes of the grid along its axes.
        kind: "curve", "surface" or "solid".

    Returns:
        Indices, shape (k, axes).

    Raises:
        InputError: An unknown selector, or a node outside the grid; says which selectors the kind has.
    """
    if not isinstance(selector, str):
        return _listed(selector, nodes, kind)
    if selector == "all":
        return _box([(0, n) for n in nodes])
    name, _, rest = selector.partition(":")
    sides, layer = _SIDES.fullmatch(rest), _LAYER.fullmatch(rest)
    if kind == "curve" and name == "end" and (end := _ENDS.fullmatch(rest)):
        return _layers(selector, nodes, kind, 0, end[1], end[2])
    if name == {"surface": "edge", "solid": "face"}.get(kind) and layer and "uvw".index(layer[1]) < len(nodes):
        return _layers(selector, nodes, kind, "uvw".index(layer[1]), layer[2], layer[3])
    if kind != "curve" and sides:
        ends = [end == "1" for end in sides[2].split(",")]
        if name == "corner" and not sides[1] and len(ends) == len(nodes):
            return _box(_at_ends(nodes, ends))
        if name == "edge" and kind == "solid" and sides[1] and len(ends) == 2:
            return _box(_at_ends(nodes, ends, "uvw".index(sides[1])))
    raise InputError(Mistake("nodes", selector, f"is not a node selector of a {kind}", REMEDIES[kind]))


def _at_ends(nodes: Sequence[int], ends: list[bool], along: int = -1) -> list[tuple[int, int]]:
    """Ranges along the axes: the first or last node of each, but all nodes of the axis `along`."""
    rest = iter(ends)
    return [(0, n) if axis == along else (n - 1, n) if next(rest) else (0, 1) for axis, n in enumerate(nodes)]


def _layers(
    selector: str, nodes: Sequence[int], kind: str, axis: int, last: str, number: str | None
) -> NDArray[np.int64]:
    """The first or last layers of an axis."""
    count, limit = int(number or 1), nodes[axis]
    if not 1 <= count <= limit:
        what = _LAYERS[kind]
        problem = f"asks for {count} {what} of {limit}"
        raise InputError(Mistake("nodes", selector, problem, f"Use 1 to {limit} {what}."))
    ranges = [(0, n) for n in nodes]
    ranges[axis] = (limit - count, limit) if last == "1" else (0, count)
    return _box(ranges)


def _box(ranges: Sequence[tuple[int, int]]) -> NDArray[np.int64]:
    index = np.meshgrid(*(np.arange(first, end) for first, end in ranges), indexing="ij")
    return np.stack(index, axis=-1).reshape(-1, len(ranges))


def _listed(selector: Sequence[Sequence[int]] | Sequence[int], nodes: Sequence[int], kind: str) -> NDArray[np.int64]:
    try:
        items = [list(each) if isinstance(each, Iterable) else [each] for each in selector]
        indices = [[operator.index(i) for i in each] for each in items]
        lengths = {len(each) for each in indices}
        if kind == "curve" and lengths == {1}:
            indices = [[i, strand] for (i,) in indices for strand in range(nodes[1])]
            lengths = {2}
        if not lengths <= {len(nodes)}:
            raise ValueError
        found = np.array(indices, dtype=np.int64).reshape(-1, len(nodes))
    except (TypeError, ValueError):
        raise InputError(Mistake("nodes", selector, f"is not {_INDICES[kind]}", REMEDIES[kind])) from None
    outside = np.any((found < 0) | (found >= np.array(nodes)), axis=1)
    if outside.any():
        limit = f"{[0] * len(nodes)} to {[n - 1 for n in nodes]}"
        problem, remedy = "lies outside the grid", f"Use indices from {limit}."
        raise InputError(Mistake("nodes", found[outside][0].tolist(), problem, remedy))
    return found
