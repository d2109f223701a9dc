"""The face of preconditioners: approximate inverses that see the operator and nothing else."""

from typing import ClassVar

from warpdeform.linear.operator import LinearOperator


class Preconditioner:
    """The face of a preconditioner: rebuilt once per Newton iteration, applied once per CG iteration."""

    name: ClassVar[str]
    retreats: ClassVar[bool] = False
    """It is not positive definite by construction, and `retreat` makes it more so."""

    def __init__(self, operator: LinearOperator) -> None:
        self.operator = operator

    def update(self) -> None:
        """Rebuild from the operator at the new iterate."""

    def apply(self) -> None:
        """conditioned = P residual on free nodes, and the partial sums of residual.conditioned into `State.dots`."""
        raise NotImplementedError

    def retreat(self) -> None:
        """Conjugate gradient has found r.P r <= 0: be more careful, if that is possible."""

    def reset(self) -> None:
        """Forget what earlier steps have taught (host, at the start of a run)."""

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return 0
