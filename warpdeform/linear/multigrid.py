"""Geometric multigrid as preconditioner: iterations that do not grow with the number of nodes (design 7)."""

from typing import ClassVar

import warp as wp

from warpdeform.kernels import choice as entries
from warpdeform.kernels.choice import choice
from warpdeform.launching import choose, launch_alone
from warpdeform.linear.level import Level, Vectors
from warpdeform.linear.operator import LinearOperator
from warpdeform.linear.preconditioner import Preconditioner


class Multigrid(Preconditioner):
    """One V-cycle on each body.

    Attributes:
        levels: The finest level of each body.
        caution: Which rates the smoothers take (:mod:`warpdeform.kernels.choice`), int32, shape (3,).
    """

    name: ClassVar[str] = "multigrid"
    retreats: ClassVar[bool] = True

    def __init__(self, operator: LinearOperator) -> None:
        super().__init__(operator)
        self._device = operator.states[0].device
        self.caution: wp.array = wp.zeros(entries.CAUTION, dtype=wp.int32, device=self._device)
        self._given_up = self.caution[entries.GIVEN_UP : entries.GIVEN_UP + 1]
        self.levels: list[Level] = []
        for state, own in zip(operator.states, operator.grids, strict=True):
            model = state.model
            vectors = Vectors(state.z, state.conditioned, state.product)
            stiff = own.blocks is not None or model.has_pins
            self.levels.append(Level(model.grid, model.lengths, model.node_mass, own, vectors, stiff, self.caution))

    def update(self) -> None:
        """Rebuild all grids; one Newton iteration late would cost many iterations (design 7.1)."""
        self.update_blocks()
        self.update_coarse()

    def update_blocks(self) -> None:
        """Rebuild what block-Jacobi needs."""
        for level in self.levels:
            level.update_blocks()

    def update_coarse(self) -> None:
        """Rebuild the rest."""
        for level in self.levels:
            level.update_coarse()

    def apply(self) -> None:
        """conditioned = V(residual); block-Jacobi once the cycle was given up."""
        choose(self._given_up, self.apply_blocks, self.apply_cycle)

    def retreat(self, solver: wp.array) -> None:
        """The cycle was not positive definite: count with larger eigenvalues, and at last give it up for this run."""
        launch_alone(choice().grow_cautious, 1, self.caution, device=self._device)

    def learn(self, solver: wp.array) -> None:
        """Smooth for longer after many iterations: on folded sheets it is the same work in fewer of them."""
        launch_alone(choice().choose_smoother, 1, solver, self.caution, device=self._device)

    def reset(self) -> None:
        """Trust the typical eigenvalues again (host)."""
        self.caution.zero_()

    def apply_cycle(self) -> None:
        """conditioned = V(residual)."""
        for state, own, level in zip(self.operator.states, self.operator.grids, self.levels, strict=True):
            level.cycle(state.residual)
            own.launch("dot", state.residual, state.conditioned, state.dots)

    def apply_blocks(self) -> None:
        """conditioned = D^-1 residual; of curves A^-1 residual, which costs no more."""
        for state, own, level in zip(self.operator.states, self.operator.grids, self.levels, strict=True):
            if level.strands is not None:
                level.cycle(state.residual)
                own.launch("dot", state.residual, state.conditioned, state.dots)
            else:
                own.launch("apply_blocks", state.free, level.inverse, state.residual, state.conditioned, state.dots)

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return sum(level.bytes() for level in self.levels)
