"""Attachments between bodies as the user describes them: which nodes of one hang on which points of another."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from warpdeform.body import Body
from warpdeform.errors import InputError, Mistake
from warpdeform.selectors import NodeSelector, select_nodes

Array = NDArray[np.float64]

APART = 1e-3
"""Points that are tied rigidly may start this part of the body's node spacing apart."""


@dataclass(frozen=True)
class Attachment:
    """Nodes of a body that are attached to points of another body, or of the same one.

    Attributes:
        body: Name of the body whose nodes are attached; rigid ones follow the other body.
        nodes: Which of its nodes.
        to: Name of the body that they are attached to.
        at: Where on it: nodes, one for each; another number of nodes of an edge (each attached node takes the point of
            the line through them that lies as far along); "nearest", the nearest points of it as the bodies start; or
            parameters from 0 to 1, one tuple for each node, shape (k, axes); of a curve along it and across its
            strands, the second of which a single strand does without.
        stiffness: Of each node's tie [N/m]; None ties rigidly.

    Raises:
        InputError: A stiffness that is not positive.
    """

    body: str
    nodes: NodeSelector
    to: str
    at: NodeSelector | Sequence[Sequence[float]] = "nearest"
    stiffness: float | None = None

    def __post_init__(self) -> None:
        k = self.stiffness
        if k is not None and not (math.isfinite(k) and k > 0):
            raise InputError(Mistake("stiffness", k, "must be positive [N/m]", "Leave it out to attach rigidly."))


@dataclass(frozen=True)
class Ties:
    """The ties of an attachment.

    Attributes:
        nodes: Attached nodes, indices of shape (k, axes).
        points: Nodes whose weighted means they are attached to, shape (k, m, axes of the other body).
        weights: Their weights, shape (k, m); they add up to 1.
    """

    nodes: NDArray[np.int64]
    points: NDArray[np.int64]
    weights: Array


def find_all_ties(attachments: Sequence[Attachment], bodies: Mapping[str, Body]) -> list[Ties]:
    """The ties of all attachments of a scene.

    Raises:
        InputError: All mistakes, with keys that begin with `attachment` and its place in the list: of `find_ties`,
            and nodes that follow rigidly although they are pinned, follow something else too, or are followed.
    """
    found: list[Ties] = []
    mistakes: list[Mistake] = []
    followers: set[Node] = set()
    followed: set[Node] = set()
    for index, attachment in enumerate(attachments):
        try:
            found.append(find_ties(attachment, bodies))
            if attachment.stiffness is None:
                _take_followers(attachment, found[-1], bodies[attachment.body], followers, followed)
        except InputError as error:
            mistakes += [Mistake(f"attachment.{index}.{m.key}", m.value, m.problem, m.remedy) for m in error.mistakes]
    if mistakes:
        raise InputError(mistakes)
    return found


Node = tuple[str, tuple[int, ...]]
"""A node: name of its body, indices."""


def _take_followers(attachment: Attachment, ties: Ties, body: Body, followers: set[Node], followed: set[Node]) -> None:
    """Check the nodes of rigid ties and note them."""
    remedy = "Attach it with a stiffness, or leave it out."
    pinned = {tuple(n) for pin in body.pins for n in select_nodes(pin.nodes, body.nodes, body.kind).tolist()}
    own = [(attachment.body, tuple(node)) for node in ties.nodes.tolist()]
    for node in own:
        if node[1] in pinned:
            raise InputError(Mistake("nodes", list(node[1]), "is pinned and cannot follow another body", remedy))
        if node in followers:
            raise InputError(Mistake("nodes", list(node[1]), "follows two points", "Attach it rigidly once."))
        followers.add(node)
    followed |= {(attachment.to, tuple(node)) for node in ties.points.reshape(-1, ties.points.shape[-1]).tolist()}
    for name, indices in followers & followed:
        problem = f"of {name!r} follows another body and is itself followed"
        raise InputError(Mistake("nodes", list(indices), problem, remedy))


def find_ties(attachment: Attachment, bodies: Mapping[str, Body]) -> Ties:
    """The ties of an attachment between bodies in their initial state.

    Raises:
        InputError: A body or node that does not exist, numbers of nodes that do not fit, rigid ties whose ends start
            apart; keys are those of `Attachment`.
    """
    for key, name in (("body", attachment.body), ("to", attachment.to)):
        if name not in bodies:
            raise InputError(Mistake(key, name, "is no body of the scene", f"Use one of {', '.join(bodies)}."))
    body, other = bodies[attachment.body], bodies[attachment.to]
    nodes = select_nodes(attachment.nodes, body.nodes, body.kind)
    own = body.placed_positions()[tuple(nodes.T)]
    if attachment.at == "nearest":
        points, weights = _nearest(own, other, nodes if body is other else None)
    elif _is_parameters(attachment.at):
        points, weights = _at_parameters(np.asarray(attachment.at, dtype=np.float64), len(nodes), other)
    else:
        points, weights = _at_nodes(attachment.at, own, other)  # type: ignore[arg-type]
    found = np.einsum("km,kmc->kc", weights, other.placed_positions()[tuple(np.moveaxis(points, -1, 0))])
    apart = np.linalg.norm(found - own, axis=1)
    limit = APART * _spacing(other)
    if attachment.stiffness is None and apart.max(initial=0.0) > limit:
        worst = int(np.argmax(apart))
        problem = (
            f"starts {apart[worst]:.3g} m from where node {nodes[worst].tolist()} of {body.name!r} is tied rigidly"
        )
        remedy = "Move the bodies together, or give a stiffness [N/m]."
        raise InputError(Mistake("at", attachment.at, problem, remedy))
    return Ties(nodes, points, weights)


def _is_parameters(at: object) -> bool:
    """Whether `at` is a list of tuples with a number that is not whole."""
    if isinstance(at, str):
        return False
    numbers = [x for entry in at for x in (entry if isinstance(entry, Sequence) else [entry])]  # type: ignore[attr-defined]
    return any(isinstance(x, float) for x in numbers)


def _at_parameters(parameters: Array, count: int, other: Body) -> tuple[NDArray[np.int64], Array]:
    axes, given = len(other.nodes), parameters.tolist()
    if other.kind == "curve" and other.nodes[1] == 1 and parameters.shape == (count, 1):
        parameters = np.pad(parameters, ((0, 0), (0, 1)))
    if parameters.shape != (count, axes) or not ((parameters >= 0.0) & (parameters <= 1.0)).all():
        problem = f"must be {axes} parameters from 0 to 1 for each of the {count} nodes"
        remedy = f"Use for example {[[0.5] * axes] * min(count, 2)}."
        raise InputError(Mistake("at", given, problem, remedy))
    return _cell_weights(parameters * np.array(other.shape.grid.cells), other)


def _cell_weights(places: Array, other: Body) -> tuple[NDArray[np.int64], Array]:
    """Multilinear weights of points given by their place along each axis in cells, shape (k, axes)."""
    grid = other.shape.grid
    cells = np.array(grid.cells)
    cell = np.clip(np.floor(places).astype(np.int64), 0, np.maximum(cells - 1, 0))
    share = places - cell
    points, weights = [], []
    for corner in product((0, 1), repeat=len(cells)):
        step = np.array([c if axis < grid.dimension else 0 for axis, c in enumerate(corner)])
        points.append((cell + step) % np.array(grid.nodes))
        each = np.where(np.array(corner) == 1, share, 1.0 - share)
        weights.append(np.prod(each, axis=1))
    chosen = [k for k, w in enumerate(weights) if np.any(w != 0.0)]
    return np.stack([points[k] for k in chosen], axis=1), np.stack([weights[k] for k in chosen], axis=1)


def _at_nodes(at: NodeSelector, own: Array, other: Body) -> tuple[NDArray[np.int64], Array]:
    """Node to node, or, where their numbers differ, along the line through the nodes of an edge."""
    found = select_nodes(at, other.nodes, other.kind)
    if len(found) == len(own):
        return found[:, None], np.ones((len(own), 1))
    if len(found) < 2 or len(own) < 2 or not _is_line(found):
        problem = f"is {len(found)} nodes for {len(own)} attached ones"
        raise InputError(Mistake("at", at, problem, 'Name as many nodes, the nodes of an edge, or "nearest".'))
    along = _lengths(own)
    line = _lengths(other.placed_positions()[tuple(found.T)])
    after = np.clip(np.searchsorted(line, along, side="right"), 1, len(line) - 1)
    share = np.clip((along - line[after - 1]) / (line[after] - line[after - 1]), 0.0, 1.0)
    return np.stack([found[after - 1], found[after]], axis=1), np.stack([1.0 - share, share], axis=1)


def _is_line(nodes: NDArray[np.int64]) -> bool:
    """Whether neighbours in a list are neighbours in the grid."""
    return bool((np.abs(np.diff(nodes, axis=0)).sum(axis=1) == 1).all())


def _lengths(points: Array) -> Array:
    """How far along a line its points lie, from 0 to 1."""
    reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return np.asarray(reached / reached[-1])


def _nearest(own: Array, other: Body, itself: NDArray[np.int64] | None) -> tuple[NDArray[np.int64], Array]:
    """The nearest points of the other body, by Gauss-Newton in its parameters from the nearest nodes on."""
    positions = other.placed_positions()
    grid = other.shape.grid
    flat = positions.reshape(-1, 3)
    index = np.stack(np.unravel_index(np.arange(len(flat)), other.nodes), axis=-1)
    places = np.zeros((len(own), len(other.nodes)))
    for k, point in enumerate(own):
        distance = np.sum((flat - point) ** 2, axis=1)
        if itself is not None:
            distance[np.all(index == itself[k], axis=1)] = np.inf
        places[k] = index[int(np.argmin(distance))]
    if itself is None:
        for _ in range(8):
            places = _improved(places, own, positions, grid.cells, grid.dimension, other)
    return _cell_weights(places, other)


def _improved(places: Array, own: Array, positions: Array, cells: Sequence[int], dimension: int, other: Body) -> Array:
    """One Gauss-Newton step of the places of the nearest points, kept within the grid."""

    def at(where: Array) -> Array:
        points, weights = _cell_weights(where, other)
        return np.asarray(np.einsum("km,kmc->kc", weights, positions[tuple(np.moveaxis(points, -1, 0))]))

    here, step = at(places), 1e-6
    slopes = []
    limit = np.array(cells, dtype=np.float64)
    for axis in range(dimension):
        ahead = places.copy()
        sign = np.where(places[:, axis] + step > limit[axis], -1.0, 1.0)
        ahead[:, axis] += sign * step
        slopes.append((at(ahead) - here) / (sign * step)[:, None])
    J = np.stack(slopes, axis=-1)
    normal = np.einsum("kci,kcj->kij", J, J) + 1e-12 * np.eye(dimension)
    change = np.linalg.solve(normal, np.einsum("kci,kc->ki", J, own - here)[..., None])[..., 0]
    better = places.copy()
    better[:, :dimension] = np.clip(places[:, :dimension] + np.clip(change, -1.0, 1.0), 0.0, limit[:dimension])
    return better


def _spacing(body: Body) -> float:
    """Shortest distance of neighbours along the first axis, as the body starts [m]."""
    return float(np.linalg.norm(np.diff(body.placed_positions(), axis=0), axis=-1).min())
