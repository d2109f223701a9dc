"""Backward Euler."""

from typing import ClassVar

from warpdeform.integrators.integrator import ErrorEstimate, ImplicitMethod, Stage


class ImplicitEuler(ImplicitMethod):
    """Backward Euler: first order, L-stable, damps an oscillation by (1 + w^2 dt^2)^(-1/2) a step."""

    name: ClassVar[str] = "implicit-euler"
    order: ClassVar[int] = 1

    def stages(self, dt: float, dt_before: float | None) -> tuple[Stage, ...]:
        """w = x, y = x + dt v."""
        free_flight = (0.0, dt, 0.0)
        return (Stage(tau=dt, w=(0.0, 0.0, 0.0), y=free_flight, start=free_flight),)

    def error(self, dt: float, dt_before: float | None) -> ErrorEstimate:
        """dt (v' - v)/2 = dt^2 a/2: what x' = x + dt v' adds to Taylor's second term."""
        return ErrorEstimate((-0.5 * dt, 0.0, 0.5 * dt), order=1)
