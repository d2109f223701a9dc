"""Preconditioners of conjugate gradient: approximate inverses that see the operator and nothing else."""

from collections.abc import Callable
from typing import ClassVar

import warp as wp

from warpdeform.kernels.krylov import krylov
from warpdeform.linear.operator import LinearOperator


class Preconditioner:
    """The face of a preconditioner: rebuilt once per Newton iteration, applied once per CG iteration."""

    name: ClassVar[str]

    def __init__(self, operator: LinearOperator) -> None:
        self.operator = operator

    def update(self) -> None:
        """Rebuild from the operator at the new iterate."""

    def apply(self) -> None:
        """conditioned = P residual on free nodes, and the partial sums of residual.conditioned into `State.dots`."""
        raise NotImplementedError

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return 0


class _NodeBlocks(Preconditioner):
    """One symmetric 3 x 3 block per node."""

    def __init__(self, operator: LinearOperator) -> None:
        super().__init__(operator)
        self.inverse = [state.model.zeros(6) for state in operator.states]

    def apply(self) -> None:
        """conditioned = block times residual, node by node."""
        for state, inverse in zip(self.operator.states, self.inverse, strict=True):
            inputs = [state.free, inverse, state.residual, state.conditioned, state.dots]
            kernel = krylov(state.lane_width, state.real).apply_blocks
            wp.launch(kernel, dim=state.layout.lane_dim, inputs=inputs, device=state.device)

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
        for index, (state, inverse) in enumerate(zip(self.operator.states, self.inverse, strict=True)):
            self.operator.add_diagonal(index, inverse)
            kernel = getattr(krylov(state.lane_width, state.real), self._kernel)
            wp.launch(kernel, dim=state.layout.lane_dim, inputs=[inverse, inverse], device=state.device)


class Jacobi(BlockJacobi):
    """The inverse of the mean diagonal entry of each node."""

    name: ClassVar[str] = "jacobi"
    _kernel: ClassVar[str] = "invert_traces"


PRECONDITIONERS: dict[str, Callable[[LinearOperator], Preconditioner]] = {
    kind.name: kind for kind in (Unpreconditioned, Jacobi, BlockJacobi)
}
"""The preconditioners by the name that scenes use."""


def choose_preconditioner(name: str, operator: LinearOperator) -> Preconditioner:
    """The preconditioner of that name; "auto" is the best one that there is."""
    return PRECONDITIONERS[BlockJacobi.name if name == "auto" else name](operator)
