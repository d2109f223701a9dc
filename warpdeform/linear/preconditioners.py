"""The preconditioners by name, and the choice between them."""

from collections.abc import Callable

from warpdeform.linear.multigrid import Multigrid
from warpdeform.linear.node_blocks import BlockJacobi, Jacobi, Unpreconditioned
from warpdeform.linear.operator import LinearOperator
from warpdeform.linear.preconditioner import Preconditioner

PRECONDITIONERS: dict[str, Callable[[LinearOperator], Preconditioner]] = {
    kind.name: kind for kind in (Unpreconditioned, Jacobi, BlockJacobi, Multigrid)
}
"""The preconditioners by the name that scenes use."""


def choose_preconditioner(name: str, operator: LinearOperator) -> Preconditioner:
    """The preconditioner of that name; "auto" is the best one that there is."""
    return PRECONDITIONERS[BlockJacobi.name if name == "auto" else name](operator)
