"""The preconditioners by name, and the choice between them."""

from collections.abc import Callable

from warpdeform.linear.cheapest import Cheapest
from warpdeform.linear.multigrid import Multigrid
from warpdeform.linear.node_blocks import BlockJacobi, Jacobi, Unpreconditioned
from warpdeform.linear.operator import LinearOperator
from warpdeform.linear.preconditioner import Preconditioner

PRECONDITIONERS: dict[str, Callable[[LinearOperator], Preconditioner]] = {
    kind.name: kind for kind in (Unpreconditioned, Jacobi, BlockJacobi, Multigrid, Cheapest)
}
"""The preconditioners by the name that scenes use."""

MULTIGRID_FROM = 800
"""Nodes of a body from which on multigrid pays."""


def choose_preconditioner(name: str, operator: LinearOperator) -> Preconditioner:
    """The preconditioner of that name; "auto" is block-Jacobi for small bodies and the cheapest for others.

    Curves are solved directly, as a multigrid of one grid: among them alone there is nothing to choose.
    """
    if name == "auto":
        grids = [state.model.grid for state in operator.states]
        curves = [grid.dimension == 1 for grid in grids]
        large = max(grid.node_count for grid in grids) >= MULTIGRID_FROM
        name = Multigrid.name if all(curves) else Cheapest.name if large or any(curves) else BlockJacobi.name
    return PRECONDITIONERS[name](operator)
