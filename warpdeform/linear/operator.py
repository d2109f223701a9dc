"""The matrix of a Newton iteration, A = M/tau^2 + node blocks + elastic Hessians, applied without being assembled."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from warpdeform.forces.force import Force
from warpdeform.forces.parameters import Parameters
from warpdeform.kernels.krylov import krylov
from warpdeform.state import State

Terms = Sequence[Sequence[Force]]
"""The terms of each body."""


class LinearOperator:
    """A of all bodies together.

    A body without node-wise terms needs no block array: its mass alone is the rest of the matrix.

    Args:
        states: The bodies.
        terms: The terms of each body.
    """

    def __init__(self, states: Sequence[State], terms: Terms) -> None:
        self.states, self.terms = tuple(states), terms
        self._inertia = {state.real: Parameters([1.0], state.real, state.device) for state in states}
        self.node_blocks = [
            state.model.zeros(6) if any(_has_blocks(term) for term in own) else None
            for state, own in zip(states, terms, strict=True)
        ]

    def inertia(self, state: State) -> wp.array:
        """1 / tau^2 [1/s2] on the device, shape (1,)."""
        return self._inertia[state.real].array

    def set_tau(self, tau: float) -> None:
        """Set the stage step [s] (host, between steps)."""
        for parameters in self._inertia.values():
            parameters.write([1.0 / (tau * tau)])

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return sum(blocks.capacity for blocks in self.node_blocks if blocks is not None)

    def update(self) -> None:
        """Collect the node blocks after the terms were linearised."""
        for state, own, blocks in zip(self.states, self.terms, self.node_blocks, strict=True):
            if blocks is not None:
                self._start_blocks(state, blocks)
                for term in own:
                    term.add_node_blocks(state, blocks)

    def add_diagonal(self, index: int, blocks: wp.array) -> None:
        """Write the 3 x 3 diagonal blocks of A of one body into `blocks`, shape (6, rows, columns)."""
        state, own, node_blocks = self.states[index], self.terms[index], self.node_blocks[index]
        if node_blocks is None:
            self._start_blocks(state, blocks)
        else:
            wp.copy(blocks, node_blocks)
        for term in own:
            if term.elastic:
                term.add_block_diagonal(state, blocks)

    def product(self) -> None:
        """product = free A search, and the partial sums of search.product into `State.dots`."""
        for state, own, blocks in zip(self.states, self.terms, self.node_blocks, strict=True):
            kernels = krylov(state.lane_width, state.real)
            if blocks is None:
                inputs = [state.mass, self.inertia(state), state.search, state.product]
                _launch(state, kernels.start_product, inputs)
            else:
                _launch(state, kernels.start_product_blocks, [blocks, state.search, state.product])
            for term in own:
                if term.elastic:
                    term.add_hessian_product(state, state.search, state.product)
            _launch(state, kernels.mask_dot, [state.free, state.search, state.product, state.dots])

    def _start_blocks(self, state: State, blocks: wp.array) -> None:
        kernels = krylov(state.lane_width, state.real)
        _launch(state, kernels.start_blocks, [state.mass, self.inertia(state), blocks])


def _has_blocks(term: Force) -> bool:
    return type(term).add_node_blocks is not Force.add_node_blocks


def _launch(state: State, kernel: Any, inputs: list[Any]) -> None:
    wp.launch(kernel, dim=state.layout.lane_dim, inputs=inputs, device=state.device)
