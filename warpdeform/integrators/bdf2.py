"""The two-step backward differentiation formula."""

from typing import ClassVar

from warpdeform.integrators.implicit_euler import ImplicitEuler
from warpdeform.integrators.integrator import ErrorEstimate, ImplicitMethod, Stage

MOST_RATIO = 2.4
"""Largest ratio of a step to the one before it: zero-stable below 1 + sqrt 2."""


class BDF2(ImplicitMethod):
    """BDF2 with variable steps: second order, L-stable (design 6.1).

    With r = dt/dt_before: tau = dt (1 + r)/(1 + 2r) and w = ((1 + r)^2 x - r^2 x_before)/(1 + 2r), likewise for the
    velocity in y = w + tau w_v. The first step, and any without a history or with r above 2.4, is backward Euler.
    """

    name: ClassVar[str] = "bdf2"
    order: ClassVar[int] = 2
    stage_history: ClassVar[tuple[tuple[str, str], ...]] = (("x_before", "v_before"),)

    def stages(self, dt: float, dt_before: float | None) -> tuple[Stage, ...]:
        """w = x + q (x - x_before), y = w + tau ((1 + q) v - q v_before), q = r^2/(1 + 2r)."""
        if dt_before is None or dt > MOST_RATIO * dt_before:
            return ImplicitEuler().stages(dt, None)
        r = dt / dt_before
        q = r * r / (1.0 + 2.0 * r)
        tau = dt * (1.0 + r) / (1.0 + 2.0 * r)
        return (Stage(tau=tau, w=(-q, 0.0, 0.0), y=(-q, tau * (1.0 + q), -tau * q), start=(0.0, dt, 0.0)),)

    def error(self, dt: float, dt_before: float | None) -> ErrorEstimate:
        """(1 + r)^2/(6 r (1 + 2r)) dt^3 x''', the third derivative from velocities at three times."""
        if dt_before is None or dt > MOST_RATIO * dt_before:
            return ImplicitEuler().error(dt, None)
        r = dt / dt_before
        share = dt * (1.0 + r) / (3.0 * (1.0 + 2.0 * r))
        return ErrorEstimate((-share * (1.0 + r), share * r, share), order=2)
