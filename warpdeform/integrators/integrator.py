"""The face of an implicit method: how a stage of its step is made out of the history (design 6.1)."""

from dataclasses import dataclass
from typing import ClassVar

Weights = tuple[float, float, float]
"""Weights of (x - x_before), v and v_before [1, s, s] in a stage vector that starts from x."""


@dataclass(frozen=True)
class Stage:
    """One stage problem M (z - y)/tau^2 + grad E(z) - f = 0, with stage velocity (z - w)/tau.

    Every vector is x plus weighted differences, never a weighted sum of positions: so float32 keeps its digits far from
    the origin.

    Attributes:
        tau: Stage step [s].
        w: Base of the stage velocity.
        y: Where inertia alone would lead.
        start: The predictor, where Newton starts if its potential is no higher than at x.
    """

    tau: float
    w: Weights
    y: Weights
    start: Weights


class Integrator:
    """An implicit method for M x'' + C x' + grad E = f."""

    name: ClassVar[str]
    order: ClassVar[int]

    def stage(self, dt: float, dt_before: float | None) -> Stage:
        """The stage of a step.

        Args:
            dt: The step [s].
            dt_before: The step before it [s]; None after a start or a disturbance, where history does not count.
        """
        raise NotImplementedError
