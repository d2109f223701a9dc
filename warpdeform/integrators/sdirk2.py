"""The two-stage, singly diagonally implicit Runge-Kutta method of second order."""

from math import sqrt
from typing import ClassVar

from warpdeform.integrators.integrator import ErrorEstimate, ImplicitMethod, Stage

GAMMA = 1.0 - 1.0 / sqrt(2.0)


class SDIRK2(ImplicitMethod):
    """SDIRK2 (Alexander 1977): second order, L-stable, without a history; two stages with one matrix (design 6.1).

    Stage velocities v1 at g dt and v2 at dt, g = 1 - 1/sqrt 2: x' = x + dt ((1 - g) v1 + g v2).
    """

    name: ClassVar[str] = "sdirk2"
    order: ClassVar[int] = 2
    stage_history: ClassVar[tuple[tuple[str, str], ...]] = (("x", "v"), ("x", "v_mid"))

    def stages(self, dt: float, dt_before: float | None) -> tuple[Stage, ...]:
        """w2 = x + (1 - g) dt v1, y2 = w2 + tau v + (1 - g) dt (v1 - v), because tau a1 = v1 - v."""
        tau, rest = GAMMA * dt, (1.0 - GAMMA) * dt
        ahead = (0.0, tau, 0.0)
        return (
            Stage(tau=tau, w=(0.0, 0.0, 0.0), y=ahead, start=ahead, end=GAMMA),
            Stage(tau=tau, w=(0.0, 0.0, rest), y=(0.0, tau - rest, 2.0 * rest), start=(0.0, 0.0, dt)),
        )

    def error(self, dt: float, dt_before: float | None) -> ErrorEstimate:
        """The quadrature of v, v1 and v2 that is exact for parabolas, less that of the method."""
        return ErrorEstimate(embedded(dt, GAMMA, (0.0, 1.0 - GAMMA, GAMMA)), order=2)


def embedded(dt: float, middle: float, weights: tuple[float, float, float]) -> tuple[float, float, float]:
    """The quadrature over 0, `middle` and 1 that is exact for parabolas, less one with other weights, times dt."""
    second = 1.0 / (6.0 * middle * (1.0 - middle))
    third = (2.0 - 3.0 * middle) / (6.0 * (1.0 - middle))
    exact = (1.0 - second - third, second, third)
    return (dt * (exact[0] - weights[0]), dt * (exact[1] - weights[1]), dt * (exact[2] - weights[2]))
