"""Obstacles as the user describes them: a shape with a pose, and the words from which its field follows."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from warpdeform.errors import InputError, Mistake
from warpdeform.track import Track, rotation_matrix

SIZES: dict[str, tuple[str, ...]] = {
    "plane": (),
    "sphere": ("radius",),
    "box": ("size",),
    "capsule": ("radius", "height"),
    "cylinder": ("radius", "height"),
    "cone": ("radius", "height"),
    "torus": ("radius", "tube_radius"),
    "mesh": (),
}
"""Kinds of obstacles and their sizes [m], in the obstacle's own frame.

plane: z = 0, outside is z > 0. box: full lengths (x, y, z) about the origin. capsule, cylinder, cone: along z, the
origin in the middle of `height`, which for the capsule leaves out the caps; the cone's tip is up. torus: around z.
mesh: vertices as they are. The same conventions as USD's primitives, so that they can be written as such.
"""

_EXAMPLES = {"radius": "0.3", "size": "[1.0, 1.0, 0.1]", "height": "1.0", "tube_radius": "0.05"}
_LARGEST_FRICTION = 10.0


@dataclass(frozen=True)
class FieldConstants:
    """Constants of the exponential field (V^2 / 2) exp(-f / eps) per unit mass; design 5.1.

    Attributes:
        design_speed: V [m/s].
        range: eps [m].
        cutoff: Distance beyond which the field is left out [m].
    """

    design_speed: float
    range: float
    cutoff: float


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A rigid obstacle that bodies rest on, slide over and are pushed by.

    Attributes:
        kind: One of `SIZES`.
        sizes: Its sizes [m], named as in `SIZES`.
        name: Name in files and messages.
        track: Pose over time.
        friction: Coulomb coefficient.
        design_speed: Normal speed that the field alone must stop [m/s]; None: 1.2 times the fastest expected.
        gap: Distance at which a body comes to rest on it [m].
        thickness: Thickness of a mesh that is a thin shell instead of the skin of a solid [m]; 0 for solids.
        vertices: Vertices of a mesh in its own frame [m], shape (n, 3).
        faces: Its triangles, counter-clockwise seen from outside, shape (m, 3).
        color: Display colour, linear RGB.
        roughness: Roughness of the preview surface, 0 to 1.
    """

    kind: str
    sizes: Mapping[str, float | Sequence[float]] = field(default_factory=dict)
    name: str = "obstacle"
    track: Track = field(default_factory=Track.fixed)
    friction: float = 0.0
    design_speed: float | None = None
    gap: float = 0.002
    thickness: float = 0.0
    vertices: NDArray[np.float64] | None = None
    faces: NDArray[np.integer] | None = None
    color: tuple[float, float, float] = (0.36, 0.38, 0.41)
    roughness: float = 0.6

    def __post_init__(self) -> None:
        if self.kind not in SIZES:
            raise InputError(Mistake("kind", self.kind, "is not a kind of obstacle", f"Use one of {', '.join(SIZES)}."))
        mistakes = self._wrong_sizes() + self._wrong_words()
        if self.kind == "mesh":
            mistakes += self._take_mesh()
        elif self.vertices is not None or self.faces is not None:
            remedy = 'Leave them out, or use kind = "mesh".'
            mistakes.append(Mistake("vertices", None, f"vertices and faces do not belong to a {self.kind}", remedy))
        if mistakes:
            raise InputError(mistakes)

    def _wrong_sizes(self) -> list[Mistake]:
        wanted = SIZES[self.kind]
        mistakes = []
        for key in self.sizes.keys() - set(wanted):
            has = f"has {' and '.join(wanted)}" if wanted else "has no sizes"
            mistakes.append(Mistake(key, self.sizes[key], f"is no size of a {self.kind}", f"A {self.kind} {has}."))
        for key in wanted:
            value = self.sizes.get(key)
            numbers = np.atleast_1d(_numbers(value))
            count = 3 if key == "size" else 1
            if numbers.shape != (count,) or not (np.isfinite(numbers) & (numbers > 0)).all():
                what = "three positive lengths" if count == 3 else "a positive length"
                mistakes.append(Mistake(key, value, f"must be {what} [m]", f"Use for example {_EXAMPLES[key]}."))
        if self.kind == "torus" and not mistakes and not self._size("tube_radius") < self._size("radius"):
            problem = "must be smaller than radius, or the torus has no hole"
            mistakes.append(Mistake("tube_radius", self.sizes["tube_radius"], problem, "Use a quarter of radius."))
        return mistakes

    def _wrong_words(self) -> list[Mistake]:
        mistakes = []

        def require(key: str, good: bool, problem: str, remedy: str) -> None:
            if not good:
                mistakes.append(Mistake(key, getattr(self, key), problem, remedy))

        speed = self.design_speed
        limit = f"must lie between 0 and {_LARGEST_FRICTION:g}"
        require("friction", 0.0 <= self.friction <= _LARGEST_FRICTION, limit, "Use for example 0.4.")
        require("gap", 1e-6 <= self.gap <= 1.0, "must lie between 1e-6 and 1 m", "Use for example 0.002.")
        good_speed = speed is None or 0.0 < speed <= 1e4
        require("design_speed", good_speed, "must lie between 0 and 10000 m/s", "Leave it out to have it estimated.")
        good_thickness = math.isfinite(self.thickness) and self.thickness >= 0.0
        require("thickness", good_thickness, "must be finite and not negative [m]", "Use 0 for solids.")
        if good_thickness and self.thickness > 0.0 and self.kind != "mesh":
            problem = f"belongs to meshes; a {self.kind} is solid"
            mistakes.append(Mistake("thickness", self.thickness, problem, "Leave it out."))
        return mistakes

    def _take_mesh(self) -> list[Mistake]:
        """Check the mesh, keep it as read-only arrays with coincident vertices welded, outside facing out."""
        vertices, faces = _numbers(self.vertices), _numbers(self.faces)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
            remedy = "Give vertices of shape (n, 3) and triangles of shape (m, 3), or read them with read_mesh."
            return [Mistake("mesh", None, "has no triangles", remedy)]
        if not np.isfinite(vertices).all():
            where = int(np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0])
            return [Mistake("mesh", None, f"vertex {where} is not finite", "Repair the mesh.")]
        if not np.isfinite(faces).all() or faces.min() < 0 or faces.max() >= len(vertices):
            return [Mistake("mesh", None, "a triangle names a vertex that does not exist", "Repair the mesh.")]
        vertices, welded = np.unique(vertices, axis=0, return_inverse=True)
        triangles = welded.reshape(-1).astype(np.int64)[faces.astype(np.int64)]
        triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
        if self.thickness == 0.0:
            if problem := _why_no_inside(vertices, triangles):
                remedy = (
                    "Close the mesh, or give `thickness` [m] to make it a thin shell: "
                    "nodes then stay on the side they start on."
                )
                return [Mistake("mesh", None, problem, remedy)]
            if _volume(vertices, triangles) < 0.0:
                triangles = triangles[:, ::-1].copy()
        for name, array in (("vertices", vertices), ("faces", triangles)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        return []

    def _size(self, key: str) -> float:
        return float(np.max(_numbers(self.sizes[key])))

    @property
    def size_vector(self) -> tuple[float, float, float]:
        """What the distance function takes [m]: radii and half heights, or the half lengths of a box."""
        if self.kind == "box":
            x, y, z = _numbers(self.sizes["size"])
            return (0.5 * x, 0.5 * y, 0.5 * z)
        first, second = ([*SIZES[self.kind], "", ""])[:2]
        scale = 0.5 if second == "height" else 1.0
        return (self._size(first) if first else 0.0, scale * self._size(second) if second else 0.0, 0.0)

    @property
    def inradius(self) -> float:
        """How deep its inside is everywhere [m]; 0 for meshes and the cone, which have thin parts."""
        a, b, c = self.size_vector
        depth = {"plane": math.inf, "sphere": a, "box": min(a, b, c), "capsule": a, "cylinder": min(a, b), "torus": b}
        return depth.get(self.kind, 0.0)

    @property
    def bounding_radius(self) -> float:
        """Radius of the smallest ball about its own origin that holds it [m]; infinite for the plane."""
        a, b, c = self.size_vector
        if self.kind == "mesh":
            assert self.vertices is not None
            return float(np.max(np.linalg.norm(self.vertices, axis=1))) + 0.5 * self.thickness
        far = {"plane": math.inf, "sphere": a, "box": math.hypot(a, b, c), "capsule": a + b, "torus": a + b}
        return far.get(self.kind, math.hypot(a, b))

    def normal_gravity(self, gravity: Sequence[float]) -> float:
        """The part of gravity [m/s2] that presses a body on it: on a plane its normal part, else all of it."""
        g = np.asarray(gravity, dtype=np.float64)
        track = self.track
        if self.kind != "plane" or track.spin.any() or np.ptp(track.rotations, axis=0).any():
            return float(np.linalg.norm(g))
        return max(0.0, -float(g @ rotation_matrix(track.rotations[0])[:, 2]))

    def expected_speed(self, positions: NDArray[np.float64], speed: float, gravity: Sequence[float]) -> float:
        """The fastest normal speed at which a body can be expected to meet it [m/s].

        Its own motion, the body's first motion, and a fall over the largest distance between the two.

        Args:
            positions: Initial node positions of the body [m], shape (..., 3).
            speed: Fastest initial node speed [m/s].
            gravity: Acceleration of gravity [m/s2].
        """
        points = np.reshape(positions, (-1, 3))
        origin, rotation = self.track.pose(0.0)
        away = points - origin
        far = float(np.max(np.linalg.norm(away, axis=1)))
        radius = self.bounding_radius
        fall = float(np.max(away @ rotation_matrix(rotation)[:, 2])) if self.kind == "plane" else far - radius
        fallen = math.sqrt(2.0 * self.normal_gravity(gravity) * max(fall, 0.0))
        return speed + fallen + self.track.max_speed(min(radius, far))

    def field_constants(self, gravity: Sequence[float], expected_speed: float = 0.0) -> FieldConstants:
        """The constants of the field from the user's words `design_speed` and `gap` (design 5.1).

        At the gap the field carries the body's weight: g = V^2 / (2 eps) exp(-gap / eps), solved for L = gap / eps.

        Args:
            gravity: Acceleration of gravity [m/s2].
            expected_speed: Fastest normal speed expected [m/s], used where `design_speed` is left out.
        """
        speed = self.design_speed if self.design_speed is not None else max(1.0, 1.2 * expected_speed)
        return field_constants(speed, self.gap, self.normal_gravity(gravity))


def field_constants(speed: float, gap: float, gravity: float) -> FieldConstants:
    """The constants of a field that stops a design speed [m/s] and keeps a weight at a gap [m] (design 5.1).

    Args:
        speed: V, raised where it is too low for the gap.
        gap: Distance at rest.
        gravity: What presses on it [m/s2].
    """
    gaps = 7.0
    if gravity > 1e-6:
        speed = max(speed, 3.7 * math.sqrt(gravity * gap))
        a = math.log(speed**2 / (2.0 * gravity * gap))
        last = 0.0
        while abs(gaps - last) > 1e-6:
            last, gaps = gaps, a + math.log(gaps)
    return FieldConstants(speed, gap / gaps, gap + 7.0 * gap / gaps)


def _numbers(value: object) -> NDArray[np.float64]:
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        return np.array(np.nan)


def _why_no_inside(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> str:
    """Why a mesh has no inside, as the end of a sentence; empty for a closed, consistently wound manifold."""
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges, owner, count = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True)
    forward = np.bincount(owner.reshape(-1), weights=directed[:, 0] < directed[:, 1], minlength=len(edges))
    cases = (
        (count > 2, "is not a manifold: {n} of its edges belong to more than two triangles"),
        (count == 1, "is open: {n} of its edges belong to one triangle only"),
        (2 * forward != count, "is wound inconsistently: the two triangles at {n} of its edges face opposite ways"),
    )
    for bad, words in cases:
        if bad.any():
            x, y, z = vertices[edges[np.flatnonzero(bad)[0]]].mean(axis=0)
            place = f" (one near [{x:.4g}, {y:.4g}, {z:.4g}])"
            return words.format(n=int(bad.sum())) + place + ", so that it has no inside and cannot be a solid"
    return ""


def _volume(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> float:
    """Enclosed volume [m3], negative for a mesh that is inside out."""
    a, b, c = (vertices[faces[:, k]] - vertices.mean(axis=0) for k in range(3))
    return float(np.sum(np.cross(a, b) * c)) / 6.0
