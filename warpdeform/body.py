"""A body as the user describes it: rest shape, material, where it starts and what holds it."""

import math
import operator
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpdeform.errors import InputError, Mistake
from warpdeform.material import Material
from warpdeform.shape import RestShape

if TYPE_CHECKING:
    from warpdeform.track import Track

NodeSelector = str | Sequence[Sequence[int]]
"""Which nodes: "corner:0,1" (start or end of u, of v), "edge:u,0" (the row u = start), "edge:v,1,2" (the last two rows
of v: a clamp), "all", or a list of index pairs [[i, j], ...]."""

_CORNER = re.compile(r"corner:([01]),([01])")
_EDGE = re.compile(r"edge:([uv]),([01])(?:,(\d+))?")
_SELECTOR_REMEDY = 'Use "corner:0,1", "edge:u,0", "edge:v,1,2" (two rows), "all" or index pairs [[i, j], ...].'


def select_nodes(selector: NodeSelector, nodes: tuple[int, int]) -> NDArray[np.int64]:
    """Index pairs of the selected nodes.

    Args:
        selector: See `NodeSelector`.
        nodes: Nodes of the grid along u and v.

    Returns:
        Index pairs, shape (k, 2).

    Raises:
        InputError: An unknown selector, or a node outside the grid.
    """
    index = np.stack(np.meshgrid(np.arange(nodes[0]), np.arange(nodes[1]), indexing="ij"), axis=-1)
    if not isinstance(selector, str):
        return _listed_nodes(selector, nodes)
    if selector == "all":
        return index.reshape(-1, 2)
    if corner := _CORNER.fullmatch(selector):
        end = [int(corner[k]) for k in (1, 2)]
        return np.array([[end[0] * (nodes[0] - 1), end[1] * (nodes[1] - 1)]])
    if edge := _EDGE.fullmatch(selector):
        axis, last, count = "uv".index(edge[1]), edge[2] == "1", int(edge[3] or 1)
        if not 1 <= count <= nodes[axis]:
            raise InputError(
                Mistake("nodes", selector, f"asks for {count} rows of {nodes[axis]}", f"Use 1 to {nodes[axis]} rows.")
            )
        rows = np.arange(nodes[axis])[-count:] if last else np.arange(count)
        return np.take(index, rows, axis=axis).reshape(-1, 2)
    raise InputError(Mistake("nodes", selector, "is not a node selector", _SELECTOR_REMEDY))


def _listed_nodes(selector: Sequence[Sequence[int]], nodes: tuple[int, int]) -> NDArray[np.int64]:
    try:
        pairs = np.array([[operator.index(i), operator.index(j)] for i, j in selector], dtype=np.int64).reshape(-1, 2)
    except (TypeError, ValueError):
        raise InputError(Mistake("nodes", selector, "is not a list of index pairs", _SELECTOR_REMEDY)) from None
    outside = np.any((pairs < 0) | (pairs >= np.array(nodes)), axis=1)
    if outside.any():
        limit = f"[0, 0] to [{nodes[0] - 1}, {nodes[1] - 1}]"
        raise InputError(
            Mistake("nodes", pairs[outside][0].tolist(), "lies outside the grid", f"Use indices from {limit}.")
        )
    return pairs


@dataclass(frozen=True)
class Pin:
    """Nodes that are held, or led along a track.

    Attributes:
        nodes: Which nodes, see `NodeSelector`.
        track: Rigid motion of the held nodes relative to their initial positions; None holds them still.
    """

    nodes: NodeSelector
    track: "Track | None" = None


@dataclass(frozen=True)
class Spring:
    """Zero-length springs from nodes to one point (the paper's spring force k (p - r)).

    Attributes:
        nodes: Which nodes, see `NodeSelector`.
        stiffness: Stiffness of each node's spring [N/m].
        point: World point [m]; None ties each node to its own initial position.
        track: Rigid motion of the points; None leaves them still.
    """

    nodes: NodeSelector
    stiffness: float
    point: tuple[float, float, float] | None = None
    track: "Track | None" = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.stiffness) and self.stiffness > 0):
            raise InputError(Mistake("stiffness", self.stiffness, "must be positive [N/m]", "Use for example 100."))


@dataclass(frozen=True)
class Body:
    """A deformable surface.

    Attributes:
        name: Name in files and messages.
        shape: Rest shape; its metric and curvature tensors are what the body wants to be.
        material: What it is made of.
        position: Translation of the initial state from the rest shape [m].
        rotation: Rotation of the initial state about the rest shape's origin, quaternion (x, y, z, w).
        velocity: Initial velocity [m/s].
        initial_positions: Initial node positions [m], shape (nu, nv, 3), if they are not the placed rest shape.
        pins: Held or led nodes.
        springs: Springs from nodes to points.
        drag: Mass-proportional damping [1/s] beside the material's own.
        wind_coefficient: c of the viscous force c (n . v) n [kg/(m2 s)].
        color: Display colour, linear RGB.
        roughness: Roughness of the preview surface, 0 to 1.
    """

    name: str
    shape: RestShape
    material: Material
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    initial_positions: NDArray[np.float64] | None = None
    pins: tuple[Pin, ...] = ()
    springs: tuple[Spring, ...] = ()
    drag: float = 0.0
    wind_coefficient: float = 2.0
    color: tuple[float, float, float] = (0.55, 0.13, 0.11)
    roughness: float = 0.7
    nodes: tuple[int, int] = field(init=False)

    def __post_init__(self) -> None:
        nodes = self.shape.positions.shape[:2]
        object.__setattr__(self, "nodes", nodes)
        mistakes = []
        for key in ("drag", "wind_coefficient"):
            value = getattr(self, key)
            if not (math.isfinite(value) and value >= 0):
                mistakes.append(Mistake(key, value, "must be a finite number, not negative", "Use 0 for none."))
        for key, length in (("position", 3), ("velocity", 3), ("rotation", 4)):
            value = getattr(self, key)
            if len(value) != length or not all(math.isfinite(x) for x in value):
                mistakes.append(Mistake(key, value, f"must be {length} finite numbers", "Leave it out for none."))
        if not any(self.rotation):
            mistakes.append(Mistake("rotation", self.rotation, "has length zero", "Use (0, 0, 0, 1) for none."))
        if self.initial_positions is not None and (
            self.initial_positions.shape != self.shape.positions.shape or not np.isfinite(self.initial_positions).all()
        ):
            shape = self.initial_positions.shape
            remedy = f"Give finite positions of shape {self.shape.positions.shape}."
            mistakes.append(Mistake("initial_positions", shape, "does not fit the grid or is not finite", remedy))
        selectors = {f"pins.{index}": pin.nodes for index, pin in enumerate(self.pins)}
        selectors |= {f"springs.{index}": spring.nodes for index, spring in enumerate(self.springs)}
        for key, selector in selectors.items():
            try:
                select_nodes(selector, nodes)
            except InputError as error:
                mistakes += [Mistake(key, m.value, m.problem, m.remedy) for m in error.mistakes]
        if mistakes:
            raise InputError(mistakes)

    def placed_positions(self) -> NDArray[np.float64]:
        """Initial node positions [m], shape (nu, nv, 3)."""
        if self.initial_positions is not None:
            return np.array(self.initial_positions, dtype=np.float64)
        return rotate(self.rotation, self.shape.positions) + np.asarray(self.position)


def rotate(quaternion: Sequence[float], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotate points, shape (..., 3), by a quaternion (x, y, z, w); the identity leaves every bit as it is."""
    if tuple(quaternion) == (0.0, 0.0, 0.0, 1.0):
        return np.array(points, dtype=np.float64)
    q = np.asarray(quaternion, dtype=np.float64)
    axis, w = q[:3] / np.linalg.norm(q), q[3] / np.linalg.norm(q)
    twice = 2.0 * np.cross(axis, points)
    return points + w * twice + np.cross(axis, twice)
