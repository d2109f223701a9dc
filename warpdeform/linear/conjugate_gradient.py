"""Preconditioned conjugate gradient on the device (design 2.2)."""

import warp as wp

from warpdeform.kernels import krylov as entries
from warpdeform.kernels.krylov import krylov, reductions
from warpdeform.launching import do_alone, launch_alone, launch_lanes, repeat_while
from warpdeform.linear.operator import LinearOperator
from warpdeform.linear.preconditioner import Preconditioner
from warpdeform.linear.sums import Sums
from warpdeform.state import State


class ConjugateGradient:
    """Solves A direction = -gradient for all bodies at once.

    Departs from the textbook in four points: it stops on sqrt(r.z), which is at hand and follows the energy error more
    closely than |r| (design 7.1); all vectors are masked, so that pinned nodes are not part of the system; p.Ap <= 0
    ends the solve with what it has and is reported, instead of being assumed away; the preconditioner may change
    on the way, where r.P r < 0 or where it is on trial, and the solve starts afresh from where it has come to.

    Attributes:
        scalars: float64 (ALPHA, BETA, RZ and so on) of :mod:`warpdeform.kernels.krylov`.
        state: int32 (ACTIVE, ITERATIONS, BREAKDOWN) of :mod:`warpdeform.kernels.krylov`.
        cap: Largest number of iterations, int32, shape (1,).
        tolerance: Relative drop of sqrt(r.z) at which to stop, float64, shape (1,).
    """

    def __init__(
        self,
        operator: LinearOperator,
        preconditioner: Preconditioner,
        sums: Sums,
        tolerance: float,
        cap: int,
    ) -> None:
        device = operator.states[0].device
        self.operator, self.preconditioner, self._sums = operator, preconditioner, sums
        self._device = device
        self.scalars: wp.array = wp.zeros(entries.SOLVER_SCALARS, dtype=wp.float64, device=device)
        self.state: wp.array = wp.zeros(entries.SOLVER_STATE, dtype=wp.int32, device=device)
        self._active = self.state[entries.ACTIVE : entries.ACTIVE + 1]
        self._retreat = self.state[entries.RETREAT : entries.RETREAT + 1]
        self.cap: wp.array = wp.array([cap], dtype=wp.int32, device=device)
        self.tolerance: wp.array = wp.array([tolerance], dtype=wp.float64, device=device)

    def solve(self) -> None:
        """Record one solve; starts from direction = 0 and uses `State.gradient`, which is masked."""
        do_alone(self.state.zero_)
        self.preconditioner.begin(self.state)
        self.preconditioner.update()
        for state in self.operator.states:
            self._lanes(state, "start_solve", state.gradient, state.direction, state.residual)
        self._precondition()
        for state in self.operator.states:
            self._lanes(state, "copy", state.conditioned, state.search)
        self._scalar("cg_start", self.scalars, self.state)
        repeat_while(self._active, self._iterate)
        self.preconditioner.learn(self.state)

    def _iterate(self) -> None:
        self.operator.product()
        self._sums.gather_dots()
        self._scalar("cg_step", self.scalars, self.state)
        for state in self.operator.states:
            self._lanes(state, "advance", self.scalars, state.search, state.product, state.direction, state.residual)
        self._precondition()
        self._scalar("cg_turn", self.tolerance, self.cap, self.scalars, self.state)
        for state in self.operator.states:
            self._lanes(state, "turn", self.scalars, state.conditioned, state.search)

    def _precondition(self) -> None:
        """conditioned = P residual, by another P where r.P r is negative or P was on trial for long enough."""
        self.preconditioner.apply()
        self.operator.spread("conditioned")
        self._sums.gather_dots()
        if self.preconditioner.retreats:
            self._scalar("judge_preconditioner", self.scalars, self.state)
            repeat_while(self._retreat, self._precondition_again)

    def _precondition_again(self) -> None:
        self.preconditioner.retreat(self.state)
        self.preconditioner.apply()
        self.operator.spread("conditioned")
        self._sums.gather_dots()
        self._scalar("judge_preconditioner", self.scalars, self.state)

    def _lanes(self, state: State, name: str, *inputs: wp.array) -> None:
        kernel = getattr(krylov(state.lane_width, state.real), name)
        launch_lanes(kernel, state.layout, *inputs, device=self._device)

    def _scalar(self, name: str, *inputs: wp.array) -> None:
        launch_alone(getattr(reductions(), name), 1, self._sums.rows, *inputs, device=self._device)
