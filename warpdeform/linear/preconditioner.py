"""The face of preconditioners: approximate inverses that see the operator and nothing else."""

from typing import ClassVar

import warp as wp

from warpdeform.linear.operator import LinearOperator


class Preconditioner:
    """The face of a preconditioner: rebuilt once per Newton iteration, applied once per CG iteration."""

    name: ClassVar[str]
    retreats: ClassVar[bool] = False
    """It may change during a solve."""

    def __init__(self, operator: LinearOperator) -> None:
        self.operator = operator

    def begin(self, solver: wp.array) -> None:
        """A solve begins; `solver` is its state (:mod:`warpdeform.kernels.krylov`)."""

    def update(self) -> None:
        """Rebuild from the operator at the new iterate."""

    def apply(self) -> None:
        """conditioned = P residual on free nodes, and the partial sums of residual.conditioned into `State.dots`."""
        raise NotImplementedError

    def retreat(self, solver: wp.array) -> None:
        """Change: the state of the solve says why."""

    def learn(self, solver: wp.array) -> None:
        """The solve has ended in this state."""

    def reset(self) -> None:
        """Forget what earlier steps have taught (host, at the start of a run)."""

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return 0
