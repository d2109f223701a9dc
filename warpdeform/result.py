"""What steps and runs report."""

from dataclasses import dataclass, field
from enum import Enum
from typing import Any


class Outcome(Enum):
    """How the Newton iteration of a step ended; the value is the sentence for people."""

    CONVERGED = "Newton converged: the largest update is below the tolerance."
    ROUND_OFF = "Newton ended at round-off: the potential cannot be lowered in this precision."
    FIXED = "Newton made the number of iterations that the settings ask for."
    CAPPED = "Newton reached its cap before the tolerance."
    STALLED = "Newton stopped: no step along its direction lowers the potential."
    NOT_FINITE = "The step is not finite."


OUTCOMES = {
    1: Outcome.CONVERGED,
    2: Outcome.ROUND_OFF,
    3: Outcome.FIXED,
    4: Outcome.CAPPED,
    5: Outcome.NOT_FINITE,
    6: Outcome.STALLED,
}
"""Outcomes by the codes of :mod:`warpdeform.kernels.newton`."""


@dataclass(frozen=True)
class StepRecord:
    """One step.

    Attributes:
        outcome: How Newton ended.
        newton_iterations: Newton iterations.
        cg_iterations: Conjugate gradient iterations, all Newton iterations together.
        cg_breakdowns: Linear solves that met a direction without positive curvature, or a non-finite number.
        cg_capped: Linear solves that reached the cap before the tolerance.
        residual: Largest unbalanced force over node mass [N/kg].
        work: Work of pins, wind and drag on the bodies [J].
        impact_ahead: A node is about to hit an obstacle: the next step starts afresh, without history.
    """

    outcome: Outcome
    newton_iterations: int
    cg_iterations: int
    cg_breakdowns: int
    cg_capped: int
    residual: float
    work: float
    impact_ahead: bool = False


@dataclass
class Energy:
    """Energies [J] of all bodies.

    Attributes:
        kinetic: Kinetic energy.
        elastic: Elastic energy.
        gravity: Potential of gravity, zero at the origin.
        field: Potential of obstacle fields and springs.
        work_in: Work that pins, wind and drag have done since the start; friction, moving obstacles, moving springs and
            growth are not counted.
    """

    kinetic: float = 0.0
    elastic: float = 0.0
    gravity: float = 0.0
    field: float = 0.0
    work_in: float = 0.0


@dataclass
class RunRecord:
    """A whole run: the record that `warpdeform run --json` prints (design 4.4).

    Attributes:
        frames: Frames written, the initial state included.
        nodes: Nodes of all bodies.
        sim_s: Simulated time [s].
        wall_s: Time for stepping and writing, without imports and compiling [s].
        setup_s: Time before the first step: imports, compiling, building [s].
        newton_iterations: Newton iterations in all.
        cg_iterations: Conjugate gradient iterations in all.
        newton_unconverged: Steps whose Newton iteration was to converge and did not.
        cg_breakdowns: Linear solves that broke down.
        cg_capped: Linear solves that reached their cap before the tolerance.
        retries: Steps repeated with a smaller time step.
        max_residual: Largest unbalanced force over node mass of any step [N/kg].
        max_stretch: Longest edge over its rest length, of all frames.
        energy: Energies at the end [J].
        device: Device name.
        precision: "float32" or "float64".
        integrator: Name of the integrator.
        output: File written, or an empty string.
    """

    frames: int = 0
    nodes: int = 0
    sim_s: float = 0.0
    wall_s: float = 0.0
    setup_s: float = 0.0
    newton_iterations: int = 0
    cg_iterations: int = 0
    newton_unconverged: int = 0
    cg_breakdowns: int = 0
    cg_capped: int = 0
    retries: int = 0
    max_residual: float = 0.0
    max_stretch: float = 1.0
    energy: Energy = field(default_factory=Energy)
    device: str = ""
    precision: str = ""
    integrator: str = ""
    output: str = ""

    def as_dict(self) -> dict[str, Any]:
        """The record as plain numbers, strings and one nested dict."""
        return {**vars(self), "energy": dict(vars(self.energy))}

    def add_step(self, step: StepRecord) -> None:
        """Book one step."""
        self.newton_iterations += step.newton_iterations
        self.cg_iterations += step.cg_iterations
        self.newton_unconverged += step.outcome in (Outcome.CAPPED, Outcome.STALLED)
        self.cg_breakdowns += step.cg_breakdowns
        self.cg_capped += step.cg_capped
        self.max_residual = max(self.max_residual, step.residual)
        self.energy.work_in += step.work
