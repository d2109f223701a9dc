"""Verlet's method."""

from typing import ClassVar

from warpdeform.integrators.explicit import ExplicitStepper
from warpdeform.integrators.integrator import Integrator
from warpdeform.integrators.stepper import Problem, Stepper


class Verlet(Integrator):
    """Drift for half a step, kick, drift for half a step: explicit, second order, one force a step.

    From step to step it is symplectic Euler with positions half a step ahead of velocities, and as stable. Loads that
    depend on velocities take v + (v - v_before)/2, the velocity of the time where their force acts.
    """

    name: ClassVar[str] = "verlet"
    order: ClassVar[int] = 2
    explicit: ClassVar[bool] = True

    def stepper(self, problem: Problem) -> Stepper:
        """Kick, then drift, between two drifts of half a step."""
        return ExplicitStepper(problem, ahead=0.5, extrapolated=0.5)
