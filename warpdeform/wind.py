"""The stream of air around the bodies: steady, gusting, or any function of time.

Gusts are random shear waves (random Fourier modes, R. H. Kraichnan, Phys. Fluids 13, 1970): four lengths of wave from
`gust_length` down to a quarter of it, each as three waves along randomly turned orthogonal axes,

    u(r, t) = U + sum_m a_m cos(k_m . (r - U t) + w_m t + p_m),    a_m . k_m = 0

so that the stream is free of divergence, carried along with the mean wind U, and renewed within `gust_period`.
Amplitudes follow Kolmogorov's law (speed ~ length^(1/3)), frequencies that of turning eddies (~ length^(-2/3)). Each
triple has equal variance along every direction; the sum is scaled so that each component of the gusts has the root mean
square `gust` |U|: `gust` is what meteorologists call the intensity of turbulence.

Waves were preferred to lattice noise (Perlin, curl noise): they are cheaper (no table look-ups, so they run in lanes),
their statistics are known exactly, they have no lattice planes, and their phases are reduced to one turn in float64, so
that they stay precise however long a run is.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpdeform.errors import InputError, Mistake

Stream = Callable[[float], Sequence[float]]
"""Velocity of the air [m/s], three numbers, as a function of time [s]."""

_SHELLS = 4
_SHORTEST = 0.25
_FASTEST = 340.0


@dataclass(frozen=True, eq=False)
class GustWaves:
    """The shear waves that make up the gusts.

    Attributes:
        wave_vectors: k_m [rad/m], shape (m, 3).
        amplitudes: a_m [m/s], shape (m, 3), at right angles to k_m.
        rates: Phase rates seen from a place at rest, w_m - k_m . U [rad/s], shape (m,).
        phases: Phases p_m at time 0 [rad], shape (m,).
    """

    wave_vectors: NDArray[np.float64]
    amplitudes: NDArray[np.float64]
    rates: NDArray[np.float64]
    phases: NDArray[np.float64]

    def turns_at(self, time: float) -> NDArray[np.float64]:
        """Phases at `time` [s] in turns, reduced to -1/2..1/2, shape (m,)."""
        turns = (self.phases + self.rates * time) / (2.0 * math.pi)
        return turns - np.round(turns)


@dataclass(frozen=True)
class Wind:
    """Velocity of the air.

    Attributes:
        velocity: Steady or mean velocity [m/s], three numbers, or a function of time [s] that returns them.
        gust: Root mean square of each component of the gusts, as a share of the mean speed; 0.1 is an open field, 0.3
            a street. Gusts are carried by a steady mean wind: with a function of time leave it 0.
        gust_length: Length of the longest waves of the gusts [m].
        gust_period: Time in which the longest waves renew themselves, seen moving with the wind [s].
        seed: Which gusts; equal seeds blow equally, to the bit, in every run.
    """

    velocity: tuple[float, float, float] | Stream = (0.0, 0.0, 0.0)
    gust: float = 0.0
    gust_length: float = 2.0
    gust_period: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        mistakes = []
        if not callable(self.velocity):
            remedy = f"Use three numbers in m/s below {_FASTEST:g}, for example [6.0, 0.0, 0.0]."
            try:
                numbers = tuple(float(x) for x in self.velocity)
            except (TypeError, ValueError):
                numbers = ()
            if len(numbers) != 3 or not math.hypot(*numbers) < _FASTEST:
                mistakes.append(Mistake("velocity", self.velocity, "is not the velocity of a wind", remedy))
            object.__setattr__(self, "velocity", numbers)
        elif self.gust:
            remedy = "Leave gust out, or give a steady velocity."
            mistakes.append(Mistake("gust", self.gust, "cannot be carried by a velocity that is a function", remedy))
        if not 0.0 <= self.gust <= 5.0:
            remedy = "Use 0 (steady) to 5; 0.3 is strong."
            mistakes.append(Mistake("gust", self.gust, "is not a share of the mean speed", remedy))
        for key, unit in (("gust_length", "m"), ("gust_period", "s")):
            value = getattr(self, key)
            if not (math.isfinite(value) and value > 0.0):
                mistakes.append(Mistake(key, value, f"must be positive [{unit}]", "Use for example 2."))
        if not (isinstance(self.seed, int) and self.seed >= 0):
            mistakes.append(Mistake("seed", self.seed, "must be a whole number, not negative", "Use for example 0."))
        if mistakes:
            raise InputError(mistakes)

    @property
    def gusting(self) -> bool:
        """Whether the stream differs from place to place."""
        return self.gust > 0.0 and not callable(self.velocity) and math.hypot(*self.velocity) > 0.0

    def mean(self, time: float) -> NDArray[np.float64]:
        """Velocity without gusts at `time` [s]: [m/s], shape (3,).

        Raises:
            InputError: The user's function did not return three finite numbers.
        """
        if not callable(self.velocity):
            return np.array(self.velocity)
        returned = self.velocity(time)
        try:
            velocity = np.array(returned, dtype=np.float64)
        except (TypeError, ValueError):
            velocity = np.array(np.nan)
        if velocity.shape != (3,) or not np.isfinite(velocity).all():
            problem = f"is what the function of time returned at t = {time:g} s"
            raise InputError(Mistake("velocity", returned, problem, "Return three finite numbers in m/s."))
        return velocity

    def waves(self) -> GustWaves:
        """The waves of the gusts; the same for the same seed, on every machine."""
        mean = self.mean(0.0)
        random = np.random.Generator(np.random.PCG64(self.seed))
        sizes = _SHORTEST ** np.linspace(0.0, 1.0, _SHELLS)
        strengths = sizes ** (1.0 / 3.0)
        strengths *= self.gust * float(np.linalg.norm(mean)) * math.sqrt(2.0 / np.sum(strengths**2))
        axes = np.array([_random_rotation(random) for _ in sizes])
        wave_vectors = (2.0 * math.pi / (self.gust_length * sizes))[:, None, None] * axes
        amplitudes = strengths[:, None, None] * np.roll(axes, 1, axis=1)
        turning = random.uniform(0.5, 1.5, (_SHELLS, 3)) * random.choice([-1.0, 1.0], (_SHELLS, 3))
        frequencies = (2.0 * math.pi / self.gust_period) * sizes[:, None] ** (-2.0 / 3.0) * turning
        k = wave_vectors.reshape(-1, 3)
        phases = random.uniform(-math.pi, math.pi, len(k))
        return GustWaves(k, amplitudes.reshape(-1, 3), frequencies.reshape(-1) - k @ mean, phases)

    def stream(self, points: NDArray[np.float64], time: float) -> NDArray[np.float64]:
        """Velocity of the air at points [m], shape (..., 3), at `time` [s]: [m/s], shape (..., 3)."""
        mean = np.broadcast_to(self.mean(time), np.shape(points))
        if not self.gusting:
            return np.array(mean)
        waves = self.waves()
        return mean + np.cos(points @ waves.wave_vectors.T + 2.0 * math.pi * waves.turns_at(time)) @ waves.amplitudes


def _random_rotation(random: np.random.Generator) -> NDArray[np.float64]:
    """Three orthonormal rows, uniform over all rotations: the rotation of a uniform unit quaternion."""
    x, y, z, w = (q := random.standard_normal(4)) / np.linalg.norm(q)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
