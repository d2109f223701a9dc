"""The face of preconditioners: approximate inverses that see the operator and nothing else."""

from typing import ClassVar

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
