"""Where the picture is taken from: a three-quarter view whose distance fits what it shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warpdeform.errors import InputError, Mistake
from warpdeform.study.picture.drawing import Floats

SENSOR = 36.0
"""Width of the film [mm], as of a small-picture camera; a lens of 50 mm then sees as a person does."""

MARGIN = 1.12
"""The subject fills the picture divided by this."""


@dataclass(frozen=True)
class Camera:
    """How to look at the subject.

    Attributes:
        azimuth: Direction from the subject to the camera about the z axis [degrees]: 0 is +x, 90 is +y.
        elevation: Its height above the horizon [degrees], -89 to 89.
        distance: Multiple of the distance at which the subject just fills the picture.
        lens: Focal length on a 36 mm film [mm].
        position: Explicit camera position [m], instead of azimuth, elevation and distance.
        target: The point looked at [m]; with `position` alone, the middle of the subject.
    """

    azimuth: float = -62.0
    elevation: float = 20.0
    distance: float = 1.0
    lens: float = 45.0
    position: tuple[float, float, float] | None = None
    target: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        numbers = {"azimuth": self.azimuth, "elevation": self.elevation, "distance": self.distance, "lens": self.lens}
        mistakes = [
            Mistake(f"camera.{name}", value, "must be a finite number", "Leave it out for the default.")
            for name, value in numbers.items()
            if not np.isfinite(value)
        ]
        if not mistakes:
            if not -89.0 <= self.elevation <= 89.0:
                mistakes.append(Mistake("camera.elevation", self.elevation, "is too steep", "Use -89 to 89 degrees."))
            if self.distance <= 0.0:
                mistakes.append(Mistake("camera.distance", self.distance, "must be above 0", "1 fills the picture."))
            if not 8.0 <= self.lens <= 1000.0:
                mistakes.append(Mistake("camera.lens", self.lens, "is no focal length", "Use 8 to 1000 mm."))
        if self.position is not None and self.position == self.target:
            mistakes.append(Mistake("camera.target", self.target, "is the position itself", "Look at another point."))
        if mistakes:
            raise InputError(mistakes)


@dataclass(frozen=True)
class View:
    """A camera in its place.

    Attributes:
        position: Eye point [m], shape (3,).
        axes: Rows right, up and backward: orthonormal, shape (3, 3).
        lens: Focal length [mm] on a film of 36 mm along the picture's longer side.
        distance: From the eye to the subject's middle [m].
    """

    position: Floats
    axes: Floats
    lens: float
    distance: float


def place_camera(camera: Camera, subject: Floats, size: tuple[int, int]) -> View:
    """Place the camera so that all of the subject is seen.

    A point p is in the picture when |right.(p - c)| <= t forward.(p - c) for the half width t of the view, which is
    linear in the camera position c: each of the four sides gives one bound, and the nearest camera that keeps all four
    has a closed form.

    Args:
        camera: The wish.
        subject: Points to show [m], shape (n, 3).
        size: Width and height of the picture [pixels].
    """
    middle = (subject.min(axis=0) + subject.max(axis=0)) / 2
    if camera.position is not None:
        position = np.array(camera.position, dtype=np.float64)
        target = middle if camera.target is None else np.array(camera.target, dtype=np.float64)
        return View(position, _axes(position - target), camera.lens, float(np.linalg.norm(position - middle)))
    azimuth, elevation = np.radians([camera.azimuth, camera.elevation])
    level = np.cos(elevation)
    axes = _axes(np.array([np.cos(azimuth) * level, np.sin(azimuth) * level, np.sin(elevation)]))
    right, up, ahead = subject @ axes[0], subject @ axes[1], -subject @ axes[2]
    half = SENSOR / (2.0 * camera.lens * MARGIN * max(size)) * np.array(size, dtype=np.float64)
    place, depth = np.zeros(2), np.zeros(2)
    for k, (coordinate, slope) in enumerate(zip((right, up), half, strict=True)):
        most, least = np.max(coordinate - slope * ahead), np.max(-coordinate - slope * ahead)
        place[k], depth[k] = (most - least) / 2, -(most + least) / (2 * slope)
    nearest = float(depth.min())
    middle_ahead = float(-middle @ axes[2])
    nearest = middle_ahead - camera.distance * max(middle_ahead - nearest, 1e-6)
    if camera.target is not None:
        place = axes[:2] @ np.array(camera.target, dtype=np.float64)
    position = place @ axes[:2] - nearest * axes[2]
    return View(position, axes, camera.lens, float(np.linalg.norm(position - middle)))


def _axes(backward: Floats) -> Floats:
    """Right, up and backward of a camera that keeps the horizon level."""
    backward = backward / np.linalg.norm(backward)
    right = np.cross([0.0, 0.0, 1.0], backward)
    if np.linalg.norm(right) < 1e-9:
        right = np.array([1.0, 0.0, 0.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(backward, right), backward])
