"""A body as the user describes it: rest shape, material, where it starts and what holds it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpdeform.coefficients import (
    CurveCoefficients,
    PaperCurveWeights,
    PaperSolidWeights,
    PaperWeights,
    SolidCoefficients,
    SurfaceCoefficients,
)
from warpdeform.errors import InputError, Mistake
from warpdeform.growth import Growth
from warpdeform.material import Material
from warpdeform.section import Section
from warpdeform.selectors import NodeSelector, select_nodes
from warpdeform.shape import RestShape
from warpdeform.varying import Varying

if TYPE_CHECKING:
    from warpdeform.track import Track

Law = CurveCoefficients | PaperCurveWeights | SurfaceCoefficients | PaperWeights | SolidCoefficients | PaperSolidWeights

LAWS: dict[str, Callable[["Body", str], Law]] = {
    "curve": lambda body, at: body.material.curve(body.section, body.shape.grid, at),
    "surface": lambda body, at: body.material.surface(body.shape.grid, at),
    "solid": lambda body, at: body.material.solid(body.shape.grid, at),
}
"""What the material of each kind of body comes to, at its "cells" or "nodes"."""


@dataclass(frozen=True)
class Pin:
    """Nodes that are held, or led along a track.

    Attributes:
        nodes: Which nodes, see `NodeSelector`.
        track: Rigid motion of the held nodes relative to their initial positions; None holds them still.
        until: When they are let go [s]; None holds them for good.
    """

    nodes: NodeSelector
    track: "Track | None" = None
    until: float | None = None

    def __post_init__(self) -> None:
        _check_end(self.until)

    def is_over(self, time: float) -> bool:
        """Whether they are let go before a step that ends at `time` [s]."""
        return _is_over(self.until, time)


@dataclass(frozen=True)
class Spring:
    """Zero-length springs from nodes to one point (the paper's spring force k (p - r)).

    Attributes:
        nodes: Which nodes, see `NodeSelector`.
        stiffness: Stiffness of each node's spring [N/m].
        point: World point [m]; None ties each node to its own initial position.
        track: Rigid motion of the points; None leaves them still.
        until: When the springs let go [s]; None keeps them for good.
    """

    nodes: NodeSelector
    stiffness: float
    point: tuple[float, float, float] | None = None
    track: "Track | None" = None
    until: float | None = None

    def __post_init__(self) -> None:
        _check_end(self.until)
        if not (math.isfinite(self.stiffness) and self.stiffness > 0):
            raise InputError(Mistake("stiffness", self.stiffness, "must be positive [N/m]", "Use for example 100."))

    def is_over(self, time: float) -> bool:
        """Whether they let go before a step that ends at `time` [s]."""
        return _is_over(self.until, time)


def _is_over(until: float | None, time: float) -> bool:
    """Times are multiples of a step to round-off."""
    return until is not None and time > until + 1e-9


def _check_end(until: float | None) -> None:
    if until is not None and not until >= 0:
        raise InputError(Mistake("until", until, "must not be negative [s]", "Leave it out to hold for good."))


@dataclass(frozen=True)
class Body:
    """A deformable curve, surface or solid.

    Attributes:
        name: Name in files and messages.
        shape: Rest shape; its metric and curvature tensors are what the body wants to be.
        material: What it is made of.
        position: Translation of the initial state from the rest shape [m].
        rotation: Rotation of the initial state about the rest shape's origin, quaternion (x, y, z, w).
        velocity: Initial velocity [m/s].
        initial_positions: Initial node positions [m], shape (*nodes, 3), if they are not the placed rest shape.
        pins: Held or led nodes.
        springs: Springs from nodes to points.
        drag: Mass-proportional damping [1/s] beside the material's own.
        wind_coefficient: c of the viscous force c (n . v) n [kg/(m2 s)].
        pressure: Pressure inside over outside of a surface with a periodic axis [Pa]; ends are capped; 0 for none.
        growth: How the rest shape changes over time; None if it stays.
        section: Cross-section of a curve, which materials in physical units need.
        natural: Shape of a curve whose curvature and twist need no force; None: the rest shape.
        director: Where director 1 of a curve's section points, at its first segment in that shape; None: anywhere.
        self_contact: Whether it feels itself.
        contact_thickness: Thickness for contact with bodies and obstacles [m]; None takes that of the material or the
            section.
        color: Display colour, linear RGB.
        roughness: Roughness of the preview surface, 0 to 1.
        nodes: Nodes along the axes: (n, strands) of a curve, (nu, nv) of a surface, (nu, nv, nw) of a solid.
        kind: "curve", "surface" or "solid".
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
    pressure: float = 0.0
    growth: Growth | None = None
    section: Section | None = None
    natural: RestShape | None = None
    director: tuple[float, float, float] | None = None
    self_contact: bool = False
    contact_thickness: float | None = None
    color: tuple[float, float, float] = (0.55, 0.13, 0.11)
    roughness: float = 0.7
    nodes: tuple[int, ...] = field(init=False)
    kind: str = field(init=False)

    def __post_init__(self) -> None:
        nodes, kind = self.shape.nodes, self.shape.kind
        object.__setattr__(self, "nodes", nodes)
        object.__setattr__(self, "kind", kind)
        mistakes = []
        for key in ("section", "natural", "director") if kind != "curve" else ():
            if getattr(self, key) is not None:
                mistakes.append(Mistake(key, None, f"does not go with a {kind}", "Leave it out, or use a curve."))
        if self.natural is not None and kind == "curve" and self.natural.positions.shape != self.shape.positions.shape:
            problem = f"has nodes {list(self.natural.nodes)}, the rest shape {list(nodes)}"
            mistakes.append(Mistake("natural", None, problem, "Give it the nodes and strands of the rest shape."))
        if self.director is not None and not (np.shape(self.director) == (3,) and any(self.director)):
            problem = "must be three numbers that are not all zero"
            mistakes.append(Mistake("director", self.director, problem, "Use for example [0, 0, 1]."))
        if self.growth is not None:
            mistakes += self._growth_mistakes()
        for key in ("drag", "wind_coefficient"):
            value = getattr(self, key)
            if not (math.isfinite(value) and value >= 0):
                mistakes.append(Mistake(key, value, "must be a finite number, not negative", "Use 0 for none."))
        thickness = self.contact_thickness
        if thickness is not None and not (math.isfinite(thickness) and thickness >= 0.0):
            problem = "must be finite and not negative [m]"
            mistakes.append(Mistake("contact_thickness", thickness, problem, "Use for example 0.001."))
        if not math.isfinite(self.pressure):
            mistakes.append(Mistake("pressure", self.pressure, "must be finite [Pa]", "Use 0 for none."))
        elif self.pressure and not (kind == "surface" and any(self.shape.periodic)):
            problem = f"needs a surface that encloses something, which this {kind} does not"
            mistakes.append(Mistake("pressure", self.pressure, problem, "Use a tube, torus or sphere, or 0."))
        for key, length in (("position", 3), ("velocity", 3), ("rotation", 4)):
            value = getattr(self, key)
            if len(value) != length or not all(math.isfinite(x) for x in value):
                mistakes.append(Mistake(key, value, f"must be {length} finite numbers", "Leave it out for none."))
        if not any(self.rotation):
            mistakes.append(Mistake("rotation", self.rotation, "has length zero", "Use (0, 0, 0, 1) for none."))
        if self.initial_positions is not None and kind == "curve" and np.ndim(self.initial_positions) == 2:
            object.__setattr__(self, "initial_positions", np.asarray(self.initial_positions)[:, None])
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
                select_nodes(selector, nodes, kind)
            except InputError as error:
                mistakes += [Mistake(key, m.value, m.problem, m.remedy) for m in error.mistakes]
        try:
            for at in ("cells", "nodes"):
                LAWS[kind](self, at)
        except InputError as error:
            mistakes += [Mistake(f"material.{m.key}", m.value, m.problem, m.remedy) for m in error.mistakes]
        if mistakes:
            raise InputError(mistakes)

    def _growth_mistakes(self) -> list[Mistake]:
        assert self.growth is not None
        found = self.growth.mistakes(self.shape.dimension, self.kind)
        if self.growth.curvature.any() and not found and not self._bends():
            problem, remedy = f"needs a {self.kind} that bends", "Give its material a bending stiffness."
            found.append(Mistake("curvature", self.growth.curvature, problem, remedy))
        try:
            self.growth.shares(self.shape.grid)
        except InputError as error:
            found += error.mistakes
        return [Mistake(f"growth.{m.key}", m.value, m.problem, m.remedy) for m in found]

    def _bends(self) -> bool:
        """Whether the material resists bending; True also where it is refused for other reasons."""
        try:
            coefficients = LAWS[self.kind](self, "nodes")
        except InputError:
            return True
        stiffness = getattr(coefficients, "bending", getattr(coefficients, "xi", 0.0))
        return any(np.any(value) for value in (stiffness if isinstance(stiffness, tuple) else (stiffness,)))

    @property
    def density(self) -> float | NDArray[np.float64]:
        """Mass per length [kg/m] of a curve, area [kg/m2] of a surface or volume [kg/m3] of a solid.

        A number, or one for each cell where the material varies, shape (*cells).
        """
        return LAWS[self.kind](self, "cells").density

    @property
    def diameter(self) -> float:
        """Diameter of a curve that wind meets [m]; 0 without a section."""
        return 0.0 if self.section is None else 2.0 * float(self.section.radius)

    @property
    def skin_thickness(self) -> float:
        """Largest distance of the skins of both sides [m]: of a sheet its thickness, of a curve its diameter."""
        return float(np.max(self.skin_thicknesses()))

    def skin_thicknesses(self) -> NDArray[np.float64]:
        """Distance of the skins of both sides at the nodes [m], shape (*nodes); 0 of a solid, whose nodes are skin."""
        thickness: float | Varying = 0.0
        if self.contact_thickness is not None:
            thickness = self.contact_thickness
        elif self.kind == "curve":
            thickness = self.diameter
        elif self.kind == "surface" and self.material.thickness is not None:
            thickness = self.material.thickness
        if isinstance(thickness, Varying):
            return thickness.at_nodes(self.shape.grid)
        return np.full(self.nodes, thickness)

    def placed_positions(self) -> NDArray[np.float64]:
        """Initial node positions [m], shape (*nodes, 3)."""
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
