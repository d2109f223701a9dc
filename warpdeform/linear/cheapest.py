"""Multigrid or block-Jacobi, whichever has been cheaper of late."""

from typing import ClassVar

import numpy as np
import warp as wp

from warpdeform.kernels import choice as entries
from warpdeform.kernels.choice import choice
from warpdeform.launching import choose, launch_alone
from warpdeform.linear.multigrid import Multigrid
from warpdeform.linear.operator import LinearOperator
from warpdeform.linear.preconditioner import Preconditioner
from warpdeform.linear.smoother import LONG, SHORT


class Cheapest(Preconditioner):
    """Multigrid, until block-Jacobi needs less work; how that is found out is told in :mod:`warpdeform.kernels.choice`.

    Work is counted in matrix-vector products, so that the same run takes the same decisions wherever it runs.
    """

    name: ClassVar[str] = "cheapest"
    retreats: ClassVar[bool] = True

    def __init__(self, operator: LinearOperator) -> None:
        super().__init__(operator)
        device = operator.states[0].device
        self._device = device
        self.multigrid = Multigrid(operator)
        nodes = np.array([state.model.grid.node_count for state in operator.states])
        levels = self.multigrid.levels
        short, long = (np.array([level.cycle_cost(s) for level in levels]) @ nodes / nodes.sum() for s in (SHORT, LONG))
        unit = [1.0 + float(short), BLOCK_ITERATION_COST, 1.0 + float(long)]
        self._unit: wp.array = wp.array(unit, dtype=wp.float64, device=device)
        self._choice: wp.array = wp.zeros(entries.CHOICE, dtype=wp.int32, device=device)
        self._costs: wp.array = wp.zeros(entries.COSTS, dtype=wp.float64, device=device)
        self._plain = self._choice[entries.PLAIN : entries.PLAIN + 1]
        self.reset()

    def begin(self, solver: wp.array) -> None:
        """Choose."""
        inputs = [self._unit, self.multigrid.caution, self._costs, self._choice, solver]
        launch_alone(choice().choose_method, 1, *inputs, device=self._device)

    def update(self) -> None:
        """Rebuild what the chosen one needs."""
        self.multigrid.update_blocks()
        choose(self._plain, None, self.multigrid.update_coarse)

    def apply(self) -> None:
        """conditioned = P residual."""
        choose(self._plain, self.multigrid.apply_blocks, self.multigrid.apply_cycle)

    def retreat(self, solver: wp.array) -> None:
        """End a trial that takes too long, or be more careful with the cycle."""
        inputs = [self._choice, self.multigrid.caution, solver]
        launch_alone(choice().change_method, 1, *inputs, device=self._device)
        choose(self._plain, None, self.multigrid.update_coarse)

    def learn(self, solver: wp.array) -> None:
        """Keep what the solve has cost."""
        inputs = [self._unit, self.multigrid.caution, solver, self._choice, self._costs]
        launch_alone(choice().learn_cost, 1, *inputs, device=self._device)
        choose(self._plain, None, lambda: self.multigrid.learn(solver))

    def reset(self) -> None:
        """Forget all costs (host)."""
        self.multigrid.reset()
        self._choice.assign([0, 0, 0, int(entries.FIRST_WAIT)])
        self._costs.assign([0.0, np.inf])

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return self.multigrid.bytes()


BLOCK_ITERATION_COST = 1.3
"""An iteration with block-Jacobi in products: more vector updates go with its product than with a smoother's."""
