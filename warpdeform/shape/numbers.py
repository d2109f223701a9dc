"""Numbers that rest shapes are given: node counts and sizes."""

import math
from collections.abc import Iterable, Sequence
from typing import Any

from warpdeform.errors import InputError, Mistake

KINDS = ("curve", "surface", "solid")
"""Kinds of bodies; their nodes are connected along one, two and three axes."""
AXES = "uvw"
"""Names of the axes."""
FEWEST_PERIODIC = 3
"""Nodes along a periodic axis: with fewer, both neighbours of a node are one."""

_COUNTED = ("one whole number", "two whole numbers", "three whole numbers")
_NEEDS = (
    "must be at least 2: a strand of one node has no length",
    "must be at least 2 along u and v: a surface has cells",
    "must be at least 2 along u, v and w: a solid has cells",
)
_EXAMPLES = ("[32]", "[64, 64]", "[16, 16, 16]")


def checked_nodes(nodes: Any, kind: str = "surface", periodic: Sequence[bool] = ()) -> tuple[int, ...]:
    """Nodes along the connected axes of a kind of body as ints: each at least 2, and 3 where the axis is periodic.

    Raises:
        InputError: Anything else.
    """
    which = KINDS.index(kind)
    remedy = f"Use {_COUNTED[which]} of at least 2, for example {_EXAMPLES[which]}."
    counts = list(nodes) if isinstance(nodes, Iterable) and not isinstance(nodes, str) else [nodes]
    if any(isinstance(n, bool) or not hasattr(n, "__index__") for n in counts) or len(counts) != which + 1:
        raise InputError(Mistake("nodes", nodes, f"must be {_COUNTED[which]}", remedy))
    if min(counts) < 2:
        raise InputError(Mistake("nodes", nodes, _NEEDS[which], remedy))
    for axis, (count, closed) in enumerate(zip(counts, periodic or (False,) * len(counts), strict=True)):
        if closed and count < FEWEST_PERIODIC:
            problem = f"must be at least {FEWEST_PERIODIC} along {AXES[axis]}, which is periodic"
            raise InputError(Mistake("nodes", nodes, problem, f"Use for example {_EXAMPLES[which]}."))
    return tuple(int(n) for n in counts)


def positive(key: str, value: Any, count: int, remedy: str) -> list[float]:
    """`count` positive finite numbers.

    Raises:
        InputError: Anything else.
    """
    found = numbers(key, value, count, remedy)
    if not all(x > 0 for x in found):
        raise InputError(Mistake(key, value, "must be positive and finite", remedy))
    return found


def numbers(key: str, value: Any, count: int, remedy: str) -> list[float]:
    """`count` finite numbers.

    Raises:
        InputError: Anything else.
    """
    items = list(value) if isinstance(value, Iterable) and not isinstance(value, str) else [value]
    if len(items) != count or any(isinstance(x, bool | str) or not hasattr(x, "__float__") for x in items):
        problem = "must be a number" if count == 1 else f"must be {count} numbers"
        raise InputError(Mistake(key, value, problem, remedy))
    found = [float(x) for x in items]
    if not all(math.isfinite(x) for x in found):
        raise InputError(Mistake(key, value, "must be finite", remedy))
    return found


def degrees(key: str, value: Any, most: float, remedy: str) -> float:
    """An angle of more than 0 and less than `most` degrees.

    Raises:
        InputError: Anything else.
    """
    angle = positive(key, value, 1, remedy)[0]
    if angle >= most:
        raise InputError(Mistake(key, value, f"must be less than {most:g}, so that the ends stay apart", remedy))
    return angle
