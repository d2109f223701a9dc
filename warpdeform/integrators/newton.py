"""The one solver of every implicit method: projected Newton on the incremental potential, all of it on the device.

One stage, in the order in which it is recorded (design 2.1, 5.1, 6.1):

    w, y, predictor from the history; pins to their targets
    start: the old positions carried out of the way of moving obstacles, or - if its potential is no higher - the
           predictor, reached by a displacement that the obstacles' guard has clipped
    Newton: linearise, gradient, conjugate gradient, guard, Armijo search, stop test
    end: residual, work of the loads, new state, friction anchors; whether the next step meets an impact, which a
         method with a history must not extrapolate through
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from warpdeform.forces.coupling import Coupling
from warpdeform.forces.force import Force
from warpdeform.forces.parameters import Parameters
from warpdeform.forces.ties import RigidTies
from warpdeform.integrators.integrator import Stage
from warpdeform.kernels import newton as entries
from warpdeform.kernels.krylov import krylov
from warpdeform.kernels.newton import decisions, stage
from warpdeform.launching import do_each, launch_alone, launch_lanes, repeat_while
from warpdeform.linear import ConjugateGradient, LinearOperator, Sums, choose_preconditioner
from warpdeform.result import OUTCOMES, StepRecord
from warpdeform.settings import Settings
from warpdeform.state import State

NEWTON_CAP = 100
"""Most Newton iterations of a step that iterates to a tolerance."""
IMPACT_ITERATIONS = 4
"""Fewest Newton iterations of a step that meets an impact: one cannot tell the part that is stopped from the rest."""
ULPS = 8.0
"""Relative round-off of a potential, in units of the precision's epsilon: a sum of products of differences."""


W, Y, START = range(3)
"""Rows of the weights that make the stage vectors."""


class NewtonSolver:
    """Solves the stage problem of a step for all bodies at once.

    Args:
        states: The bodies.
        terms: The terms of each body.
        settings: Solver settings.
        iteration: The Newton iteration counter that the states share, int32, shape (1,).
        threads: Threads that a step is shared by.
        couplings: What acts between bodies.
        rigid: Nodes that follow others.
    """

    def __init__(
        self,
        states: Sequence[State],
        terms: Sequence[Sequence[Force]],
        settings: Settings,
        iteration: wp.array,
        threads: int = 1,
        couplings: Sequence[Coupling] = (),
        rigid: Sequence[RigidTies] = (),
    ) -> None:
        device = states[0].device
        self.states, self.terms, self._device, self._iteration = tuple(states), terms, device, iteration
        # What stores no energy comes first, so that its work can be told from the rest of the gradient.
        self._loads = [[term for term in own if not term.energy_kind] for own in terms]
        self._stored = [[term for term in own if term.energy_kind] for own in terms]
        self.operator = LinearOperator(states, terms, couplings, rigid)
        self._couplings = self.operator.couplings
        self.sums = Sums(states)
        self.preconditioner = choose_preconditioner(settings.preconditioner, self.operator)
        self.linear_solver = ConjugateGradient(
            self.operator, self.preconditioner, self.sums, settings.cg_tolerance, settings.cg_iterations
        )
        self._scalars: wp.array = wp.zeros(entries.STEP_SCALARS, dtype=wp.float64, device=device)
        self._flushed: wp.array = wp.zeros(threads, dtype=wp.int32, device=device)
        self._impact: wp.array = wp.zeros(1, dtype=wp.int32, device=device)
        self._state: wp.array = wp.zeros(entries.STEP_STATE, dtype=wp.int32, device=device)
        self._newton_active = self._state[entries.NEWTON_ACTIVE : entries.NEWTON_ACTIVE + 1]
        self._search_active = self._state[entries.SEARCH_ACTIVE : entries.SEARCH_ACTIVE + 1]
        epsilon = np.finfo(np.float32 if settings.precision == "float32" else np.float64).eps
        spacing = min(state.model.spacing for state in states)
        self._control: wp.array = wp.array(
            [ULPS * epsilon, settings.newton_tolerance * spacing], dtype=wp.float64, device=device
        )
        to_tolerance = settings.newton_iterations == 0
        self._settled = [NEWTON_CAP if to_tolerance else settings.newton_iterations, int(to_tolerance), 0]
        self._hit = [max(self._settled[0], IMPACT_ITERATIONS), int(to_tolerance), 1]
        self._limits = Parameters(self._settled, wp.int32, device)
        self._weights = {s.real: Parameters(np.zeros((3, 3)), s.real, device) for s in states}
        self._rate = {s.real: Parameters([1.0], s.real, device) for s in states}

    def prepare(self, stage_: Stage, time: float, dt: float, impact: bool = False) -> None:
        """Write what changes from step to step into device arrays (host, before the recorded step is replayed).

        Args:
            stage_: The stage of the step.
            time: Where the step ends [s].
            dt: The step [s].
            impact: The step meets an impact, as the one before it has foreseen.
        """
        self._limits.write(self._hit if impact else self._settled)
        self.operator.set_tau(stage_.tau)
        for real in self._weights:
            self._weights[real].write([stage_.w, stage_.y, stage_.start])
            self._rate[real].write([1.0 / stage_.tau])
        for state, own in zip(self.states, self.terms, strict=True):
            state.model.place_targets(time)
            for term in own:
                term.prepare(time, dt, stage_.tau)
        for coupling in self._couplings:
            coupling.prepare(time, dt, stage_.tau)

    def record(self) -> None:
        """Launch one step; nothing in it asks the host."""
        do_each(lambda thread: self._flush("enter_step", thread))
        self._decide("begin_step", self._scalars, self._state, self._iteration, self._impact)
        self._start()
        repeat_while(self._newton_active, self._iterate)
        self._finish()
        do_each(lambda thread: self._flush("leave_step", thread))

    def rehearse(self) -> None:
        """Launch a step of one Newton and one conjugate gradient iteration: every kernel, whatever the settings."""
        cap = self.linear_solver.cap.numpy().copy()
        self._limits.write([1, 0, 0])
        self.linear_solver.cap.assign([1])
        self.record()
        self._limits.write(self._settled)
        self.linear_solver.cap.assign(cap)

    def report(self) -> StepRecord:
        """What the last step reported (host; the one read of device memory between steps)."""
        state, scalars = self._state.numpy(), self._scalars.numpy()
        return StepRecord(
            outcome=OUTCOMES[int(state[entries.OUTCOME])],
            newton_iterations=int(state[entries.NEWTON_ITERATIONS]),
            cg_iterations=int(state[entries.CG_TOTAL]),
            cg_breakdowns=int(state[entries.CG_BREAKDOWNS]),
            cg_capped=int(state[entries.CG_CAPPED]),
            residual=float(scalars[entries.RESIDUAL]),
            work=float(scalars[entries.WORK]),
            impact_ahead=bool(self._impact.numpy()[0]),
        )

    def _start(self) -> None:
        for state in self.states:
            for row, vector in ((W, state.w), (Y, state.y), (START, state.trial)):
                self._stage(state, "combine", self._weights[state.real].array, row, *_history(state), vector)
            self._lanes(state, "copy", state.x, state.z)
            self._stage(state, "place_pins", state.free, state.model.target, state.z)
            self._stage(state, "place_pins", state.free, state.model.target, state.trial)
        self.operator.spread("z")
        self.operator.spread("trial")
        for state, own in zip(self.states, self.terms, strict=True):
            for term in own:
                term.begin(state)
                term.carry(state, state.z)
            self._stage(state, "difference", state.trial, state.z, state.direction)
            self._guard(state, own)
        self.operator.spread("direction")
        for state, own in zip(self.states, self.terms, strict=True):
            self._stage(state, "displace", self._scalars, state.z, state.direction, state.trial)
            for term in own:
                if not term.elastic:
                    term.linearise(state, state.trial)
        self._potential("z", entries.PHI_STILL)
        self._potential("trial", entries.PHI)
        self._decide("choose_start", self._limits.array, self._scalars)
        self._step_along("z")

    def _iterate(self) -> None:
        for state, own in zip(self.states, self.terms, strict=True):
            for term in own:
                term.linearise(state, state.z)
            self._lanes(state, "clear", state.gradient)
            self._add_gradients(state, own)
        self._couple()
        for state in self.states:
            self._mask_gradient(state)
        self.operator.gather("gradient")
        self.operator.update()
        self.linear_solver.solve()
        for state, own in zip(self.states, self.terms, strict=True):
            self._guard(state, own)
        self.operator.spread("direction")
        for state in self.states:
            self._lanes(state, "dot", state.gradient, state.direction, state.dots)
        self.sums.total_dots(entries.SLOPE, self._scalars)
        self._greatest("direction", "free", entries.UPDATE)
        self._potential("z", entries.PHI)
        self._decide("begin_search", self.linear_solver.state, self.linear_solver.cap, self._scalars, self._state)
        repeat_while(self._search_active, self._search)
        self._step_along("z")
        self._decide("end_iteration", self._control, self._limits.array, self._scalars, self._state, self._iteration)

    def _search(self) -> None:
        self._step_along("trial")
        self._potential("trial", entries.PHI_TRIAL)
        self._decide("judge_trial", self._control, self._scalars, self._state)

    def _finish(self) -> None:
        for state, loads, stored in zip(self.states, self._loads, self._stored, strict=True):
            for term in (*loads, *stored):
                term.linearise(state, state.z)
            self._lanes(state, "clear", state.gradient)
            self._stage(state, "clear_partials", state.dots)
            for term in loads:
                term.add_gradient(state, state.z, state.gradient)
            self._stage(state, "work_of_loads", state.gradient, state.z, state.x, state.dots)
            self._add_gradients(state, stored)
        self._couple()
        for state in self.states:
            self._stage(state, "work_of_pins", state.free, state.gradient, state.z, state.x, state.dots)
        self.sums.total_dots(entries.WORK, self._scalars)
        self.operator.gather("gradient")
        self._greatest("gradient", "mass", entries.RESIDUAL)
        for state, own in zip(self.states, self.terms, strict=True):
            history = (state.x, state.v, state.x_before, state.v_before)
            self._stage(state, "accept", self._rate[state.real].array, state.z, state.w, *history)
            for term in own:
                term.finish(state)
                if _foresees(term):
                    self._stage(state, "combine", self._weights[state.real].array, START, *_history(state), state.trial)
                    term.foresee(state, state.trial, self._impact)

    def _add_gradients(self, state: State, terms: Sequence[Force]) -> None:
        self._stage(
            state, "inertial_gradient", state.mass, self.operator.inertia(state), state.z, state.y, state.gradient
        )
        for term in terms:
            term.add_gradient(state, state.z, state.gradient)

    def _couple(self) -> None:
        """Add the gradients of what acts between bodies."""
        for coupling in self._couplings:
            coupling.linearise("z")
            coupling.add_gradient("z", "gradient")

    def _mask_gradient(self, state: State) -> None:
        self._lanes(state, "mask", state.free, state.gradient)

    def _guard(self, state: State, terms: Sequence[Force]) -> None:
        for term in terms:
            term.guard(state, state.z, state.direction)

    def _step_along(self, vector: str) -> None:
        for state in self.states:
            self._stage(state, "displace", self._scalars, state.z, state.direction, getattr(state, vector))

    def _potential(self, vector: str, entry: int) -> None:
        """Incremental potential of a vector into the scalars."""
        for state, own in zip(self.states, self.terms, strict=True):
            position = getattr(state, vector)
            self._stage(state, "clear_partials", state.partials)
            inertia = self.operator.inertia(state)
            self._stage(state, "add_inertial_energy", state.mass, inertia, position, state.y, state.partials)
            for term in own:
                term.add_energy(state, position, state.partials)
        for coupling in self._couplings:
            coupling.add_energy(vector)
        self.sums.total_partials(entry, self._scalars)

    def _greatest(self, vector: str, weight: str, entry: int) -> None:
        for state in self.states:
            self._lanes(state, "largest", getattr(state, vector), getattr(state, weight), state.free, state.dots)
        self.sums.greatest_dots(entry, self._scalars)

    def _stage(self, state: State, name: str, *inputs: Any) -> None:
        kernel = getattr(stage(state.lane_width, state.real), name)
        launch_lanes(kernel, state.layout, *inputs, device=self._device)

    def _lanes(self, state: State, name: str, *inputs: Any) -> None:
        kernel = getattr(krylov(state.lane_width, state.real), name)
        launch_lanes(kernel, state.layout, *inputs, device=self._device)

    def _decide(self, name: str, *inputs: Any) -> None:
        launch_alone(getattr(decisions(), name), 1, *inputs, device=self._device)

    def _flush(self, name: str, thread: int) -> None:
        """The floating-point mode is each thread's own."""
        flushed = self._flushed[thread : thread + 1]
        wp.launch(getattr(decisions(), name), dim=1, inputs=[flushed], device=self._device)


def _history(state: State) -> tuple[wp.array, ...]:
    return (state.x, state.x_before, state.v, state.v_before)


def _foresees(term: Force) -> bool:
    return type(term).foresee is not Force.foresee
