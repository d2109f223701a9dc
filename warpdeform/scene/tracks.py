"""Rotations and motions as a scene file gives them: degrees about x, y and z, relative to the start."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from warpdeform.errors import InputError, Mistake
from warpdeform.scene.kinds import PathTable
from warpdeform.scene.schema import HeldPathTable
from warpdeform.track import Track, from_rotation_vector, multiply


def quaternion(degrees: Sequence[float]) -> NDArray[np.float64]:
    """The unit quaternion (x, y, z, w) of rotations about the world's x, then y, then z axis [degrees].

    Quarter turns come out exact to the last bit or two, and no rotation at all exactly.
    """
    x, y, z = (from_rotation_vector(np.radians(angle) * axis) for angle, axis in zip(degrees, np.eye(3), strict=True))
    return multiply(z, multiply(y, x))


def obstacle_track(path: PathTable | None, position: Sequence[float], rotation: NDArray[np.float64]) -> Track:
    """The pose over time of an obstacle that starts at `position` [m], turned by the quaternion `rotation`.

    Raises:
        InputError: Lists of different lengths, times that do not increase, half a turn or more between keyframes.
    """
    if path is None:
        return Track.fixed(tuple(position), tuple(rotation))
    displacements, rotations = _keyframes(path)
    return Track(
        path.times,
        displacements + np.asarray(position),
        np.array([multiply(turn, rotation) for turn in rotations]),
        np.radians(path.spin),
    )


def held_track(path: HeldPathTable, points: NDArray[np.float64]) -> Track:
    """The rigid motion of points that start at `points` [m], shape (k, 3), turned about their middle or a pivot.

    Raises:
        InputError: See `obstacle_track`.
    """
    displacements, rotations = _keyframes(path)
    pivot = points.mean(axis=0) if path.pivot is None else path.pivot
    return Track(path.times, displacements, rotations, np.radians(path.spin), pivot)


def _keyframes(path: PathTable) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Displacements [m], shape (k, 3), and quaternions, shape (k, 4), of the keyframes."""
    count, mistakes = len(path.times), []
    for key in ("displacements", "rotations"):
        given = getattr(path, key)
        if given is not None and len(given) != count:
            problem = f"has {len(given)} entries for {count} times"
            mistakes.append(Mistake(key, given, problem, "Give one [x, y, z] for each time."))
    if count == 0:
        mistakes.append(Mistake("times", path.times, "is empty", "Use for example [0.0, 1.0]."))
    angles = np.array(path.rotations or np.zeros((count, 3)), dtype=np.float64)
    if not mistakes and count > 1 and np.abs(np.diff(angles, axis=0)).max() >= 180.0:
        problem = "turns by 180 degrees or more between two times, which has no shorter way"
        mistakes.append(Mistake("rotations", path.rotations, problem, "Put times in between, or use spin."))
    if mistakes:
        raise InputError(mistakes)
    displacements = np.array(path.displacements or np.zeros((count, 3)), dtype=np.float64)
    return displacements, np.array([quaternion(turn) for turn in angles])
