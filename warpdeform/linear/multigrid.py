"""Geometric multigrid as preconditioner: iterations that do not grow with the number of nodes (design 7)."""

from typing import ClassVar

from warpdeform.linear.level import Level, Vectors
from warpdeform.linear.operator import LinearOperator
from warpdeform.linear.preconditioner import Preconditioner


class Multigrid(Preconditioner):
    """One V-cycle on each body."""

    name: ClassVar[str] = "multigrid"

    def __init__(self, operator: LinearOperator) -> None:
        super().__init__(operator)
        self.levels: list[Level] = []
        for state, own in zip(operator.states, operator.grids, strict=True):
            model = state.model
            vectors = Vectors(state.z, state.conditioned, state.product)
            stiff = own.blocks is not None or model.has_pins
            self.levels.append(Level(model.grid, model.lengths, model.node_mass, own, vectors, stiff))

    def update(self) -> None:
        """Rebuild all grids; one Newton iteration late would cost many iterations (design 7.1)."""
        for level in self.levels:
            level.update()

    def apply(self) -> None:
        """conditioned = V(residual)."""
        for state, own, level in zip(self.operator.states, self.operator.grids, self.levels, strict=True):
            level.cycle(state.residual)
            own.launch("dot", state.residual, state.conditioned, state.dots)

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return sum(level.bytes() for level in self.levels)
