"""What every kind of body is to a USD file: a description that defines prims, and the samples of those prims."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from warpdeform.errors import InputError, Mistake

if TYPE_CHECKING:
    from pxr import Sdf

    from warpdeform.usd.stage import StageUnits, StaticStage

Vectors = NDArray[np.float32]


class BodySamples(Protocol):
    """The sampled attributes of one body's prims."""

    def sample(self, points: Vectors, velocities: Vectors) -> Mapping[Sdf.Path, Vectors]:
        """One sample of each of them.

        Args:
            points: Node positions in units of the file, contiguous, shape (*nodes, 3).
            velocities: Node velocities in units per second, same shape.

        Returns:
            Vectors by attribute, each of shape (k, 3).
        """


@dataclass(frozen=True, eq=False)
class BodyDescription(ABC):
    """A body as it appears in a USD file.

    Attributes:
        name: Name of the body; the prim's name follows it.
        nodes: Nodes along each axis: samples have the shape (*nodes, 3).
        color: Diffuse colour, linear RGB, each 0 to 1.
        roughness: Roughness of the material, 0 (mirror) to 1 (matt).
    """

    name: str
    nodes: tuple[int, ...]
    color: tuple[float, float, float] = field(default=(0.55, 0.13, 0.1), kw_only=True)
    roughness: float = field(default=0.7, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", tuple(int(n) for n in self.nodes))
        object.__setattr__(self, "color", tuple(float(c) for c in self.color))
        mistakes = self.mistakes()
        if len(self.color) != 3 or not np.all(np.isfinite(self.color)) or min(self.color) < 0.0:
            mistakes.append(Mistake("color", self.color, "is not a colour", "Use three numbers from 0 to 1."))
        if not 0.0 <= self.roughness <= 1.0:
            mistakes.append(Mistake("roughness", self.roughness, "is outside 0 to 1", "Use 0 (mirror) to 1 (matt)."))
        if mistakes:
            raise InputError(mistakes)

    @abstractmethod
    def mistakes(self) -> list[Mistake]:
        """What is wrong with the description of this kind."""

    @abstractmethod
    def define(self, static: StaticStage, units: StageUnits) -> BodySamples:
        """Define the prims with all that does not change.

        Args:
            static: The stage to define them in.
            units: Its units.
        """

    def outward(self, positions: NDArray[np.floating]) -> Self:
        """This description, with its faces turned to look out of the body at these positions, shape (*nodes, 3)."""
        return self


def grid_mistakes(kind: str, nodes: tuple[int, ...], periodic: tuple[bool, ...], dimension: int) -> list[Mistake]:
    """What is wrong with the grid of a surface or solid, which must have cells along each of its axes."""
    if len(periodic) != dimension:
        remedy = f"Use {dimension} of true and false."
        return [Mistake("periodic", periodic, f"must say for {dimension} axes whether they wrap", remedy)]
    if len(nodes) != dimension or any(n < (3 if wraps else 2) for n, wraps in zip(nodes, periodic, strict=True)):
        problem = f"a {kind} needs at least 2 nodes along each of {dimension} axes, 3 along a periodic one"
        return [Mistake("nodes", nodes, problem, f"Use {[2] * dimension} or more.")]
    return []
