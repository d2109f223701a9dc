"""The matrix of a Newton iteration, A = M/tau^2 + node blocks + elastic Hessians, applied without being assembled."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from warpdeform.forces.coupling import Coupling
from warpdeform.forces.force import Coarsening, CoarseTerm, Force, GridArrays, GridTerm
from warpdeform.forces.parameters import Parameters
from warpdeform.forces.ties import RigidTies
from warpdeform.kernels.krylov import krylov
from warpdeform.kernels.products import Gathering, products
from warpdeform.launching import RowStruct, launch_in_bands, launch_lanes
from warpdeform.state import State

Terms = Sequence[Sequence[Force]]
"""The terms of each body."""


class Hanging:
    """What hangs rigidly on a body: its diagonal blocks, and nothing of the product, which ties find on their own.

    Args:
        ties: The ties.
        follower: A of the body whose nodes follow.
    """

    sample_nodes = 0
    gathering: Gathering | None = None
    angled = False

    def __init__(self, ties: RigidTies, follower: "GridOperator") -> None:
        body = follower.body
        self._ties, self._follower = ties, follower
        shape = (6, body.layout.rows, body.layout.columns)
        self._blocks: wp.array = wp.zeros(shape, dtype=body.real, device=body.device)
        self.fluxes = RowStruct(None, {})

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return int(self._blocks.capacity)

    def coarser(self, transfer: Coarsening) -> None:
        """Coarse grids do without it."""

    def coarsen(self, transfer: Coarsening, coarse: CoarseTerm) -> None:
        """Nothing to carry."""

    def write_fluxes(self, body: GridArrays, direction: wp.array) -> None:
        """It has none."""

    def write_band(self, body: GridArrays, band: wp.array) -> None:
        """It has none."""

    def add_hessian_product(self, body: GridArrays, direction: wp.array, product: wp.array) -> None:
        """Nothing: the product of the follower is gathered."""

    def add_block_diagonal(self, body: GridArrays, blocks: wp.array) -> None:
        """Add the blocks of the nodes that follow."""
        self._follower.write_diagonal(self._blocks)
        self._ties.hang(self._blocks, blocks)


class GridOperator:
    """A of one body on one grid: its own, or a coarser one of multigrid. It does not know of pins.

    Args:
        body: Arrays of the body on this grid.
        inertia: 1 / tau^2 [1/s2] on the device, shape (1,).
        blocks: M/tau^2 and the blocks of node-wise terms [N/m], shape (6, rows, columns); None where mass is all.
        terms: The terms that couple nodes. The first one gathers fluxes and is what smoothers know of A; what others
            add is found by conjugate gradient alone, but for their diagonal blocks.
    """

    def __init__(self, body: GridArrays, inertia: wp.array, blocks: wp.array | None, terms: Sequence[GridTerm]) -> None:
        self.body, self.inertia, self.blocks, self.terms = body, inertia, blocks, tuple(terms)
        gathering = self.terms[0].gathering
        assert gathering is not None
        self._kernels = products(body.lane_width, body.real, gathering, blocks is not None)

    def product(self, p: wp.array, q: wp.array) -> None:
        """q = A p."""
        self.launch_product("product", p, p, q)
        for term in self.terms[1:]:
            term.add_hessian_product(self.body, p, q)

    def launch_product(self, name: str, p: wp.array, *inputs: Any) -> None:
        """Write the fluxes of the product with p and launch what ends it (:mod:`warpdeform.kernels.products`).

        Args:
            name: The kernel.
            p: The vector, shape (3, rows, columns); the kernel must not write it.
            inputs: Arguments of the kernel after those that the operator knows.
        """
        first, body = self.terms[0], self.body
        own = (body.layout.first_row, first.fluxes, body.mass if self.blocks is None else self.blocks, self.inertia)
        kernel = getattr(self._kernels, name)
        launch_in_bands(
            body.layout,
            [first.fluxes.arrays[buffer] for buffer in first.fluxes.buffers],
            lambda: first.write_fluxes(body, p),
            lambda: launch_lanes(kernel, body.layout, *own, *inputs, device=body.device, inner=True),
            body.device,
        )

    def start_blocks(self, blocks: wp.array) -> None:
        """blocks = M/tau^2."""
        self.launch("start_blocks", self.body.mass, self.inertia, blocks)

    def add_elastic_diagonal(self, blocks: wp.array) -> None:
        """Add the 3 x 3 diagonal blocks of the elastic Hessians."""
        for term in self.terms:
            term.add_block_diagonal(self.body, blocks)

    def write_diagonal(self, blocks: wp.array) -> None:
        """blocks = the 3 x 3 diagonal blocks D of A."""
        if self.blocks is None:
            self.start_blocks(blocks)
        else:
            self.launch("copy_blocks", self.blocks, blocks)
        self.add_elastic_diagonal(blocks)

    def launch(self, name: str, *inputs: Any) -> None:
        """Launch a kernel of :mod:`warpdeform.kernels.krylov` over this grid."""
        kernel = getattr(krylov(self.body.lane_width, self.body.real), name)
        launch_lanes(kernel, self.body.layout, *inputs, device=self.body.device)


class LinearOperator:
    """A of all bodies together.

    A body without node-wise terms needs no block array: its mass alone is the rest of the matrix.

    Args:
        states: The bodies.
        terms: The terms of each body.
        couplings: What acts between bodies.
        rigid: Nodes that follow others.

    Attributes:
        grids: A of each body.
    """

    def __init__(
        self,
        states: Sequence[State],
        terms: Terms,
        couplings: Sequence[Coupling] = (),
        rigid: Sequence[RigidTies] = (),
    ) -> None:
        self.states, self.terms, self.couplings, self.rigid = tuple(states), terms, tuple(couplings), tuple(rigid)
        coupled = [state for coupling in couplings for state in coupling.states]
        self._inertia = {state.real: Parameters([1.0], state.real, state.device) for state in states}
        self.grids: list[GridOperator] = []
        for state, own in zip(states, terms, strict=True):
            needed = state in coupled or any(_has_blocks(term) for term in own)
            blocks = state.model.zeros(6) if needed else None
            elastic = [term for term in own if term.elastic]
            self.grids.append(GridOperator(state, self.inertia(state), blocks, elastic))
        for ties in self.rigid:
            follower, followed = (self.grids[self.states.index(state)] for state in ties.states)
            followed.terms = (*followed.terms, Hanging(ties, follower))

    def inertia(self, state: State) -> wp.array:
        """1 / tau^2 [1/s2] on the device, shape (1,)."""
        return self._inertia[state.real].array

    def set_tau(self, tau: float) -> None:
        """Set the stage step [s] (host, between steps)."""
        for parameters in self._inertia.values():
            parameters.write([1.0 / (tau * tau)])

    def bytes(self) -> int:
        """Device memory [bytes]."""
        blocks = sum(grid.blocks.capacity for grid in self.grids if grid.blocks is not None)
        return int(blocks + sum(ties.bytes() for ties in self.rigid) + sum(each.bytes() for each in self.couplings))

    def update(self) -> None:
        """Collect the node blocks after the terms were linearised."""
        for state, own, grid in zip(self.states, self.terms, self.grids, strict=True):
            if grid.blocks is not None:
                grid.start_blocks(grid.blocks)
                for term in own:
                    term.add_node_blocks(state, grid.blocks)
                for coupling in self.couplings:
                    coupling.add_node_blocks(state, grid.blocks)

    def product(self) -> None:
        """product = free A search, and the partial sums of search.product into `State.dots`."""
        for state, grid in zip(self.states, self.grids, strict=True):
            grid.product(state.search, state.product)
        for coupling in self.couplings:
            coupling.add_hessian_product("search", "product")
        for state, grid in zip(self.states, self.grids, strict=True):
            grid.launch("mask_dot", state.free, state.search, state.product, state.dots)
        self.gather("product")

    def gather(self, vector: str) -> None:
        """Hand what a vector of the states has at nodes that follow to those that they follow."""
        for ties in self.rigid:
            ties.gather(vector)

    def spread(self, vector: str) -> None:
        """Give nodes that follow their value of a vector of the states."""
        for ties in self.rigid:
            ties.spread(vector)


def _has_blocks(term: Force) -> bool:
    return type(term).add_node_blocks is not Force.add_node_blocks
