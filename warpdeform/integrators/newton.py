"""The one solver of every implicit method: projected Newton on the incremental potential, all of it on the device.

One stage, in the order in which it is recorded (design 2.1, 5.1, 6.1); a step has one or two:

    w, y, predictor from what the method keeps of the past; pins to their targets
    start: the last positions carried out of the way of moving obstacles, or - if its potential is no higher - the
           predictor, reached by a displacement that the obstacles' guard has clipped
    Newton: linearise, gradient, conjugate gradient, guard, Armijo search, stop test
    end: residual, work of the loads; of a first stage position and velocity; of the last one whether the step counts,
         and if it does: new state, friction anchors; whether the next step meets an impact, which a method with a
         history must not extrapolate through

Each stage is a recording of its own: its loads are those of its own time, which the host writes beforehand. Steps that
do not count leave the state as it was, and are repeated as their control says (:mod:`warpdeform.integrators.control`).
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import warp as wp

from warpdeform.errors import Mistake
from warpdeform.forces.force import Force
from warpdeform.forces.parameters import Parameters
from warpdeform.integrators.control import AdaptiveSteps, FixedSteps, StepControl
from warpdeform.integrators.integrator import ImplicitMethod
from warpdeform.integrators.rounding import MOST_LOST, worst_fall
from warpdeform.integrators.stepper import Problem, Replay, Stepper
from warpdeform.kernels import newton as entries
from warpdeform.launching import choose, do_each, repeat_while
from warpdeform.linear import ConjugateGradient, LinearOperator, Sums, choose_preconditioner
from warpdeform.result import OUTCOMES, Outcome, StepRecord
from warpdeform.state import State

NEWTON_CAP = 400
"""Most Newton iterations of a stage that iterates to a tolerance: slender strips that bend far need 160."""
IMPACT_ITERATIONS = 4
"""Fewest Newton iterations of a step that meets an impact: one cannot tell the part that is stopped from the rest."""
ULPS = 8.0
"""Relative round-off of a potential, in units of the precision's epsilon: a sum of products of differences."""

W, Y, START, NEXT, ERROR, SPEED = range(6)
"""Rows of the weights that make the stage vectors, the prediction for the next step, and the lengths of the estimate of
the error and of the velocity."""


class NewtonStepper(Stepper):
    """Solves the stage problems of steps for all bodies at once.

    Args:
        problem: What is to be carried.
        method: Says how stages are made.
    """

    def __init__(self, problem: Problem, method: ImplicitMethod) -> None:
        super().__init__(problem)
        self.method = method
        settings, device = self.settings, self._device
        # What stores no energy comes first, so that its work can be told from the rest of the gradient.
        self._loads = [[term for term in own if not term.energy_kind] for own in self.terms]
        self._stored = [[term for term in own if term.energy_kind] for own in self.terms]
        self.operator = LinearOperator(self.states, self.terms, problem.couplings, problem.rigid)
        self.sums = Sums(self.states)
        self.preconditioner = choose_preconditioner(settings.preconditioner, self.operator)
        self.preconditioner_name = self.preconditioner.name
        self.linear_solver = ConjugateGradient(
            self.operator, self.preconditioner, self.sums, settings.cg_tolerance, settings.cg_iterations
        )
        self._scalars: wp.array = wp.zeros(entries.STEP_SCALARS, dtype=wp.float64, device=device)
        self._impact: wp.array = wp.zeros(1, dtype=wp.int32, device=device)
        self._state: wp.array = wp.zeros(entries.STEP_STATE, dtype=wp.int32, device=device)
        self._newton_active = self._state[entries.NEWTON_ACTIVE : entries.NEWTON_ACTIVE + 1]
        self._search_active = self._state[entries.SEARCH_ACTIVE : entries.SEARCH_ACTIVE + 1]
        self._accepted = self._state[entries.ACCEPTED : entries.ACCEPTED + 1]
        epsilon = np.finfo(np.float32 if settings.precision == "float32" else np.float64).eps
        spacing = min(state.model.spacing for state in self.states)
        adaptive = settings.time_step == "adaptive"
        time_tolerance = settings.time_tolerance if adaptive else np.inf
        control = [ULPS * epsilon, settings.newton_tolerance * spacing, time_tolerance, self._most_speed]
        self._control: wp.array = wp.array(control, dtype=wp.float64, device=device)
        iterations = settings.newton_iterations if method.iterations is None else method.iterations
        if iterations != settings.newton_iterations:
            self.notes = (f"{method.name} {_iterates(iterations)}; newton_iterations is for other integrators.",)
        to_tolerance = iterations == 0
        self._settled = [NEWTON_CAP if to_tolerance else iterations, int(to_tolerance), 0]
        fewest = IMPACT_ITERATIONS if method.searches else 1
        self._hit = [max(self._settled[0], fewest), int(to_tolerance), 1]
        self._limits = Parameters(self._settled, wp.int32, device)
        self._weights = {s.real: Parameters(np.zeros((6, 3)), s.real, device) for s in self.states}
        self._rate = {s.real: Parameters([1.0], s.real, device) for s in self.states}
        self._mass = sum(float(state.model.node_mass.sum()) for state in self.states)
        self._steps: StepControl = AdaptiveSteps(settings.time_tolerance) if adaptive else FixedSteps()
        self._dt_before: float | None = None
        self._impact_ahead = False

    def recordings(self) -> Mapping[str, Callable[[], None]]:
        return {f"stage {k}": lambda k=k: self._record(k) for k in range(self._stages)}  # type: ignore[misc]

    def rehearse(self) -> None:
        """A step of one Newton and one conjugate gradient iteration: every kernel, whatever the settings."""
        cap = self.linear_solver.cap.numpy().copy()
        self.linear_solver.cap.assign([1])
        for k in range(self._stages):
            self._prepare(k, 0.0, self.settings.dt, self.settings.dt)
            self._limits.write([1, 0, 0])
            self._record(k)
        self.linear_solver.cap.assign(cap)

    def advance(self, start: float, end: float, steps: int, replay: Replay) -> list[StepRecord]:
        attempts = []
        self._steps.begin(start, end, steps * self.settings.dt)
        while not (self._steps.over or self._steps.given_up):
            attempts.append(self._attempt(*self._steps.step, replay))
            self._steps.judge(attempts[-1])
        return attempts

    def mistakes(self, replay: Replay) -> list[Mistake]:
        """Steps in float32 that round falls away."""
        settings, dt = self.settings, self.settings.dt
        if settings.precision != "float32":
            return []
        tau = min(stage_.tau for stage_ in self.method.stages(dt, dt))
        found = worst_fall(self.states, settings.gravity, tau)
        if found.share >= 1.0:
            return [found.mistake()]
        if found.share > MOST_LOST:
            self.notes = (*self.notes, found.note())
        return []

    def restart(self) -> None:
        self._dt_before, self._impact_ahead = None, False

    def reset(self) -> None:
        super().reset()
        self._steps.reset()
        self.preconditioner.reset()

    def bytes(self) -> int:
        return self.operator.bytes() + self.preconditioner.bytes()

    @property
    def _stages(self) -> int:
        return len(self.method.stage_history)

    def _attempt(self, start: float, end: float, dt: float, replay: Replay) -> StepRecord:
        """One step; the next one follows it only if it counts."""
        for k in range(self._stages):
            self._prepare(k, start, end, dt)
            replay(f"stage {k}")
        report = self._report(start, dt)
        if report.completed:
            # The step of an impact and the one after it take no history: it would carry on the speed from before.
            self._dt_before = None if report.impact_ahead or self._impact_ahead else dt
            self._impact_ahead = report.impact_ahead
        elif report.outcome is not Outcome.INACCURATE:
            self._dt_before = None
        return report

    def _prepare(self, k: int, start: float, end: float, dt: float) -> None:
        """Write what changes from stage to stage into device arrays (host, before the recorded stage is replayed)."""
        if k == 0:
            self._place_targets(end)
            self._plan = self.method.stages(dt, self._dt_before), self.method.error(dt, self._dt_before)
        stage_, error = self._plan[0][k], self._plan[1]
        time = end if stage_.end == 1.0 else start + stage_.end * dt
        self._limits.write(self._hit if self._impact_ahead else self._settled)
        self._tau = stage_.tau
        self.operator.set_tau(stage_.tau)
        rows = [stage_.w, stage_.y, stage_.start, (0.0, dt, 0.0), error.weights, (0.0, 0.0, 1.0)]
        for real in self._weights:
            self._weights[real].write(rows)
            self._rate[real].write([1.0 / stage_.tau])
        for state, own in zip(self.states, self.terms, strict=True):
            state.model.move_targets(end if self.method.reflects else time)
            for term in own:
                term.prepare(time, time - start, stage_.tau)
        for coupling in self._couplings:
            coupling.prepare(time, time - start, stage_.tau)

    def _record(self, k: int) -> None:
        """Launch stage k of a step; nothing in it asks the host."""
        do_each(lambda thread: self._flush("enter_step", thread))
        if k == 0:
            self._decide("begin_step", self._scalars, self._state, self._iteration, self._impact)
        else:
            self._decide("begin_stage", self._scalars, self._state, self._iteration)
        self._start(k)
        repeat_while(self._newton_active, self._iterate)
        self._finish(k)
        do_each(lambda thread: self._flush("leave_step", thread))

    def _report(self, start: float, dt: float) -> StepRecord:
        """What the last step reported (host; the one read of device memory between steps)."""
        state, scalars = self._state.numpy(), self._scalars.numpy()
        completed = bool(state[entries.ACCEPTED])
        return StepRecord(
            outcome=OUTCOMES[int(state[entries.OUTCOME])],
            newton_iterations=int(state[entries.NEWTON_TOTAL]),
            cg_iterations=int(state[entries.CG_TOTAL]),
            cg_breakdowns=int(state[entries.CG_BREAKDOWNS]),
            cg_capped=int(state[entries.CG_CAPPED]),
            residual=float(scalars[entries.RESIDUAL]) if completed else 0.0,
            work=float(scalars[entries.TOTAL_WORK]) if completed else 0.0,
            impact_ahead=bool(self._impact.numpy()[0]) if completed else False,
            completed=completed,
            steps=int(completed),
            retries=int(not completed),
            start=start,
            dt=dt,
            error=float(scalars[entries.ERROR]),
            error_order=self._plan[1].order,
            unsolved=self._tau * float(scalars[entries.UNSOLVED]) / self._mass**0.5,
            contact=next((found for each in self._couplings if (found := each.report()) is not None), None),
        )

    def _start(self, k: int) -> None:
        for state in self.states:
            position, vector = (getattr(state, name) for name in self.method.stage_history[k])
            history = (state.x, position, state.v, vector)
            for row, made in ((W, state.w), (Y, state.y), (START, state.trial)):
                self._stage(state, "combine", self._weights[state.real].array, row, *history, made)
            self._lanes(state, "copy", state.x if k == 0 else state.x_mid, state.z)
            self._place_pins(state, state.z)
            self._place_pins(state, state.trial)
        self.operator.spread("z")
        self.operator.spread("trial")
        for state, own in zip(self.states, self.terms, strict=True):
            for term in own:
                if k == 0:
                    term.begin(state)
                term.carry(state, state.z)
        for coupling in self._couplings:
            if k == 0:
                coupling.begin()
            coupling.carry("x" if k == 0 else "x_mid", "z")
        for state in self.states:
            self._stage(state, "difference", state.trial, state.z, state.direction)
        self._guard()
        self._step_along("trial")
        for state, own in zip(self.states, self.terms, strict=True):
            for term in own:
                if not term.elastic:
                    term.linearise(state, state.trial)
        for coupling in self._couplings:
            coupling.linearise("trial")
        if not self.method.predicts:
            return
        if self.method.searches:
            self._potential("z", entries.PHI_STILL)
            self._potential("trial", entries.PHI, before="z")
            self._decide("choose_start", self._limits.array, self._scalars)
        self._step_along("z")

    def _iterate(self) -> None:
        for state, own in zip(self.states, self.terms, strict=True):
            self._linearise(state, own)
            self._lanes(state, "clear", state.gradient)
            self._add_gradients(state, own)
        self._couple("z")
        for state in self.states:
            self._lanes(state, "mask", state.free, state.gradient)
        self.operator.gather("gradient")
        self.operator.update()
        self.linear_solver.solve()
        self._guard()
        for state in self.states:
            self._lanes(state, "dot", state.gradient, state.direction, state.dots)
        self.sums.total_dots(entries.SLOPE, self._scalars)
        self._greatest("direction", "free", entries.UPDATE)
        if self.method.searches:
            self._potential("z", entries.PHI)
        solver = self.linear_solver
        self._decide("begin_search", solver.scalars, solver.state, solver.cap, self._scalars, self._state)
        if self.method.searches:
            repeat_while(self._search_active, self._search)
        self._step_along("z")
        self._decide("end_iteration", self._control, self._limits.array, self._scalars, self._state, self._iteration)

    def _search(self) -> None:
        self._step_along("trial")
        self._potential("trial", entries.PHI_TRIAL)
        self._decide("judge_trial", self._control, self._scalars, self._state)

    def _finish(self, k: int) -> None:
        for state, loads, stored in zip(self.states, self._loads, self._stored, strict=True):
            before = state.x if k == 0 else state.x_mid
            self._linearise(state, (*loads, *stored))
            self._lanes(state, "clear", state.gradient)
            self._stage(state, "clear_partials", state.dots)
            for term in loads:
                term.add_gradient(state, state.z, state.gradient)
            self._stage(state, "work_of_loads", state.gradient, state.z, before, state.dots)
            self._add_gradients(state, stored)
        self._couple("z")
        for state in self.states:
            before = state.x if k == 0 else state.x_mid
            self._stage(state, "work_of_pins", state.free, state.gradient, state.z, before, state.dots)
        self.sums.total_dots(entries.WORK, self._scalars)
        self._decide("end_stage", wp.float64(2.0 if self.method.reflects else 1.0), self._scalars)
        if k < self._stages - 1:
            for state in self.states:
                inputs = (self._rate[state.real].array, state.z, state.w)
                self._stage(state, "accept", *inputs, state.x_mid, state.v_mid)
            return
        self.operator.gather("gradient")
        self._greatest("gradient", "mass", entries.RESIDUAL)
        self._estimate(k, ERROR, entries.ERROR)
        if not self.method.searches:
            self._estimate(k, SPEED, entries.SPEED)
        for coupling in self._couplings:
            coupling.judge("z", self._state)
        self._decide("judge_step", self._control, self._scalars, self._state)
        choose(self._accepted, self._accept, None)

    def _estimate(self, k: int, row: int, entry: int) -> None:
        """The longest vector that a row of the weights makes of velocities into the scalars."""
        for state in self.states:
            vector = getattr(state, self.method.stage_history[k][1])
            weights, rate = self._weights[state.real].array, self._rate[state.real].array
            vectors = (state.free, state.v, vector, state.z, state.w)
            self._stage(state, "estimate", weights, row, rate, *vectors, state.dots)
        self.sums.greatest_dots(entry, self._scalars)

    def _accept(self) -> None:
        """The step counts: what it leaves to the next ones."""
        kept = {name for names in self.method.stage_history for name in names}
        for state, own in zip(self.states, self.terms, strict=True):
            if kept & {"x_before", "v_before"}:
                self._stage(state, "remember", state.x, state.v, state.x_before, state.v_before)
            if "a" in kept:
                inertia = self.operator.inertia(state)
                self._stage(state, "accelerate", state.free, inertia, state.z, state.y, state.a)
            if self.method.reflects:
                self._stage(state, "reflect", self._rate[state.real].array, state.free, state.z, state.x, state.v)
                self._stage(state, "place_pins", state.free, state.model.target, state.x)
            else:
                self._stage(state, "accept", self._rate[state.real].array, state.z, state.w, state.x, state.v)
            for term in own:
                term.finish(state)
                if _foresees(term):
                    history = (state.x, state.x, state.v, state.v)
                    self._stage(state, "combine", self._weights[state.real].array, NEXT, *history, state.trial)
                    term.foresee(state, state.trial, self._impact)
        for coupling in self._couplings:
            coupling.finish()

    def _linearise(self, state: State, terms: Sequence[Force]) -> None:
        for term in terms:
            if self.method.reflects and term.elastic:
                term.linearise_mean(state, state.z, state.x)
            else:
                term.linearise(state, state.z)

    def _place_pins(self, state: State, vector: wp.array) -> None:
        name = "place_pins_halfway" if self.method.reflects else "place_pins"
        inputs = (state.free, state.model.target, state.x) if self.method.reflects else (state.free, state.model.target)
        self._stage(state, name, *inputs, vector)

    def _add_gradients(self, state: State, terms: Sequence[Force]) -> None:
        self._stage(
            state, "inertial_gradient", state.mass, self.operator.inertia(state), state.z, state.y, state.gradient
        )
        for term in terms:
            term.add_gradient(state, state.z, state.gradient)

    def _guard(self) -> None:
        for state, own in zip(self.states, self.terms, strict=True):
            for term in own:
                term.guard(state, state.z, state.direction)
        self.operator.spread("direction")
        for coupling in self._couplings:
            coupling.guard("z", "direction")

    def _step_along(self, vector: str) -> None:
        for state in self.states:
            self._stage(state, "displace", self._scalars, state.z, state.direction, getattr(state, vector))

    def _potential(self, vector: str, entry: int, before: str | None = None) -> None:
        """Incremental potential of a vector into the scalars; infinite where a start `before` it must not get there."""
        for state, own in zip(self.states, self.terms, strict=True):
            position = getattr(state, vector)
            self._stage(state, "clear_partials", state.partials)
            inertia = self.operator.inertia(state)
            self._stage(state, "add_inertial_energy", state.mass, inertia, position, state.y, state.partials)
            for term in own:
                term.add_energy(state, position, state.partials)
                if before is not None:
                    term.forbid_start(state, getattr(state, before), position, state.partials)
        for coupling in self._couplings:
            coupling.add_energy(vector)
        self.sums.total_partials(entry, self._scalars)

    def _greatest(self, vector: str, weight: str, entry: int) -> None:
        for state in self.states:
            self._lanes(state, "largest", getattr(state, vector), getattr(state, weight), state.free, state.dots)
        self.sums.greatest_dots(entry, self._scalars)


def _iterates(iterations: int) -> str:
    return f"makes {iterations} Newton iteration a step" if iterations else "has to converge, to newton_tolerance"


def _foresees(term: Force) -> bool:
    return type(term).foresee is not Force.foresee
