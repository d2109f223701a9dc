"""Rest shapes: where the nodes of a body lie when nothing pulls at it (design 1.3), from maps, arrays and files."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpdeform.array_file import TABLES, read_array
from warpdeform.errors import InputError, Mistake
from warpdeform.grid import ParameterGrid
from warpdeform.shape.checks import array_mistakes, geometry_mistakes, pole_mistakes
from warpdeform.shape.numbers import KINDS, checked_nodes, positive

Array = NDArray[np.float64]

RestMap = Callable[..., ArrayLike]
"""Positions, shape (*nodes, 3), of the parameters: arrays u; u and v; or u, v and w, each of shape (*nodes)."""


@dataclass(frozen=True, eq=False)
class RestShape:
    """A grid of rest positions.

    Attributes:
        positions: Rest positions [m], read-only: (n, strands, 3) of curves, where one strand may be given as (n, 3);
            (nu, nv, 3) of surfaces; (nu, nv, nw, 3) of solids.
        spacing: Parameter spacings along the axes; metres for the shapes of `SHAPES`. Along the strands of curves,
            which nothing connects, it is 1 and may be left out.
        periodic: Axes that close: the node behind the last one is the first one. Left out: none.
        kind: "curve", "surface" or "solid"; left out: as many axes as `positions` has.
        poles: Whether the start and the end of the open axis of a surface close at a pole. The other axis is periodic
            with an even number of nodes; the nodes beside the pole lie half a step from it, so that the step to the
            node on the other side is a whole one. No node lies in the pole. Left out: both ends are open.

    Raises:
        InputError: A wrong array shape, too few nodes, a non-finite position, coincident neighbours, nodes in a pole,
            poles that do not close, cells without area or volume, a closed shape that touches itself; with the index
            of the first node that shows it.
    """

    positions: Array
    spacing: tuple[float, ...]
    periodic: tuple[bool, ...] = ()
    kind: str = ""
    poles: tuple[bool, ...] = ()

    def __post_init__(self) -> None:
        positions = np.array(self.positions, dtype=np.float64)
        kind = self.kind or KINDS[min(max(positions.ndim - 2, 0), 2)]
        if kind not in KINDS:
            raise InputError(Mistake("kind", kind, "is no kind of body", f"Use one of {', '.join(KINDS)}."))
        dimension = KINDS.index(kind) + 1
        if kind == "curve" and positions.ndim == 2:
            positions = positions[:, None]
        positions.setflags(write=False)
        periodic, spacing = tuple(map(bool, self.periodic)) or (False,) * dimension, self.spacing
        if kind == "curve":
            periodic, spacing = (periodic[0], False), (*np.ravel(spacing)[:1], 1.0)
        if mistakes := array_mistakes(positions, kind, periodic):
            raise InputError(mistakes)
        example = ", ".join(["0.01"] * dimension)
        lengths = positive("spacing", spacing, len(periodic), f"Use parameter lengths, for example [{example}].")
        poles = tuple(map(bool, self.poles)) or (False, False)
        for name, value in (("positions", positions), ("spacing", tuple(lengths)), ("periodic", periodic)):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "kind", kind)
        object.__setattr__(self, "poles", poles)
        if mistakes := pole_mistakes(kind, positions.shape[:-1], periodic, poles):
            raise InputError(mistakes)
        if mistakes := geometry_mistakes(positions, self.grid):
            raise InputError(mistakes)

    @property
    def nodes(self) -> tuple[int, ...]:
        """Nodes along the axes; of curves, nodes of a strand and strands."""
        return self.positions.shape[:-1]

    @property
    def dimension(self) -> int:
        """Axes along which nodes are connected."""
        return KINDS.index(self.kind) + 1

    @property
    def grid(self) -> ParameterGrid:
        """The parameter grid."""
        start, end = self.poles
        return ParameterGrid(self.nodes, self.spacing, self.periodic, self.dimension, (start, end))


def from_map(
    function: RestMap,
    nodes: Sequence[int],
    extent: Sequence[Sequence[float]],
    periodic: Sequence[bool] = (),
    poles: Sequence[bool] = (),
) -> RestShape:
    """Sample an analytic map at the nodes: a curve, a surface or a solid, by the number of its parameters.

    Args:
        function: Map from arrays u; u, v; or u, v, w, each of shape (*nodes), to positions [m] of shape (*nodes, 3).
        nodes: Nodes along each axis, each at least 2, at least 3 where it is periodic.
        extent: ((u0, u1), ...): parameters of the first and last node; of a periodic axis, of the first node and where
            it comes again.
        periodic: Axes that close; left out: none.
        poles: Whether the start and the end of the open axis close at a pole, see `RestShape`; left out: none.

    Raises:
        InputError: See `RestShape`; also for bad `nodes` and an `extent` that is empty or not finite.
    """
    dimension = len(nodes) if isinstance(nodes, Sequence) and 1 <= len(nodes) <= 3 else 2
    closes = tuple(periodic) or (False,) * dimension
    counts = checked_nodes(nodes, KINDS[dimension - 1], closes)
    bounds = np.array(extent, dtype=np.float64)
    lengths = np.diff(bounds, axis=-1).ravel()
    if bounds.shape != (dimension, 2) or not np.isfinite(bounds).all() or not (lengths > 0).all():
        problem = "must be a growing range for each axis"
        raise InputError(Mistake("extent", extent, problem, f"Use for example {[[0, 1]] * dimension}."))
    ranges = zip(bounds, counts, closes, strict=True)
    axes = [np.linspace(first, last, count, endpoint=not closed) for (first, last), count, closed in ranges]
    positions = np.asarray(function(*np.meshgrid(*axes, indexing="ij")), dtype=np.float64)
    if positions.shape != (*counts, 3):
        problem, remedy = "is not the shape that the map must return", f"Return an array of shape {(*counts, 3)}."
        raise InputError(Mistake("function", positions.shape, problem, remedy))
    cells = [count if closed else count - 1 for count, closed in zip(counts, closes, strict=True)]
    return RestShape(positions, tuple(lengths / cells), closes, poles=tuple(poles))


def from_array(
    positions: ArrayLike,
    spacing: tuple[float, ...] | None = None,
    periodic: Sequence[bool] = (),
    kind: str = "",
    poles: Sequence[bool] = (),
) -> RestShape:
    """Take the rest positions as they are.

    Args:
        positions: Rest positions [m], of a shape as in `RestShape`.
        spacing: Parameter spacings; None takes the mean edge lengths, so that parameters are about metres.
        periodic: Axes that close; left out: none.
        kind: "curve", "surface" or "solid"; left out: as many axes as `positions` has.
        poles: Whether the start and the end of the open axis close at a pole, see `RestShape`; left out: none.

    Raises:
        InputError: See `RestShape`.
    """
    array = np.asarray(positions, dtype=np.float64)
    if spacing is None:
        measured = RestShape(array, (1.0,) * max(array.ndim - 1, 1), tuple(periodic), kind, tuple(poles))
        grid, array = measured.grid, measured.positions
        lengths = [np.linalg.norm(grid.differences(array, axis), axis=-1).mean() for axis in range(grid.dimension)]
        spacing, kind = tuple(float(length) for length in lengths), measured.kind
    return RestShape(array, spacing, tuple(periodic), kind, tuple(poles))


def from_file(
    path: str | Path,
    nodes: Sequence[int] | None = None,
    periodic: Sequence[bool] = (),
    kind: str = "",
    poles: Sequence[bool] = (),
) -> RestShape:
    """Read rest positions [m] from a file.

    Args:
        path: A .npy array, an .npz with an array "positions", or a .csv with the columns x, y, z (a header line may
            stand above them) and one line per node, the last axis running fastest.
        nodes: Nodes along the axes (of curves: nodes of a strand, or those and strands); needed where the array is a
            list of points, else checked if given.
        periodic: Axes that close; left out: none.
        kind: "curve", "surface" or "solid"; left out: as many axes as `nodes` has, or the array.
        poles: Whether the start and the end of the open axis close at a pole, see `RestShape`; left out: none.

    Raises:
        InputError: A missing, unreadable or misshapen file; see also `RestShape`.
    """
    array = read_positions(Path(path))
    if nodes is not None:
        listed = list(nodes) if isinstance(nodes, Iterable) and not isinstance(nodes, str) else [nodes]
        kind = kind or KINDS[min(max(len(listed), 1), 3) - 1]
        strands = listed[1:] if kind == "curve" else []
        counts = (*checked_nodes(listed[:1] if strands else listed, kind, periodic), *strands)
        total = int(np.prod(counts))
        if array.shape not in ((total, 3), (*counts, 3)):
            problem = f"holds an array of shape {array.shape}, which is not {' x '.join(map(str, counts))} nodes"
            raise InputError(Mistake("path", str(path), problem, f"Give {total} points, or other nodes."))
        array = array.reshape(*counts, 3)
    elif array.ndim == 2 and kind != "curve":
        remedy = "Use one whole number for each axis, for example [64, 64]."
        raise InputError(Mistake("nodes", None, f"is missing for the {len(array)} points of {path}", remedy))
    return from_array(array, periodic=periodic, kind=kind, poles=poles)


def read_positions(path: Path) -> Array:
    """The array of a .npy, .npz or .csv file, whatever its shape.

    Raises:
        InputError: A missing or unreadable file.
    """
    return read_array(path, "path", "positions", f"Use a {', '.join(TABLES[:-1])} or {TABLES[-1]} file of positions.")
