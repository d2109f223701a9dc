"""The trapezoidal rule, then BDF2, as one step."""

from math import sqrt
from typing import ClassVar

from warpdeform.integrators.integrator import ErrorEstimate, ImplicitMethod, Stage
from warpdeform.integrators.sdirk2 import SDIRK2, embedded

GAMMA = 2.0 - sqrt(2.0)


class TRBDF2(ImplicitMethod):
    """TR-BDF2 (Bank et al. 1985): second order, L-stable, two stages with one matrix, the smallest error constant.

    The first stage is the trapezoidal rule to g dt, g = 2 - sqrt 2, with the acceleration a that the last step ended
    with; the second is BDF2 over x, x_g and x'. Without a history of accelerations the step is SDIRK2's, whose stages
    have the same tau: a trapezoidal rule would ring after a disturbance (design 6.2).
    """

    name: ClassVar[str] = "tr-bdf2"
    order: ClassVar[int] = 2
    stage_history: ClassVar[tuple[tuple[str, str], ...]] = (("x", "a"), ("x_mid", "v_mid"))

    def stages(self, dt: float, dt_before: float | None) -> tuple[Stage, ...]:
        """w2 = x + c1 (x_g - x), y2 = w2 + tau (c1 v_g - c2 v); c1 = 1/(g (2 - g)), c2 = c1 - 1."""
        if dt_before is None:
            return SDIRK2().stages(dt, None)
        tau = 0.5 * GAMMA * dt
        c1 = 1.0 / (GAMMA * (2.0 - GAMMA))
        c2 = c1 - 1.0
        first = (0.0, GAMMA * dt, 0.0)
        return (
            Stage(tau=tau, w=(0.0, tau, 0.0), y=(0.0, GAMMA * dt, tau * tau), start=first, end=GAMMA),
            Stage(tau=tau, w=(c1, 0.0, 0.0), y=(c1, -tau * c2, tau * c1), start=(1.0, 0.0, (1.0 - GAMMA) * dt)),
        )

    def error(self, dt: float, dt_before: float | None) -> ErrorEstimate:
        """The quadrature of v, v_g and v' that is exact for parabolas, less that of the method."""
        if dt_before is None:
            return SDIRK2().error(dt, None)
        quarter = 0.25 * sqrt(2.0)
        return ErrorEstimate(embedded(dt, GAMMA, (quarter, quarter, 1.0 - 2.0 * quarter)), order=2)
