"""What steps and runs report."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any


class Outcome(Enum):
    """How a step ended; the value is the sentence for people."""

    CONVERGED = "Newton converged: the largest update is below the tolerance."
    ROUND_OFF = "Newton ended at round-off: the potential cannot be lowered in this precision."
    FIXED = "Newton made the number of iterations that the settings ask for."
    CAPPED = "Newton reached its cap before the tolerance."
    STALLED = "Newton stopped: no step along its direction lowers the potential."
    BROKEN = "The linear solve broke down: its matrix is not positive definite."
    INACCURATE = "The error of the step, as the method estimates it, is above the tolerance."
    NOT_FINITE = "The step is not finite."
    EXPLICIT = "Nothing was solved: the step is explicit."
    RUNAWAY = "A node moves faster than anybody would believe."
    BLOCKED = "Pins cannot follow their path: bodies in contact leave them no way."
    TOO_LONG = "The step is longer than those that are stable."


OUTCOMES = {
    1: Outcome.CONVERGED,
    2: Outcome.ROUND_OFF,
    3: Outcome.FIXED,
    4: Outcome.CAPPED,
    5: Outcome.NOT_FINITE,
    6: Outcome.STALLED,
    7: Outcome.BROKEN,
    8: Outcome.INACCURATE,
    9: Outcome.RUNAWAY,
    10: Outcome.BLOCKED,
}
"""Outcomes by the codes of :mod:`warpdeform.kernels.newton`."""


REMEDIES = {
    Outcome.BROKEN: "Use an integrator that projects its matrix (bdf2), more substeps, or precision float64.",
    Outcome.INACCURATE: "Use a larger time_tolerance, or precision float64.",
    Outcome.CAPPED: "Use more substeps, a larger newton_tolerance, or another integrator.",
    Outcome.NOT_FINITE: "Use more substeps, precision float64, or softer materials and slower obstacles.",
    Outcome.BLOCKED: "Use a path that leaves room, softer or thinner bodies, or more substeps.",
    Outcome.RUNAWAY: "Use an integrator that is stable at any step (bdf2), or more substeps.",
    Outcome.STALLED: "Use precision float64, a larger newton_tolerance, or more substeps.",
    Outcome.TOO_LONG: 'Use more substeps, or time_step = "auto".',
}
"""What to do where a run has to end with an outcome."""


FAR = 1e30
"""Distance of what is not near [m]."""


@dataclass(frozen=True)
class ContactStep:
    """What contact reports of one step.

    Attributes:
        pairs: Pairs that feel each other at its end.
        lost: Pairs that did not fit into the lists; forces miss them, the guard does not.
        guard_active: Share of the nodes that the guard pushed, mean over the updates of the step.
        shortened: Updates that the guard shortened as a whole.
        smallest_distance: Of skins that feel each other [m]; `FAR` where nothing is near.
        lag: How far behind their targets pinned nodes are [m].
    """

    pairs: int
    lost: int
    guard_active: float
    shortened: int
    smallest_distance: float
    lag: float


def joined_contacts(steps: Sequence[ContactStep]) -> ContactStep | None:
    """Steps in a row as one: the pairs at the end, counts added up, the mean activity and the smallest distance."""
    if not steps:
        return None
    return ContactStep(
        pairs=steps[-1].pairs,
        lost=sum(step.lost for step in steps),
        guard_active=sum(step.guard_active for step in steps) / len(steps),
        shortened=sum(step.shortened for step in steps),
        smallest_distance=min(step.smallest_distance for step in steps),
        lag=steps[-1].lag,
    )


@dataclass
class ContactRecord:
    """What contact reports of a run.

    Attributes:
        pairs: Most pairs that feel each other at the end of a step.
        lost: Pairs that did not fit into the lists, in all.
        guard_active: Share of the nodes that the guard pushed, mean over all steps.
        guard_active_most: The same of the worst step.
        shortened: How often the guard made all of an update shorter.
        smallest_distance: Smallest distance of skins that feel each other, of any step [m]; None if nothing was near.
        crossings: Edges through triangles, the most in any frame and at the end; None if nobody counted.
        relaxed: How far nodes were moved before the start at most, to take overlaps away [m]; None if nobody asked.
    """

    pairs: int = 0
    lost: int = 0
    guard_active: float = 0.0
    guard_active_most: float = 0.0
    shortened: int = 0
    smallest_distance: float | None = None
    crossings: list[int] | None = None
    relaxed: float | None = None
    _steps: int = 0

    def as_dict(self) -> dict[str, float | int | list[int] | None]:
        """As plain numbers."""
        return {key: value for key, value in vars(self).items() if key[0] != "_"}

    def add_step(self, step: ContactStep) -> None:
        """Book one step."""
        self._steps += 1
        self.pairs, self.lost = max(self.pairs, step.pairs), self.lost + step.lost
        self.guard_active += (step.guard_active - self.guard_active) / self._steps
        self.guard_active_most = max(self.guard_active_most, step.guard_active)
        self.shortened += step.shortened
        if step.smallest_distance < FAR:
            known = step.smallest_distance if self.smallest_distance is None else self.smallest_distance
            self.smallest_distance = min(known, step.smallest_distance)


@dataclass(frozen=True)
class StepRecord:
    """An attempt at a step, or several steps in a row.

    Attributes:
        outcome: How the last of them ended.
        newton_iterations: Newton iterations.
        cg_iterations: Conjugate gradient iterations, all Newton iterations together.
        cg_breakdowns: Linear solves that met a direction without positive curvature, or a non-finite number.
        cg_capped: Linear solves that reached the cap before the tolerance.
        residual: Largest unbalanced force over node mass [N/kg]; 0 where nothing is solved.
        work: Work of pins, wind and drag on the bodies [J].
        impact_ahead: A node is about to hit an obstacle: the next step starts afresh, without history.
        completed: The state has moved on; else it is what it was before the attempt.
        steps: Steps that were completed.
        retries: Attempts that were not.
        start: Where it began [s].
        dt: Length of a step [s].
        error: Largest error of a position that the step has made, by the method's own estimate [m].
        error_order: The estimate falls as dt^(order + 1); 0 where there is none.
        unsolved: Root mean square over the nodes, by mass, of how far the last linear solve has left positions from its
            solution, as its own residual has it [m].
        contact: What contact reports of it; None where nothing feels anything.
    """

    outcome: Outcome
    newton_iterations: int = 0
    cg_iterations: int = 0
    cg_breakdowns: int = 0
    cg_capped: int = 0
    residual: float = 0.0
    work: float = 0.0
    impact_ahead: bool = False
    completed: bool = True
    steps: int = 1
    retries: int = 0
    start: float = 0.0
    dt: float = 0.0
    error: float = 0.0
    error_order: int = 0
    unsolved: float = 0.0
    contact: ContactStep | None = None


ORDINARY = (Outcome.CONVERGED, Outcome.FIXED, Outcome.EXPLICIT)
"""Outcomes that need no mention."""


def joined(attempts: Sequence[StepRecord]) -> StepRecord:
    """Attempts in a row as one record: counts and works added up, the worst residual, and how the last one ended."""
    last = attempts[-1]
    if len(attempts) == 1:
        return last
    counts = {
        name: sum(getattr(attempt, name) for attempt in attempts)
        for name in ("newton_iterations", "cg_iterations", "cg_breakdowns", "cg_capped", "work", "steps", "retries")
    }
    worst = {name: max(getattr(attempt, name) for attempt in attempts) for name in ("residual", "error", "unsolved")}
    contact = joined_contacts([attempt.contact for attempt in attempts if attempt.contact and attempt.completed])
    return replace(last, **counts, **worst, start=attempts[0].start, contact=contact)


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
        steps: Time steps.
        wall_s: Time for stepping and writing, without imports and compiling [s].
        setup_s: Time before the first step: imports, compiling, building [s].
        newton_iterations: Newton iterations in all.
        cg_iterations: Conjugate gradient iterations in all.
        newton_unconverged: Steps whose Newton iteration was to converge and did not.
        cg_breakdowns: Linear solves that broke down.
        cg_capped: Linear solves that reached their cap before the tolerance.
        retries: Attempts at a step that were not completed, and repeated with a smaller time step.
        outcomes: How many steps, and attempts at steps, ended how: the names of :class:`Outcome` in lower case.
        error_estimate: What the run has added up [m]: `time_step`, the largest errors of each step by the method's own
            estimate, which bounds nothing but is of the size of the error at the end of short runs; `linear_solve`,
            the root mean square of what each step's last linear solve has left undone.
        max_residual: Largest unbalanced force over node mass of any step [N/kg].
        max_stretch: Longest edge over its rest length, of all frames.
        energy: Energies at the end [J].
        device: Device name.
        precision: "float32" or "float64".
        integrator: Name of the integrator.
        output: File written, or an empty string.
        contact: What contact reports; None where bodies feel neither each other nor themselves.
    """

    frames: int = 0
    nodes: int = 0
    sim_s: float = 0.0
    steps: int = 0
    wall_s: float = 0.0
    setup_s: float = 0.0
    newton_iterations: int = 0
    cg_iterations: int = 0
    newton_unconverged: int = 0
    cg_breakdowns: int = 0
    cg_capped: int = 0
    retries: int = 0
    outcomes: dict[str, int] = field(default_factory=dict)
    error_estimate: dict[str, float] = field(default_factory=lambda: {"time_step": 0.0, "linear_solve": 0.0})
    max_residual: float = 0.0
    max_stretch: float = 1.0
    energy: Energy = field(default_factory=Energy)
    device: str = ""
    precision: str = ""
    integrator: str = ""
    output: str = ""
    contact: ContactRecord | None = None

    def as_dict(self) -> dict[str, Any]:
        """The record as plain numbers, strings and dicts of them."""
        nested = {name: dict(getattr(self, name)) for name in ("outcomes", "error_estimate")}
        contact = None if self.contact is None else self.contact.as_dict()
        return {**vars(self), **nested, "energy": dict(vars(self.energy)), "contact": contact}

    def add_step(self, step: StepRecord) -> None:
        """Book one attempt at a step, or several steps in a row."""
        self.steps += step.steps
        self.retries += step.retries
        ended = step.outcome.name.lower()
        self.outcomes[ended] = self.outcomes.get(ended, 0) + step.steps + step.retries
        if step.completed:
            self.error_estimate["time_step"] += step.error
            self.error_estimate["linear_solve"] += step.unsolved
            if step.contact is not None:
                self.contact = self.contact or ContactRecord()
                self.contact.add_step(step.contact)
        self.newton_iterations += step.newton_iterations
        self.cg_iterations += step.cg_iterations
        self.newton_unconverged += step.outcome in (Outcome.CAPPED, Outcome.STALLED)
        self.cg_breakdowns += step.cg_breakdowns
        self.cg_capped += step.cg_capped
        self.max_residual = max(self.max_residual, step.residual)
        self.energy.work_in += step.work
