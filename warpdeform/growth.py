"""Rest shapes that change over time: bodies that grow, shrink and curl (paper: G0 and B0 as functions of time)."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpdeform.errors import InputError, Mistake
from warpdeform.grid import ParameterGrid
from warpdeform.varying import Varying

Array = NDArray[np.float64]

SMALLEST = 0.05
"""Smallest scale: curvature ends where a cell has a thousandth of its rest area."""
LARGEST = 20.0
"""Largest scale."""

CURVATURES: dict[str, tuple[tuple[int, ...], str, str]] = {
    "curve": (
        (0, 2, 3),
        "two curvatures and a twist",
        "Give two for each time, about directors 1 and 2, or three.",
    ),
    "surface": ((0, 2, 3), "two curvatures and a twist", "Give two for each time, along u and v, or three."),
    "solid": (
        (0,),
        "no natural curvature",
        "Leave it out; a scale whose share (where) varies across the thickness bends a solid.",
    ),
}
"""How many curvatures each kind of body may be given for each time, what they are, and what to do about others."""


@dataclass(frozen=True, eq=False)
class Growth:
    """How the rest shape of a body changes: linear between keyframes, constant before the first and after the last.

    What a body wants to be is said by its rest metric G0 and rest curvature B0. The metric grows by the square of
    `scale`: strains are those against s^2 G0, over a length, area or volume that has grown, too. Mass, thickness and
    sections stay. Lines keep the angles by which they turn, so that a shape grows into one like itself; `curvature`
    comes on top of that.

    Of a curve the rest lengths of its segments grow; curvatures bend it about director 1 and director 2, and a third
    one twists it, all of them for each length that it has grown to. Cells of a solid grow along their edges, and keep
    the angles between them; a solid has no curvature of its own, but bends where it grows on one side.

    Attributes:
        times: Times of the keyframes [s], increasing, shape (k,).
        scale: Factors of the rest lengths along each axis, shape (k, axes), or (k, 1) for all of them.
        curvature: Natural curvatures that are added [1/m], shape (k, n): of surfaces along u and v, and with a third
            one the twist; positive ones curl towards the normal r_u x r_v. Of curves about directors 1 and 2, and with
            a third one the twist per length, right-handed. (k, 0) for none.
        where: Share that a place takes in it, from 0 to 1; None is all of it everywhere.

    Raises:
        InputError: Times that do not increase, lists of different lengths, scales out of bounds.
    """

    times: Array
    scale: Array
    curvature: Array
    where: Varying | None

    def __init__(
        self,
        times: ArrayLike,
        scale: ArrayLike | None = None,
        curvature: ArrayLike | None = None,
        where: Varying | ArrayLike | None = None,
    ) -> None:
        """Check and keep the keyframes.

        Args:
            times: Times of the keyframes [s].
            scale: A factor for each time, or one for each axis; left out: 1.
            curvature: Natural curvatures for each time [1/m]; left out: none.
            where: Share of it: a `Varying`, an array per node or cell, or a function of the parameters.
        """
        mistakes: list[Mistake] = []
        t = _columns("times", times, None, "Give a list of times in seconds.", mistakes)
        count = len(t) if t is not None else None
        remedy = "Give a factor for each time, for example [1.0, 0.7], or one for each axis: [[1.0, 1.0], [0.7, 1.0]]."
        s = _columns("scale", np.ones(count or 1) if scale is None else scale, count, remedy, mistakes)
        remedy = "Give curvatures in 1/m for each time, for example [[0.0, 0.0], [5.0, 0.0]] along u and v."
        none = np.zeros((count or 1, 0))
        c = _columns("curvature", none if curvature is None else curvature, count, remedy, mistakes)
        if t is not None and (t.shape[1] != 1 or not (np.diff(t[:, 0]) > 0).all()):
            mistakes.append(Mistake("times", times, "must increase from keyframe to keyframe", "Sort the keyframes."))
        if s is not None and not ((s >= SMALLEST) & (s <= LARGEST)).all():
            problem = f"must lie between {SMALLEST:g} and {LARGEST:g}"
            mistakes.append(Mistake("scale", scale, problem, "Use factors of the rest lengths, for example 0.7."))
        share = where
        if where is not None and not isinstance(where, Varying):
            try:
                share = Varying(where)  # type: ignore[arg-type]
            except InputError as error:
                mistakes += [Mistake("where", m.value, m.problem, m.remedy) for m in error.mistakes]
        if isinstance(share, Varying) and share.bounds and not 0.0 <= share.bounds[0] <= share.bounds[1] <= 1.0:
            mistakes.append(_no_share(share))
        if mistakes or t is None or s is None or c is None:
            raise InputError(mistakes)
        for name, value in (("times", t[:, 0]), ("scale", s), ("curvature", c), ("where", share)):
            object.__setattr__(self, name, value)

    @property
    def varies(self) -> bool:
        """Places may take different shares in it."""
        return self.where is not None

    def mistakes(self, grid_axes: int, kind: str) -> list[Mistake]:
        """What does not go with a body of so many connected axes."""
        found = []
        factors, curvatures = self.scale.shape[1], self.curvature.shape[1]
        if factors not in (1, grid_axes):
            axes = f"{grid_axes} axes" if grid_axes > 1 else "one axis"
            problem = f"has {factors} factors for each time, where a {kind} has {axes}"
            remedy = "Give one factor for each time" + (f", or {grid_axes}." if grid_axes > 1 else ".")
            found.append(Mistake("scale", self.scale, problem, remedy))
        allowed, what, remedy = CURVATURES[kind]
        if curvatures not in allowed:
            problem = f"has {curvatures} numbers for each time, where a {kind} has {what}"
            found.append(Mistake("curvature", self.curvature, problem, remedy))
        return found

    def shares(self, grid: ParameterGrid) -> tuple[Array, Array]:
        """Shares of the cells, shape (*cells), and of the nodes, shape (*nodes), of a grid.

        Raises:
            InputError: `where` does not fit the grid, or is not from 0 to 1 somewhere on it.
        """
        if self.where is None:
            return np.ones(grid.cells), np.ones(grid.nodes)
        try:
            cells, nodes = self.where.at_cells(grid), self.where.at_nodes(grid)
        except InputError as error:
            raise InputError([replace(mistake, key="where") for mistake in error.mistakes]) from None
        if min(cells.min(), nodes.min()) < 0.0 or max(cells.max(), nodes.max()) > 1.0:
            raise InputError(_no_share(self.where))
        return cells, nodes

    def at(self, time: float, axes: int, curvatures: int) -> tuple[Array, Array]:
        """Scales along so many axes, and so many curvatures [1/m], at a time [s]."""

        def now(values: Array) -> Array:
            return np.array([np.interp(time, self.times, column) for column in values.T])

        scale, bent = np.ones(axes), np.zeros(curvatures)
        scale[:] = now(self.scale)
        bent[: self.curvature.shape[1]] = now(self.curvature)
        return scale, bent


def _no_share(where: Varying) -> Mistake:
    problem, remedy = "must be shares from 0 to 1", "Scale it to 0 (does not grow) to 1 (grows by all of it)."
    return Mistake("where", where.name or None, problem, remedy)


def _columns(key: str, values: ArrayLike, count: int | None, remedy: str, mistakes: list[Mistake]) -> Array | None:
    """Numbers for each keyframe, shape (k, n)."""
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.array(np.nan)
    array = array[:, None] if array.ndim == 1 else array
    if array.ndim != 2 or len(array) == 0 or not np.isfinite(array).all():
        problem = "does not have the right shape or holds numbers that are not finite"
        mistakes.append(Mistake(key, values, problem, remedy))
        return None
    if count is not None and len(array) != count:
        mistakes.append(Mistake(key, values, f"has {len(array)} entries for {count} times", remedy))
        return None
    array.setflags(write=False)
    return array
