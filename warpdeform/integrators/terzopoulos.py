"""The paper's own method, as published, to measure the others against (Terzopoulos et al. 1987, section 6.3)."""

from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

import numpy as np
import warp as wp

from warpdeform.errors import InputError, Mistake
from warpdeform.forces.drag import Drag
from warpdeform.forces.force import Force
from warpdeform.forces.paper_elasticity import PaperElasticity
from warpdeform.forces.parameters import Parameters
from warpdeform.forces.surface_elasticity import SurfaceElasticity
from warpdeform.integrators.control import FixedSteps
from warpdeform.integrators.integrator import Integrator
from warpdeform.integrators.stepper import Problem, Replay, Stepper
from warpdeform.kernels import newton as entries
from warpdeform.launching import choose, do_each
from warpdeform.linear import PRECONDITIONERS, ConjugateGradient, LinearOperator, Sums
from warpdeform.result import OUTCOMES, StepRecord
from warpdeform.state import State

BEHIND, AHEAD, SPEED = range(3)
"""Rows of the weights: the positions one step before, one step of free flight on, and the velocity of the step."""


class Terzopoulos(Integrator):
    """The paper's semi-implicit step with its simplified force; alpha, beta and all other forces are those of t.

        (M/dt^2 + C/(2 dt) + K(r_t)) r_{t+dt} = f_t + (M/dt^2 + C/(2 dt)) r_t + (M/dt - C/2) v_t

    with v_t = (r_t - r_{t-dt})/dt. Where alpha and beta are zero its matrix has no stiffness: it is leap-frog, stable
    below dt = h sqrt(mu/(eta (G + G0))). Under compression the matrix is not positive definite: then the linear solve
    breaks down, which is reported and repeated with half the step.

    It departs from the paper in this: weights of border nodes are halved, as their masses are; nothing crosses
    obstacles; and what the printed step leaves open is told in :mod:`warpdeform.kernels.paper`.
    """

    name: ClassVar[str] = "terzopoulos"
    order: ClassVar[int] = 1
    exact: ClassVar[bool] = False
    """Take the exact gradient of the discrete energy instead of K(r_t) r_t, in the same step."""

    def stepper(self, problem: Problem) -> Stepper:
        """One linear solve a step."""
        mistakes = []
        for state, own in zip(problem.states, problem.terms, strict=True):
            body = state.model.body
            if body.growth is not None:
                problem_ = f"has a rest shape that stays, and that of body {body.name!r} grows"
                mistakes.append(Mistake("integrator", self.name, problem_, "Use bdf2."))
            if not any(isinstance(term, SurfaceElasticity) for term in own):
                problem_ = f"has the paper's force for surfaces only, and body {body.name!r} is a {body.kind}"
                mistakes.append(Mistake("integrator", self.name, problem_, "Use bdf2."))
        if problem.rigid:
            problem_ = "knows no nodes that follow others, as rigid attachments make them"
            mistakes.append(Mistake("integrator", self.name, problem_, "Give the attachment a stiffness, or use bdf2."))
        if problem.guarded:
            problem_ = "takes forces as they are before the step, and contact has to be solved for"
            mistakes.append(Mistake("integrator", self.name, problem_, "Use bdf2 or implicit-euler."))
        if problem.settings.time_step == "adaptive":
            problem_ = f"needs an estimate of the error, and {self.name} has none"
            mistakes.append(Mistake("time_step", "adaptive", problem_, "Use fixed, or another integrator."))
        if mistakes:
            raise InputError(mistakes)
        return PaperStepper(problem, self.exact)


class TerzopoulosExact(Terzopoulos):
    """The paper's step with the exact gradient of the discrete energy as its force: K only in the matrix."""

    name: ClassVar[str] = "terzopoulos-exact"
    exact: ClassVar[bool] = True


class PaperStepper(Stepper):
    """Solves the linear system of each step by conjugate gradient, without a preconditioner that could hide its signs.

    Written for what the step adds to free flight, d = r_{t+dt} - y with y = r_t + dt v_t, so that the tolerance of the
    solve takes nothing from the velocity:

        (M/dt^2 + C/(2 dt) + K) d = f_t - e - C (y - r_{t-dt})/(2 dt),    e = K(r_t) y

    Args:
        problem: What is to be carried.
        exact: e is the exact gradient of the discrete energy at r_t, plus K(r_t) (y - r_t).
    """

    preconditioner_name = "none"

    def __init__(self, problem: Problem, exact: bool) -> None:
        super().__init__(problem)
        self._exact, device = exact, self._device
        self._paper = [
            PaperElasticity(s.model.grid, s.layout, s.model.body.shape.positions, s.model.body.material, s.real, device)
            for s in self.states
        ]
        self._damping = [[term for term in own if isinstance(term, Drag)] for own in self.terms]
        pairs = zip(self._paper, self._damping, strict=True)
        self.operator = LinearOperator(self.states, [[paper, *damping] for paper, damping in pairs])
        self.sums = Sums(self.states)
        preconditioner = PRECONDITIONERS[self.preconditioner_name](self.operator)
        settings = self.settings
        self.linear_solver = ConjugateGradient(
            self.operator, preconditioner, self.sums, settings.cg_tolerance, settings.cg_iterations
        )
        self._scalars: wp.array = wp.zeros(entries.STEP_SCALARS, dtype=wp.float64, device=device)
        self._state: wp.array = wp.zeros(entries.STEP_STATE, dtype=wp.int32, device=device)
        self._impact: wp.array = wp.zeros(1, dtype=wp.int32, device=device)
        self._accepted = self._state[entries.ACCEPTED : entries.ACCEPTED + 1]
        control = [0.0, 0.0, 0.0, self._most_speed]
        self._control: wp.array = wp.array(control, dtype=wp.float64, device=device)
        self._weights = {s.real: Parameters(np.zeros((3, 3)), s.real, device) for s in self.states}
        self._rate = {s.real: Parameters([1.0], s.real, device) for s in self.states}
        self._steps = FixedSteps()

    def recordings(self) -> Mapping[str, Callable[[], None]]:
        return {"step": self._record}

    def rehearse(self) -> None:
        self._prepare(0.0, self.settings.dt, self.settings.dt)
        self._record()

    def advance(self, start: float, end: float, steps: int, replay: Replay) -> list[StepRecord]:
        attempts = []
        self._steps.begin(start, end, steps * self.settings.dt)
        while not (self._steps.over or self._steps.given_up):
            begin, until, dt = self._steps.step
            self._prepare(begin, until, dt)
            replay("step")
            attempts.append(self._report(begin, dt))
            self._steps.judge(attempts[-1])
        return attempts

    def reset(self) -> None:
        super().reset()
        self._steps.reset()

    def bytes(self) -> int:
        return self.operator.bytes() + sum(paper.bytes() for paper in self._paper)

    def _prepare(self, start: float, end: float, dt: float) -> None:
        """Write what changes from step to step into device arrays (host)."""
        self.operator.set_tau(dt)
        for real in self._weights:
            self._weights[real].write([(0.0, -dt, 0.0), (0.0, dt, 0.0), (0.0, 0.0, 1.0)])
            self._rate[real].write([1.0 / dt])
        self._place_targets(end)
        for own in self.terms:
            for term in own:
                # Damping is the paper's C, by central differences from r_{t-dt}; other forces are those of t, but for
                # moving obstacles, which are to be out of the way at the end.
                damping = isinstance(term, Drag)
                term.prepare(end if term.most_steps == 1 else start, dt, 2.0 * dt if damping else dt)
        for coupling in self._couplings:
            coupling.prepare(start, dt, dt)

    def _record(self) -> None:
        do_each(lambda thread: self._flush("enter_step", thread))
        self._decide("begin_step", self._scalars, self._state, self._iteration, self._impact)
        for state, own, paper in zip(self.states, self.terms, self._paper, strict=True):
            self._make_system(state, own, paper)
        self._couple("x")
        for state in self.states:
            self._lanes(state, "mask", state.free, state.gradient)
        self.operator.update()
        self.linear_solver.solve()
        for state, own in zip(self.states, self.terms, strict=True):
            self._stage(state, "displace", self._scalars, state.y, state.direction, state.y)
            self._stage(state, "difference", state.y, state.z, state.direction)
            for term in own:
                term.guard(state, state.z, state.direction)
            self._stage(state, "displace", self._scalars, state.z, state.direction, state.z)
            weights = self._weights[state.real].array
            vectors = (state.free, state.v, state.v, state.z, state.x)
            self._stage(state, "estimate", weights, SPEED, self._rate[state.real].array, *vectors, state.dots)
        self.sums.greatest_dots(entries.SPEED, self._scalars)
        solver = self.linear_solver
        self._decide("judge_solve", solver.state, solver.cap, self._control, self._scalars, self._state)
        choose(self._accepted, self._accept, None)
        do_each(lambda thread: self._flush("leave_step", thread))

    def _make_system(self, state: State, terms: Sequence[Force], paper: PaperElasticity) -> None:
        """The matrix at r_t, and minus its right hand side into the gradient."""
        weights = self._weights[state.real].array
        history = (state.x, state.x, state.v, state.v)
        self._stage(state, "combine", weights, BEHIND, *history, state.w)
        self._stage(state, "combine", weights, AHEAD, *history, state.y)
        self._lanes(state, "copy", state.x, state.z)
        for vector in (state.y, state.z):
            self._stage(state, "place_pins", state.free, state.model.target, vector)
        for term in terms:
            term.begin(state)
            term.carry(state, state.z)
        paper.linearise(state, state.x)
        self._lanes(state, "clear", state.gradient)
        for term in terms:
            if term.elastic and not self._exact:
                paper.add_gradient(state, state.y, state.gradient)
                continue
            position = state.y if isinstance(term, Drag) else state.x
            term.linearise(state, position)
            term.add_gradient(state, position, state.gradient)
        if self._exact:
            self._stage(state, "difference", state.y, state.x, state.direction)
            paper.add_hessian_product(state, state.direction, state.gradient)

    def _accept(self) -> None:
        for state, own in zip(self.states, self.terms, strict=True):
            self._lanes(state, "copy", state.x, state.w)
            self._stage(state, "accept", self._rate[state.real].array, state.z, state.w, state.x, state.v)
            for term in own:
                term.finish(state)

    def _report(self, start: float, dt: float) -> StepRecord:
        state = self._state.numpy()
        completed = bool(state[entries.ACCEPTED])
        return StepRecord(
            outcome=OUTCOMES[int(state[entries.OUTCOME])],
            newton_iterations=1,
            cg_iterations=int(state[entries.CG_TOTAL]),
            cg_breakdowns=int(state[entries.CG_BREAKDOWNS]),
            cg_capped=int(state[entries.CG_CAPPED]),
            completed=completed,
            steps=int(completed),
            retries=int(not completed),
            start=start,
            dt=dt,
        )
