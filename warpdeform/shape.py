"""Rest shapes of surfaces: where the nodes of a body lie when nothing pulls at it (design 1.3).

A rest shape is a grid of points. Every shape a scene file can name is one function of `SHAPES`.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpdeform.errors import InputError, Mistake, shown

SurfaceMap = Callable[[NDArray[np.float64], NDArray[np.float64]], ArrayLike]
"""Positions, shape (nu, nv, 3), of the parameters u and v, each of shape (nu, nv)."""

COINCIDENT = 1e-6
"""Neighbouring nodes nearer than this part of the longest edge count as one point."""


@dataclass(frozen=True, eq=False)
class RestShape:
    """A grid of rest positions.

    Attributes:
        positions: Rest positions [m], shape (nu, nv, 3), read-only.
        spacing: Parameter spacings (h1, h2); metres for the shapes of `SHAPES`.

    Raises:
        InputError: A wrong array shape, fewer than 2 x 2 nodes, a non-finite position, coincident neighbours or a cell
            without area; with the index of the first node that shows it.
    """

    positions: NDArray[np.float64]
    spacing: tuple[float, float]

    def __post_init__(self) -> None:
        positions = np.array(self.positions, dtype=np.float64)
        positions.setflags(write=False)
        if mistakes := _array_mistakes(positions) or _geometry_mistakes(positions):
            raise InputError(mistakes)
        spacing = _positive("spacing", self.spacing, 2, "Use two parameter lengths, for example [0.01, 0.01].")
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "spacing", tuple(spacing))

    @property
    def nodes(self) -> tuple[int, int]:
        """Nodes along u and v."""
        return (self.positions.shape[0], self.positions.shape[1])


def from_map(function: SurfaceMap, nodes: Sequence[int], extent: Sequence[Sequence[float]]) -> RestShape:
    """Sample an analytic map at the nodes.

    Args:
        function: Map from arrays u, v of shape (nu, nv) to positions [m] of shape (nu, nv, 3).
        nodes: Nodes along u and v, each at least 2.
        extent: ((u0, u1), (v0, v1)): parameters of the first and last node.

    Raises:
        InputError: See `RestShape`; also for bad `nodes` and an `extent` that is empty or not finite.
    """
    nu, nv = checked_nodes(nodes)
    bounds = np.array(extent, dtype=np.float64)
    lengths = np.diff(bounds, axis=-1).ravel()
    if bounds.shape != (2, 2) or not np.isfinite(bounds).all() or not (lengths > 0).all():
        raise InputError(Mistake("extent", extent, "must be two growing ranges", "Use for example [[0, 1], [0, 1]]."))
    axes = [np.linspace(first, last, count) for (first, last), count in zip(bounds, (nu, nv), strict=True)]
    u, v = np.meshgrid(*axes, indexing="ij")
    positions = np.asarray(function(u, v), dtype=np.float64)
    if positions.shape != (nu, nv, 3):
        problem, remedy = "is not the shape that the map must return", f"Return an array of shape ({nu}, {nv}, 3)."
        raise InputError(Mistake("function", positions.shape, problem, remedy))
    return RestShape(positions, (lengths[0] / (nu - 1), lengths[1] / (nv - 1)))


def from_array(positions: ArrayLike, spacing: tuple[float, float] | None = None) -> RestShape:
    """Take the rest positions as they are.

    Args:
        positions: Rest positions [m], shape (nu, nv, 3).
        spacing: Parameter spacings; None takes the mean edge lengths, so that parameters are about metres.

    Raises:
        InputError: See `RestShape`.
    """
    array = np.asarray(positions, dtype=np.float64)
    if mistakes := _array_mistakes(array):
        raise InputError(mistakes)
    if spacing is None:
        h1, h2 = (float(np.linalg.norm(np.diff(array, axis=axis), axis=-1).mean()) for axis in (0, 1))
        spacing = (h1 or 1.0, h2 or 1.0)
    return RestShape(array, spacing)


def sheet(nodes: Sequence[int], size: Sequence[float] = (1.0, 1.0)) -> RestShape:
    """Flat sheet from (0, 0, 0) to (size[0], size[1], 0), u along x and v along y.

    Args:
        nodes: Nodes along u and v, each at least 2.
        size: Lengths along u and v [m].

    Raises:
        InputError: Bad `nodes` or `size`.
    """
    lengths = _positive("size", size, 2, "Use two lengths in m, for example [1.0, 1.0].")
    return from_map(lambda u, v: np.stack([u, v, 0.0 * u], axis=-1), nodes, ((0.0, lengths[0]), (0.0, lengths[1])))


def arc(nodes: Sequence[int], radius: float = 1.0, angle: float = 90.0, length: float = 1.0) -> RestShape:
    """Open patch of a cylinder about the y direction: an arch whose crown runs along the y axis, bulging upwards.

    Args:
        nodes: Nodes along u (the arc) and v (the axis), each at least 2.
        radius: Radius [m].
        angle: Opening angle [degrees], less than 360.
        length: Length along the axis [m].

    Raises:
        InputError: Bad `nodes` or sizes.
    """
    r = _positive("radius", radius, 1, "Use a length in m, for example 1.0.")[0]
    width = _positive("length", length, 1, "Use a length in m, for example 1.0.")[0]
    degrees = _positive("angle", angle, 1, "Use degrees, more than 0 and less than 360.")[0]
    if degrees >= 360.0:
        problem = "closes the arch, whose ends must stay apart"
        raise InputError(Mistake("angle", angle, problem, "Use degrees, more than 0 and less than 360."))
    half = 0.5 * r * math.radians(degrees)

    def arch(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([r * np.sin(u / r), v, r * np.cos(u / r) - r], axis=-1)

    return from_map(arch, nodes, ((-half, half), (0.0, width)))


def from_file(path: str | Path, nodes: Sequence[int] | None = None) -> RestShape:
    """Read rest positions [m] from a file.

    Args:
        path: A .npy array, an .npz with an array "positions", or a .csv with the columns x, y, z (a header line may
            stand above them) and one line per node, v running fastest.
        nodes: Nodes along u and v; needed where the array is a list of nu * nv points, else checked if given.

    Raises:
        InputError: A missing, unreadable or misshapen file; see also `RestShape`.
    """
    array = _read_array(Path(path))
    if nodes is not None:
        nu, nv = checked_nodes(nodes)
        if array.shape == (nu * nv, 3):
            array = array.reshape(nu, nv, 3)
        elif array.shape != (nu, nv, 3):
            problem = f"holds an array of shape {array.shape}, which is not {nu} x {nv} nodes"
            raise InputError(Mistake("path", str(path), problem, f"Give {nu * nv} points, or other nodes."))
    elif array.ndim == 2:
        raise InputError(Mistake("nodes", None, f"is missing for the {len(array)} points of {path}", NODES_REMEDY))
    return from_array(array)


SHAPES: Mapping[str, Callable[..., RestShape]] = {"sheet": sheet, "arc": arc, "file": from_file}
"""Rest shapes that a scene file names with `kind`; the other keys of the shape are keyword arguments beside `nodes`."""

NODES_REMEDY = "Use two whole numbers of at least 2, for example [64, 64]."


def checked_nodes(nodes: Any) -> tuple[int, int]:
    """Nodes along u and v as two ints of at least 2.

    Raises:
        InputError: Anything else.
    """
    counts = list(nodes) if isinstance(nodes, Iterable) and not isinstance(nodes, str) else [nodes]
    if any(isinstance(n, bool) or not hasattr(n, "__index__") for n in counts) or len(counts) != 2:
        raise InputError(Mistake("nodes", nodes, "must be two whole numbers", NODES_REMEDY))
    if min(counts) < 2:
        raise InputError(Mistake("nodes", nodes, "must be at least 2 along u and v: a surface has cells", NODES_REMEDY))
    return int(counts[0]), int(counts[1])


def _positive(key: str, value: Any, count: int, remedy: str) -> list[float]:
    """`count` positive finite numbers."""
    items = list(value) if isinstance(value, Iterable) and not isinstance(value, str) else [value]
    if len(items) != count or any(isinstance(x, bool | str) or not hasattr(x, "__float__") for x in items):
        problem = "must be a number" if count == 1 else f"must be {count} numbers"
        raise InputError(Mistake(key, value, problem, remedy))
    numbers = [float(x) for x in items]
    if not all(math.isfinite(x) and x > 0 for x in numbers):
        raise InputError(Mistake(key, value, "must be positive and finite", remedy))
    return numbers


def _read_array(path: Path) -> NDArray[np.float64]:
    formats = "Use a .npy, .npz or .csv file of positions."
    if path.suffix not in (".npy", ".npz", ".csv"):
        raise InputError(Mistake("path", str(path), f'has the unknown suffix "{path.suffix}"', formats))
    try:
        if path.suffix == ".csv":
            table = np.genfromtxt(path, delimiter=",", dtype=np.float64, comments="#", ndmin=2)
            return table[1:] if np.isnan(table[0]).all() else table
        loaded = np.load(path, allow_pickle=False)
        return np.asarray(loaded["positions"] if path.suffix == ".npz" else loaded, dtype=np.float64)
    except FileNotFoundError:
        raise InputError(Mistake("path", str(path), "does not exist", "Check the path.")) from None
    except KeyError:
        raise InputError(Mistake("path", str(path), 'has no array "positions"', 'Save it as "positions".')) from None
    except (OSError, ValueError, EOFError, BadZipFile) as error:
        cause = shown(error)
        raise InputError(Mistake("path", str(path), f"cannot be read ({cause})", formats)) from None


def _array_mistakes(positions: NDArray[np.float64]) -> list[Mistake]:
    shape = positions.shape
    if len(shape) != 3 or shape[2] != 3 or min(shape[:2]) < 2:
        remedy = "Give positions of shape (nu, nv, 3) with at least 2 x 2 nodes."
        return [Mistake("positions", shape, "is not the shape of a surface grid", remedy)]
    finite = np.isfinite(positions).all(axis=-1)
    if not finite.all():
        node = _first(~finite)
        return [Mistake("positions", positions[node], f"is not finite at node {list(node)}", "Give finite metres.")]
    return []


def _geometry_mistakes(positions: NDArray[np.float64]) -> list[Mistake]:
    edges = [np.linalg.norm(np.diff(positions, axis=axis), axis=-1) for axis in (0, 1)]
    limit = COINCIDENT * max(edge.max() for edge in edges)
    for edge, step in zip(edges, ((1, 0), (0, 1)), strict=True):
        if edge.min() <= limit:
            node = _first(edge <= limit)
            problem = f"coincides at nodes {list(node)} and {[node[0] + step[0], node[1] + step[1]]}"
            return [Mistake("positions", positions[node], problem, "Move the nodes apart.")]
    m1, m2 = (positions[1:, 1:] - positions[:-1, :-1], positions[1:, :-1] - positions[:-1, 1:])
    area = 0.5 * np.linalg.norm(np.cross(m1, m2), axis=-1)
    if area.min() <= limit**2:
        node = _first(area <= limit**2)
        problem = f"leaves the cell at node {list(node)} without area"
        return [Mistake("positions", positions[node], problem, "Spread its four nodes over a surface.")]
    return []


def _first(mask: NDArray[np.bool_] | np.bool_) -> tuple[int, ...]:
    """Index of the first true element."""
    return tuple(int(i) for i in np.argwhere(mask)[0])
