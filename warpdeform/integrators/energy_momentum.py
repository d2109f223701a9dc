"""The energy-momentum method: the midpoint rule with a discrete gradient."""

from typing import ClassVar

from warpdeform.errors import InputError, Mistake
from warpdeform.integrators.integrator import ErrorEstimate, ImplicitMethod, Stage
from warpdeform.integrators.stepper import Problem, Stepper


class EnergyMomentum(ImplicitMethod):
    """Energy-momentum (Simo and Tarnow 1992): second order, keeps energy, momentum and angular momentum of free bodies.

    z is the middle of the step; stresses are those of the mean of the strains at both ends, so that the work of the
    elastic force is what the energy changes by. That holds for strains quadratic in the positions (membranes, solids)
    and only as far as Newton converges: so it iterates to its tolerance, without a search, because the mean force has
    no potential. Forces that are neither constant nor linear in the positions (pressure) are those at the middle.

    Not offered with bending, whose curvatures are not quadratic, nor with obstacles, which hold back the middle of the
    step and not its end.
    """

    name: ClassVar[str] = "energy-momentum"
    order: ClassVar[int] = 2
    stage_history: ClassVar[tuple[tuple[str, str], ...]] = (("x_before", "v_before"),)
    searches: ClassVar[bool] = False
    iterations: ClassVar[int | None] = 0
    reflects: ClassVar[bool] = True

    def stages(self, dt: float, dt_before: float | None) -> tuple[Stage, ...]:
        """tau = dt/2, w = x, y = x + tau v."""
        ahead = (0.0, 0.5 * dt, 0.0)
        return (Stage(tau=0.5 * dt, w=(0.0, 0.0, 0.0), y=ahead, start=ahead, end=0.5),)

    def error(self, dt: float, dt_before: float | None) -> ErrorEstimate:
        """dt^3 x'''/12, the third derivative from velocities at three times; v' = 2 (velocity of the stage) - v."""
        if dt_before is None:
            # dt^2 a/2 is the error of a method of first order: too cautious.
            return ErrorEstimate((-dt, 0.0, dt), order=1)
        r = dt / dt_before
        share = dt * r / (6.0 * (1.0 + r))
        return ErrorEstimate((-share * (2.0 + r), share * r, 2.0 * share), order=2)

    def stepper(self, problem: Problem) -> Stepper:
        mistakes = []
        for own in problem.terms:
            for term in own:
                if term.elastic and not term.quadratic:
                    problem_, remedy = "conserves energy only of membranes and solids, not of bending", "Use bdf2."
                    mistakes.append(Mistake("integrator", self.name, problem_, remedy))
                if term.name == "obstacles":
                    problem_ = "cannot keep bodies out of obstacles: they hold back the middle of its steps"
                    mistakes.append(Mistake("integrator", self.name, problem_, "Use bdf2 or tr-bdf2."))
        if problem.guarded:
            problem_ = "cannot forbid crossing: contact holds back the middle of its steps"
            mistakes.append(Mistake("integrator", self.name, problem_, "Use bdf2 or tr-bdf2."))
        if mistakes:
            raise InputError(list(dict.fromkeys(mistakes)))
        return super().stepper(problem)
