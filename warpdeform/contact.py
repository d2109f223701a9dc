"""Contact as the user describes it: which bodies feel each other, at what distance, with what friction."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from warpdeform.errors import InputError, Mistake
from warpdeform.measure import edge_lengths
from warpdeform.obstacle import FieldConstants, field_constants

if TYPE_CHECKING:
    from warpdeform.body import Body

LARGEST_GAP = 0.25
"""Gap that is taken where none is given, at most: share of the smallest node spacing of the bodies."""
USUAL_GAP = 0.002
"""Gap that is taken where none is given, if the spacing allows it [m]."""
LARGEST_THICKNESS = 0.6
"""Thickness over node spacing from which on a node would touch the triangles beside its own, 0.7 spacings away."""


@dataclass(frozen=True)
class Contact:
    """Two bodies that feel each other, or one that feels itself.

    Attributes:
        bodies: Their names; twice the same for self-contact.
        friction: Coefficient of friction.
        gap: Distance of the skins at rest [m]; None takes 2 mm, or a quarter of the spacing where that is less.
        design_speed: Fastest normal speed that the field is to stop [m/s]; None estimates it.
        relax: Whether nodes are moved before the start where skins are nearer than the gap (warpdeform/relaxing.py);
            else a start whose skins overlap is refused. One that crosses is refused always.
    """

    bodies: tuple[str, str]
    friction: float = 0.0
    gap: float | None = None
    design_speed: float | None = None
    relax: bool = False

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

    def gap_at(self, spacing: float) -> float:
        """Distance of the skins at rest [m], for bodies of that smallest node spacing [m]."""
        return self.gap if self.gap is not None else min(USUAL_GAP, LARGEST_GAP * spacing)

    def constants(
        self, gravity: Sequence[float], spacing: float, expected_speed: float
    ) -> tuple[float, FieldConstants]:
        """Gap [m] and constants of the field.

        Args:
            gravity: Acceleration of gravity [m/s2].
            spacing: Smallest node spacing of both bodies [m].
            expected_speed: Fastest relative speed expected [m/s], used where `design_speed` is left out.
        """
        gap = self.gap_at(spacing)
        speed = self.design_speed if self.design_speed is not None else max(1.0, 1.2 * expected_speed)
        return gap, field_constants(speed, gap, math.hypot(*gravity))


def spacing_of(body: "Body") -> float:
    """Smallest rest length of an edge [m]."""
    return float(min(length.min() for length in edge_lengths(body.shape.grid, body.shape.positions)))


def contact_pairs(bodies: Sequence["Body"], contacts: Sequence[Contact]) -> list[Contact]:
    """The pairs that are named, and those of bodies with `self_contact`.

    Raises:
        InputError: Pairs that are named twice or whose bodies do not exist; bodies that are too thick to feel
            themselves, or have no two parts that could touch.
    """
    names = [body.name for body in bodies]
    for contact in contacts:
        for name in contact.bodies:
            if name not in names:
                remedy = f"Use one of: {', '.join(names)}."
                raise InputError(Mistake("contact.bodies", name, "is not the name of a body", remedy))
    named = [frozenset(contact.bodies) for contact in contacts]
    if len(set(named)) < len(named):
        twice = next(pair for pair in named if named.count(pair) > 1)
        raise InputError(Mistake("contact.bodies", tuple(twice), "are named twice", "Name every pair once."))
    alone = [body for body in bodies if body.self_contact and frozenset((body.name,)) not in named]
    pairs = [*contacts, *(Contact((body.name, body.name)) for body in alone)]
    _check_thickness([body for body in bodies if any(pair.bodies == (body.name, body.name) for pair in pairs)])
    return pairs


def _check_thickness(bodies: Sequence["Body"]) -> None:
    """Refuse bodies that feel themselves and are so thick that neighbours touch, or have nothing to feel.

    Raises:
        InputError: What is wrong with which of them.
    """
    mistakes = []
    for body in bodies:
        spacing = spacing_of(body)
        thickness, largest = body.skin_thickness, LARGEST_THICKNESS * spacing
        if thickness > largest:
            problem = f"of {body.name} is too thick for its node spacing of {spacing:.3g} m to feel itself"
            remedy = f"Use contact_thickness = {largest:.3g} or less, or fewer nodes."
            mistakes.append(Mistake("contact_thickness", thickness, problem, remedy))
        if body.kind == "curve" and body.nodes[1] == 1 and body.nodes[0] < 4:
            problem = f"{body.name} has no two parts that could touch: it is one strand of {body.nodes[0]} nodes"
            mistakes.append(Mistake("self_contact", True, problem, "Leave it out, or use 4 nodes or more."))
    if mistakes:
        raise InputError(mistakes)
