"""Geometric multigrid as preconditioner: iterations that do not grow with the number of nodes (design 7)."""

from typing import ClassVar

import warp as wp

from warpdeform.kernels import multigrid as entries
from warpdeform.kernels.multigrid import dense
from warpdeform.linear.level import Level, Vectors
from warpdeform.linear.operator import LinearOperator
from warpdeform.linear.preconditioner import Preconditioner


class Multigrid(Preconditioner):
    """One V-cycle on each body."""

    name: ClassVar[str] = "multigrid"
    retreats: ClassVar[bool] = True

    def __init__(self, operator: LinearOperator) -> None:
        super().__init__(operator)
        device = operator.states[0].device
        self._caution: wp.array = wp.zeros(2, dtype=wp.int32, device=device)
        self._given_up = self._caution[entries.GIVEN_UP : entries.GIVEN_UP + 1]
        self._device = device
        self.levels: list[Level] = []
        for state, own in zip(operator.states, operator.grids, strict=True):
            model = state.model
            vectors = Vectors(state.z, state.conditioned, state.product)
            stiff = own.blocks is not None or model.has_pins
            self.levels.append(Level(model.grid, model.lengths, model.node_mass, own, vectors, stiff, self._caution))

    def update(self) -> None:
        """Rebuild all grids; one Newton iteration late would cost many iterations (design 7.1)."""
        for level in self.levels:
            level.update()

    def reset(self) -> None:
        """Trust the typical eigenvalues again (host)."""
        self._caution.zero_()

    def apply(self) -> None:
        """conditioned = V(residual); block-Jacobi once the cycle was given up."""
        wp.capture_if(self._given_up, self._apply_blocks, self._cycle)

    def retreat(self) -> None:
        """The cycle was not positive definite: count with larger eigenvalues, and at last give it up for this run."""
        kernel = dense(self.operator.states[0].real).grow_cautious
        wp.launch(kernel, dim=1, inputs=[self._caution], device=self._device)

    def _cycle(self) -> None:
        for state, own, level in zip(self.operator.states, self.operator.grids, self.levels, strict=True):
            level.cycle(state.residual)
            own.launch("dot", state.residual, state.conditioned, state.dots)

    def _apply_blocks(self) -> None:
        for state, own, level in zip(self.operator.states, self.operator.grids, self.levels, strict=True):
            own.launch("apply_blocks", state.free, level.inverse, state.residual, state.conditioned, state.dots)

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return sum(level.bytes() for level in self.levels)
