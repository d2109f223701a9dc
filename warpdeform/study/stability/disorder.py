"""Starts that no smooth motion leads to; what is held stays where it is."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpdeform.body import Body
from warpdeform.selectors import select_nodes

Array = NDArray[np.float64]

CRUMPLED = 0.5
"""How far nodes are moved along each axis at most, over the distance of neighbours."""
TURNED = 4
"""Nodes of the middle of the first axis whose order is turned round."""


def _smooth(positions: Array) -> Array:
    return positions


def _crumpled(positions: Array) -> Array:
    along = positions if positions.shape[0] > 1 else np.moveaxis(positions, 1, 0)
    spacing = float(np.median(np.linalg.norm(np.diff(along, axis=0), axis=-1)))
    return positions + CRUMPLED * spacing * np.random.default_rng(0).uniform(-1.0, 1.0, positions.shape)


def _inverted(positions: Array) -> Array:
    count = min(TURNED, positions.shape[0])
    first = (positions.shape[0] - count) // 2
    turned = positions.copy()
    turned[first : first + count] = positions[first : first + count][::-1]
    return turned


def _coincident(positions: Array) -> Array:
    middle = tuple(n // 2 for n in positions.shape[:-1])
    beside = (middle[0] - 1, *middle[1:])
    joined = positions.copy()
    joined[middle] = positions[beside]
    return joined


DISORDERS: dict[str, Callable[[Array], Array]] = {
    "smooth": _smooth,
    "crumpled": _crumpled,
    "inverted": _inverted,
    "coincident": _coincident,
}
"""As the scene has it; every node moved by up to half a spacing; the middle cells turned over; two nodes in
one point."""


def disordered(body: Body, kind: str, strain: float = 0.0) -> Body:
    """A body that starts so.

    Args:
        body: The body.
        kind: One of `DISORDERS`.
        strain: How much longer it starts along its first axis, what is held included: below 0 it is compressed.
    """
    if kind == "smooth" and not strain:
        return body
    start = body.placed_positions()
    way = (start[-1] - start[0]).reshape(-1, 3).mean(axis=0)
    start = start + strain * np.multiply.outer((start - start.reshape(-1, 3).mean(axis=0)) @ way / (way @ way), way)
    moved = DISORDERS[kind](start)
    for pin in body.pins:
        held: Any = tuple(select_nodes(pin.nodes, body.nodes, body.kind).T)
        moved[held] = start[held]
    return replace(body, initial_positions=moved)
