"""Rigid motions given by keyframes: the poses of obstacles, the paths of pins."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpdeform.errors import InputError, Mistake

_IDENTITY = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Track:
    """A rigid pose over time: piecewise linear between keyframes, constant before the first and after the last.

    A point p of the moving frame stands at ``position + pivot + R (p - pivot)`` in the world, where R is the keyframed
    rotation followed by the steady spin.

    Attributes:
        times: Times of the keyframes [s], increasing, shape (k,).
        positions: Position of the frame at each of them [m], shape (k, 3).
        rotations: Rotation at each of them, unit quaternions (x, y, z, w), shape (k, 4); left out: none. Between two
            keyframes the shorter way is taken.
        spin: Steady angular velocity about world axes from the first keyframe on, without end [rad/s], shape (3,).
        pivot: Point of the moving frame that rotation leaves where it is [m], shape (3,).
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    rotations: NDArray[np.float64]
    spin: NDArray[np.float64]
    pivot: NDArray[np.float64]

    def __init__(
        self,
        times: ArrayLike,
        positions: ArrayLike,
        rotations: ArrayLike | None = None,
        spin: ArrayLike = (0.0, 0.0, 0.0),
        pivot: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Check and keep the keyframes.

        Raises:
            InputError: Times that do not increase, numbers that are not finite, shapes that do not fit each other, a
                quaternion of length zero.
        """
        mistakes: list[Mistake] = []
        t = _finite("times", times, (None,), "Give a list of times in seconds.", mistakes)
        count = len(t) if t is not None else None
        p = _finite("positions", positions, (count, 3), "Give one [x, y, z] in metres per time.", mistakes)
        if rotations is None:
            rotations = np.tile(_IDENTITY, (count or 1, 1))
        q = _finite("rotations", rotations, (count, 4), "Give one quaternion [x, y, z, w] per time.", mistakes)
        s = _finite("spin", spin, (3,), "Give [x, y, z] in rad/s.", mistakes)
        c = _finite("pivot", pivot, (3,), "Give [x, y, z] in metres.", mistakes)
        if t is not None and not (np.diff(t) > 0).all():
            mistakes.append(Mistake("times", t, "must increase from keyframe to keyframe", "Sort the keyframes."))
        if q is not None and not (np.linalg.norm(q, axis=1) > 1e-6).all():
            mistakes.append(Mistake("rotations", q, "holds a quaternion of length zero", "Use [0, 0, 0, 1] for none."))
        if mistakes or t is None or p is None or q is None or s is None or c is None:
            raise InputError(mistakes)
        q = q / np.linalg.norm(q, axis=1, keepdims=True)
        for name, value in (("times", t), ("positions", p), ("rotations", q), ("spin", s), ("pivot", c)):
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    @classmethod
    def fixed(cls, position: ArrayLike = (0.0, 0.0, 0.0), rotation: ArrayLike = _IDENTITY) -> "Track":
        """A pose that never changes: position [m] and quaternion (x, y, z, w)."""
        return cls([0.0], [np.asarray(position)], [np.asarray(rotation)])

    @classmethod
    def line(
        cls,
        start: ArrayLike,
        end: ArrayLike,
        start_time: float,
        end_time: float,
        rotation: ArrayLike = _IDENTITY,
    ) -> "Track":
        """A straight way at constant speed from `start` to `end` [m] between two times [s]."""
        return cls([start_time, end_time], np.stack([start, end]), np.stack([rotation, rotation]))

    @property
    def static(self) -> bool:
        """Whether the pose is the same at all times."""
        return not self.spin.any() and not np.ptp(self.positions, axis=0).any() and not np.ptp(self.rotations, 0).any()

    def pose(self, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The pose at `time` [s].

        Returns:
            Position of the frame's origin [m], shape (3,), and rotation, unit quaternion (x, y, z, w), shape (4,).
        """
        t = self.times
        k = int(np.clip(np.searchsorted(t, time, side="right") - 1, 0, max(len(t) - 2, 0)))
        if len(t) == 1:
            position, rotation = self.positions[0], self.rotations[0]
        else:
            s = float(np.clip((time - t[k]) / (t[k + 1] - t[k]), 0.0, 1.0))
            position = (1.0 - s) * self.positions[k] + s * self.positions[k + 1]
            rotation = _between(self.rotations[k], self.rotations[k + 1], s)
        if self.spin.any():
            rotation = multiply(from_rotation_vector(self.spin * max(time - t[0], 0.0)), rotation)
        if self.pivot.any():
            position = position + self.pivot - rotation_matrix(rotation) @ self.pivot
        return np.array(position), np.array(rotation)

    def max_speed(self, radius: float) -> float:
        """The fastest speed that a point at most `radius` [m] from the frame's origin reaches [m/s] (upper bound)."""
        turning = float(np.linalg.norm(self.spin))
        travel = 0.0
        if len(self.times) > 1:
            dt = np.diff(self.times)
            travel = float(np.max(np.linalg.norm(np.diff(self.positions, axis=0), axis=1) / dt))
            cosine = np.abs(np.sum(self.rotations[1:] * self.rotations[:-1], axis=1))
            turning += float(np.max(2.0 * np.arccos(np.minimum(cosine, 1.0)) / dt))
        return travel + turning * (radius + float(np.linalg.norm(self.pivot))) if turning > 0 else travel


def _finite(
    key: str, values: ArrayLike, shape: tuple[int | None, ...], remedy: str, mistakes: list[Mistake]
) -> NDArray[np.float64] | None:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.array(np.nan)
    fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    if fits and array.size and np.isfinite(array).all():
        return array
    mistakes.append(Mistake(key, values, "does not have the right shape or holds numbers that are not finite", remedy))
    return None


def multiply(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """The quaternion (x, y, z, w) of the rotation `b` followed by `a`."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.array([*vector, a[3] * b[3] - a[:3] @ b[:3]])


def from_rotation_vector(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """The quaternion (x, y, z, w) of a rotation by |vector| [rad] about the vector's direction."""
    angle = float(np.linalg.norm(vector))
    return np.array([*(0.5 * np.sinc(angle / (2.0 * np.pi)) * vector), np.cos(0.5 * angle)])


def to_rotation_vector(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Axis times angle [rad], at most half a turn, of a unit quaternion (x, y, z, w)."""
    q = quaternion if quaternion[3] >= 0.0 else -quaternion
    sine = float(np.linalg.norm(q[:3]))
    return 2.0 * q[:3] if sine < 1e-12 else (2.0 * np.arctan2(sine, q[3]) / sine) * q[:3]


def rotation_matrix(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """The matrix of a unit quaternion (x, y, z, w), shape (3, 3)."""
    x, y, z, w = quaternion
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def _between(a: NDArray[np.float64], b: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """The rotation a share of the shorter way from `a` to `b`."""
    conjugate = a * np.array([-1.0, -1.0, -1.0, 1.0])
    return multiply(from_rotation_vector(share * to_rotation_vector(multiply(b, conjugate))), a)


def rotation_to(normal: ArrayLike) -> NDArray[np.float64]:
    """The quaternion (x, y, z, w) of the shortest turn of the z axis to `normal` (any length but zero).

    Raises:
        InputError: The normal is no direction.
    """
    n = np.array(normal, dtype=np.float64)
    length = float(np.linalg.norm(n)) if n.shape == (3,) else 0.0
    if not (np.isfinite(length) and length > 0.0):
        raise InputError(Mistake("normal", normal, "is no direction", "Give [x, y, z], not all zero."))
    n /= length
    if n[2] < -1.0 + 1e-12:
        return np.array([1.0, 0.0, 0.0, 0.0])
    q = np.array([-n[1], n[0], 0.0, 1.0 + n[2]])
    return q / np.linalg.norm(q)
