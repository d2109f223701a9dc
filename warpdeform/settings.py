"""How a simulation is solved: the `[solver]` table of a scene, and fps and gravity of its `[scene]` table."""

import math
from dataclasses import dataclass

from warpdeform.errors import InputError, Mistake

PRECISIONS = ("float32", "float64")
TIME_STEPS = ("auto", "fixed", "adaptive")


@dataclass(frozen=True)
class Settings:
    """Solver settings.

    Attributes:
        integrator: Name of a method in :mod:`warpdeform.integrators`.
        fps: Frames per second [1/s].
        substeps: Steps per frame; dt = 1 / (fps * substeps).
        time_step: "fixed" takes those steps and refuses what is not stable with them; "auto" lets explicit methods take
            as many more as they need; "adaptive" lets implicit ones take as many as keep to `time_tolerance`.
        time_tolerance: Largest error of a position in a step, by the method's own estimate [m], with adaptive steps.
        newton_iterations: Newton iterations per step; 0 iterates to `newton_tolerance`.
        newton_tolerance: Largest node update at which Newton has converged, as a fraction of the node spacing.
        cg_tolerance: Drop of the preconditioned residual norm sqrt(r.z) at which conjugate gradient stops.
        cg_iterations: Cap on the iterations of one linear solve.
        preconditioner: Name of a preconditioner in :mod:`warpdeform.linear`, or "auto".
        precision: "float32" or "float64".
        device: Warp device name ("cpu", "cuda:0"), or "auto": the first CUDA device if there is one.
        threads: Threads that share a step on the CPU; 0 takes one, or all cores (at most eight) for large bodies.
        gravity: Acceleration of gravity [m/s2].
    """

    integrator: str = "bdf2"
    fps: float = 60.0
    substeps: int = 1
    time_step: str = "auto"
    time_tolerance: float = 1e-4
    newton_iterations: int = 1
    newton_tolerance: float = 1e-4
    cg_tolerance: float = 1e-2
    cg_iterations: int = 200
    preconditioner: str = "auto"
    precision: str = "float32"
    device: str = "auto"
    threads: int = 0
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)

    def __post_init__(self) -> None:
        mistakes = []

        def require(key: str, good: bool, problem: str, remedy: str) -> None:
            if not good:
                mistakes.append(Mistake(key, getattr(self, key), problem, remedy))

        def positive(value: float) -> bool:
            return math.isfinite(value) and value > 0

        require("fps", positive(self.fps), "must be a positive number of frames per second", "Use for example 60.")
        require("substeps", self.substeps >= 1, "must be at least 1 step per frame", "Use 1.")
        require("time_step", self.time_step in TIME_STEPS, "is no choice of steps", f"Use {' or '.join(TIME_STEPS)}.")
        require("time_tolerance", positive(self.time_tolerance), "must be positive [m]", "Use for example 1e-4.")
        require("newton_iterations", self.newton_iterations >= 0, "must not be negative", "Use 1, or 0 for tolerance.")
        require("newton_tolerance", positive(self.newton_tolerance), "must be positive", "Use for example 1e-4.")
        require("cg_tolerance", 0 < self.cg_tolerance < 1, "must lie between 0 and 1", "Use for example 1e-2.")
        require("cg_iterations", self.cg_iterations >= 1, "must be at least 1", "Use for example 200.")
        require("precision", self.precision in PRECISIONS, "is not a precision", f"Use {' or '.join(PRECISIONS)}.")
        require("threads", 0 <= self.threads <= 256, "must lie between 0 and 256", "Use 1, or 0 to have it chosen.")
        finite = len(self.gravity) == 3 and all(math.isfinite(g) for g in self.gravity)
        require("gravity", finite, "must be three finite numbers [m/s2]", "Use for example [0, 0, -9.81].")
        if mistakes:
            raise InputError(mistakes)

    @property
    def dt(self) -> float:
        """Time step [s]."""
        return 1.0 / (self.fps * self.substeps)
