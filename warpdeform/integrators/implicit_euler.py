"""Backward Euler."""

from typing import ClassVar

from warpdeform.integrators.integrator import Integrator, Stage


class ImplicitEuler(Integrator):
    """Backward Euler: first order, L-stable, damps an oscillation by (1 + w^2 dt^2)^(-1/2) a step."""

    name: ClassVar[str] = "implicit-euler"
    order: ClassVar[int] = 1

    def stage(self, dt: float, dt_before: float | None) -> Stage:
        """w = x, y = x + dt v."""
        free_flight = (0.0, dt, 0.0)
        return Stage(tau=dt, w=(0.0, 0.0, 0.0), y=free_flight, start=free_flight)
