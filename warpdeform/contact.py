"""Contact as the user describes it: which bodies feel each other, at what distance, with what friction."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from warpdeform.errors import InputError, Mistake
from warpdeform.obstacle import FieldConstants, field_constants

LARGEST_GAP = 0.25
"""Gap that is taken where none is given, at most: share of the smallest node spacing of the bodies."""
USUAL_GAP = 0.002
"""Gap that is taken where none is given, if the spacing allows it [m]."""


@dataclass(frozen=True)
class Contact:
    """Two bodies that feel each other, or one that feels itself.

    Attributes:
        bodies: Their names; twice the same for self-contact.
        friction: Coefficient of friction.
        gap: Distance of the skins at rest [m]; None takes 2 mm, or a quarter of the spacing where that is less.
        design_speed: Fastest normal speed that the field is to stop [m/s]; None estimates it.
    """

    bodies: tuple[str, str]
    friction: float = 0.0
    gap: float | None = None
    design_speed: float | None = None

    def __post_init__(self) -> None:
        mistakes = []

        def require(key: str, good: bool, problem: str, remedy: str) -> None:
            if not good:
                mistakes.append(Mistake(key, getattr(self, key), problem, remedy))

        require("bodies", len(self.bodies) == 2, "must be two names", "Name a body twice for self-contact.")
        object.__setattr__(self, "bodies", tuple(self.bodies))
        gap, speed = self.gap, self.design_speed
        require("friction", 0.0 <= self.friction <= 10.0, "must lie between 0 and 10", "Use for example 0.4.")
        require("gap", gap is None or 1e-6 <= gap <= 1.0, "must lie between 1e-6 and 1 m", "Use for example 0.002.")
        good_speed = speed is None or 0.0 < speed <= 1e4
        require("design_speed", good_speed, "must lie between 0 and 10000 m/s", "Leave it out to have it estimated.")
        if mistakes:
            raise InputError(mistakes)

    def constants(
        self, gravity: Sequence[float], spacing: float, expected_speed: float
    ) -> tuple[float, FieldConstants]:
        """Gap [m] and constants of the field.

        Args:
            gravity: Acceleration of gravity [m/s2].
            spacing: Smallest node spacing of both bodies [m].
            expected_speed: Fastest relative speed expected [m/s], used where `design_speed` is left out.
        """
        gap = self.gap if self.gap is not None else min(USUAL_GAP, LARGEST_GAP * spacing)
        speed = self.design_speed if self.design_speed is not None else max(1.0, 1.2 * expected_speed)
        return gap, field_constants(speed, gap, math.hypot(*gravity))
