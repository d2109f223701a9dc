"""The face of methods: what carries out their steps, and how implicit ones make their stages (design 6.1)."""

from dataclasses import dataclass
from typing import ClassVar

from warpdeform.integrators.stepper import Problem, Stepper

Weights = tuple[float, float, float]
"""Weights of (p - x), v and q [1, s, s] in a stage vector that starts from x; p and q are named by the method."""


@dataclass(frozen=True)
class Stage:
    """One stage problem M (z - y)/tau^2 + grad E(z) - f = 0, with stage velocity (z - w)/tau.

    Every vector is x plus weighted differences, never a weighted sum of positions: so float32 keeps its digits far from
    the origin.

    Attributes:
        tau: Stage step [s].
        w: Base of the stage velocity.
        y: Where inertia alone would lead.
        start: The predictor, where Newton starts if its potential is no higher than at the last known position.
        end: Where the stage ends, as a share of the step.
    """

    tau: float
    w: Weights
    y: Weights
    start: Weights
    end: float = 1.0


@dataclass(frozen=True)
class ErrorEstimate:
    """How far positions may be off at the end of a step: the length of weights . (v, q, velocity of the last stage).

    Attributes:
        weights: [s, s, s].
        order: The error of a step falls as dt^(order + 1).
    """

    weights: Weights
    order: int


class Integrator:
    """A method for M x'' + C x' + grad E = f."""

    name: ClassVar[str]
    order: ClassVar[int]
    explicit: ClassVar[bool] = False
    """Nothing is solved; steps are limited by the largest frequency."""

    def stepper(self, problem: Problem) -> Stepper:
        """What carries out the steps of the method.

        Raises:
            InputError: The method cannot run a body or term of the problem.
        """
        raise NotImplementedError


class ImplicitMethod(Integrator):
    """A method whose steps solve stage problems by Newton's method.

    After a start or a disturbance (`dt_before` is None: an impact, a retry, a change from outside) what a method keeps
    of the past does not count: it then takes a safe step that needs none, backward Euler or SDIRK2.
    """

    stage_history: ClassVar[tuple[tuple[str, str], ...]] = (("x", "v"),)
    """Vectors p and q of each stage: "x", "x_before", "x_mid"; "v", "v_before", "v_mid", "a" of the state."""
    searches: ClassVar[bool] = True
    """Newton searches along its direction, and starts at the better of predictor and last position."""
    predicts: ClassVar[bool] = True
    """Newton starts at the predictor at all."""
    iterations: ClassVar[int | None] = None
    """Newton iterations that the method makes whatever the settings say; 0: to tolerance."""
    reflects: ClassVar[bool] = False
    """The stage ends in the middle of the step, x' = 2 z - x, and takes the mean of strains at both ends of it."""

    def stages(self, dt: float, dt_before: float | None) -> tuple[Stage, ...]:
        """The stages of a step.

        Args:
            dt: The step [s].
            dt_before: The step before it [s]; None after a start or a disturbance, where history does not count.
        """
        raise NotImplementedError

    def error(self, dt: float, dt_before: float | None) -> ErrorEstimate:
        """The estimate of the error of that step."""
        raise NotImplementedError

    def stepper(self, problem: Problem) -> Stepper:
        """Newton's method."""
        from warpdeform.integrators.newton import NewtonStepper  # which is written for the methods of this class

        return NewtonStepper(problem, self)
