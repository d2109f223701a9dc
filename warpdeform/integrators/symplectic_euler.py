"""Symplectic Euler."""

from typing import ClassVar

from warpdeform.integrators.explicit import ExplicitStepper
from warpdeform.integrators.integrator import Integrator
from warpdeform.integrators.stepper import Problem, Stepper


class SymplecticEuler(Integrator):
    """v' = v + dt a(x, v), x' = x + dt v': explicit, first order, keeps the energy of what does not dissipate.

    Stable below the step 2/omega of the largest frequency omega, which it knows
    (:mod:`warpdeform.integrators.explicit`). An oscillation has sin(omega' dt/2) = omega dt/2 and keeps its amplitude.
    """

    name: ClassVar[str] = "symplectic-euler"
    order: ClassVar[int] = 1
    explicit: ClassVar[bool] = True

    def stepper(self, problem: Problem) -> Stepper:
        """Kick, then drift."""
        return ExplicitStepper(problem, ahead=0.0, extrapolated=0.0)
