"""The two-step backward differentiation formula."""

from typing import ClassVar

from warpdeform.integrators.implicit_euler import ImplicitEuler
from warpdeform.integrators.integrator import Integrator, Stage


class BDF2(Integrator):
    """BDF2 with variable steps: second order, L-stable (design 6.1).

    With r = dt/dt_before: tau = dt (1 + r)/(1 + 2r) and w = ((1 + r)^2 x - r^2 x_before)/(1 + 2r), likewise for the
    velocity in y = w + tau w_v. The first step, and any without a history, is backward Euler.
    """

    name: ClassVar[str] = "bdf2"
    order: ClassVar[int] = 2

    def stage(self, dt: float, dt_before: float | None) -> Stage:
        """w = x + q (x - x_before), y = w + tau ((1 + q) v - q v_before), q = r^2/(1 + 2r)."""
        if dt_before is None:
            return ImplicitEuler().stage(dt, None)
        r = dt / dt_before
        q = r * r / (1.0 + 2.0 * r)
        tau = dt * (1.0 + r) / (1.0 + 2.0 * r)
        return Stage(tau=tau, w=(q, 0.0, 0.0), y=(q, tau * (1.0 + q), -tau * q), start=(0.0, dt, 0.0))
