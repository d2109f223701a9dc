"""Preconditioners that treat every node by itself."""

from typing import ClassVar

from warpdeform.linear.operator import LinearOperator
from warpdeform.linear.preconditioner import Preconditioner


class _NodeBlocks(Preconditioner):
    """One symmetric 3 x 3 block per node."""

    def __init__(self, operator: LinearOperator) -> None:
        super().__init__(operator)
        self.inverse = [state.model.zeros(6) for state in operator.states]

    def apply(self) -> None:
        """conditioned = block times residual, node by node."""
        for state, grid, inverse in zip(self.operator.states, self.operator.grids, self.inverse, strict=True):
            grid.launch("apply_blocks", state.free, inverse, state.residual, state.conditioned, state.dots)

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return sum(inverse.capacity for inverse in self.inverse)


class Unpreconditioned(_NodeBlocks):
    """The identity."""

    name: ClassVar[str] = "none"

    def __init__(self, operator: LinearOperator) -> None:
        super().__init__(operator)
        for inverse in self.inverse:
            inverse[:3].fill_(1.0)


class BlockJacobi(_NodeBlocks):
    """The inverses of the 3 x 3 diagonal blocks."""

    name: ClassVar[str] = "block-jacobi"
    _kernel: ClassVar[str] = "invert_blocks"

    def update(self) -> None:
        """Collect the diagonal blocks and invert them."""
        for grid, inverse in zip(self.operator.grids, self.inverse, strict=True):
            grid.write_diagonal(inverse)
            grid.launch(self._kernel, inverse, inverse)


class Jacobi(BlockJacobi):
    """The inverse of the mean diagonal entry of each node."""

    name: ClassVar[str] = "jacobi"
    _kernel: ClassVar[str] = "invert_traces"
