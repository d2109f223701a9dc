"""What a picture shows: triangle meshes with colours, and the ground they stand on. Both engines draw just this."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Item:
    """One thing to draw.

    Attributes:
        name: Path of its prim.
        role: A body is what the picture shows; an obstacle is seen where it is near.
        thin: Whether it is drawn as cloth (sheen, two sides, light shining through), else as a solid.
        points: Vertex positions in the world, Z up [m], shape (n, 3).
        triangles: Vertex indices, counter-clockwise seen from outside, shape (m, 3).
        normals: Unit vertex normals, shape (n, 3); None to smooth by angle.
        colors: Linear RGB of each vertex, 0 to 1, shape (n, 3).
        roughness: 0 (mirror) to 1 (matt).
        metallic: 0 (dielectric) to 1 (metal).
    """

    name: str
    role: Literal["body", "obstacle"]
    thin: bool
    points: Floats
    triangles: Ints
    normals: Floats | None
    colors: Floats
    roughness: float
    metallic: float


@dataclass(frozen=True)
class Drawing:
    """All that is seen at one time code.

    Attributes:
        items: Bodies and obstacles, the ground apart.
        ground: Height of the ground [m] where an obstacle is one; None where the picture may choose.
        time_code: Time code (frame number) it was read at; NaN for a stage without samples.
    """

    items: tuple[Item, ...]
    ground: float | None
    time_code: float

    def points(self, role: str) -> Floats:
        """All vertex positions of the items of one role [m], shape (n, 3)."""
        return np.concatenate([item.points for item in self.items if item.role == role] or [np.zeros((0, 3))])

    def subject(self) -> Floats:
        """Vertices that the camera frames [m], shape (n, 3): the bodies and the parts of obstacles near them."""
        bodies, obstacles = self.points("body"), self.points("obstacle")
        if len(bodies) == 0:
            return obstacles
        low, high = bodies.min(axis=0), bodies.max(axis=0)
        near = np.linalg.norm(obstacles - (low + high) / 2, axis=1) < 1.5 * np.linalg.norm(high - low)
        return np.concatenate([bodies, obstacles[near]])


def ground_height(drawings: tuple[Drawing, ...]) -> float:
    """Height of the studio ground under these drawings [m].

    That of the obstacle that is one; else the lowest point of the obstacles, when they reach below the bodies (a pole
    stands on the ground); else a little below a body that hangs free.
    """
    given = [drawing.ground for drawing in drawings if drawing.ground is not None]
    if given:
        return min(given)
    subject = np.concatenate([drawing.subject() for drawing in drawings])
    bodies = np.concatenate([drawing.points("body") for drawing in drawings])
    lowest = float(subject[:, 2].min())
    if len(bodies) and bodies[:, 2].min() <= lowest:
        lowest -= 0.06 * float(np.linalg.norm(np.ptp(subject, axis=0)))
    return lowest
