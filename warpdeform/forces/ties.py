"""Attachments between bodies: soft ones as springs, rigid ones as nodes that follow (kernels/ties.py)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.attachment import Attachment, Ties, find_all_ties
from warpdeform.body import Body
from warpdeform.forces.coupling import Coupling
from warpdeform.kernels.ties import ties as tie_kernels
from warpdeform.launching import launch_alone
from warpdeform.state import State


@dataclass(frozen=True)
class Side:
    """One side of the ties: the nodes of each tie, and the ties of each node.

    Attributes:
        places: Row and column of the nodes of each tie, int32, shape (ties, m, 2).
        weights: Their weights, shape (ties, m).
        nodes: Row and column of every node that has ties, int32, shape (n, 2).
        starts: Where its entries begin in the lists, int32, shape (n + 1,).
        tie_of: The tie of each entry, int32.
        shares: Its weight.
    """

    places: wp.array
    weights: wp.array
    nodes: wp.array
    starts: wp.array
    tie_of: wp.array
    shares: wp.array

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return sum(int(array.capacity) for array in vars(self).values())


def side_of(state: State, nodes: NDArray[np.int64], weights: NDArray[np.float64], only_free: bool = False) -> Side:
    """Tables of one side.

    Args:
        state: The body.
        nodes: Nodes of each tie, shape (ties, m, axes).
        weights: Their weights, shape (ties, m).
        only_free: Leave pinned nodes out of the lists.
    """
    ties, m, axes = nodes.shape
    places = state.layout.places(nodes.reshape(-1, axes))
    free = state.free.numpy()[0][places[:, 0], places[:, 1]] > 0
    listed = np.flatnonzero((weights.reshape(-1) != 0.0) & (free | (not only_free)))
    found, owner = np.unique(places[listed], axis=0, return_inverse=True)
    order = np.argsort(owner.reshape(-1), kind="stable")
    counts = np.bincount(owner.reshape(-1), minlength=len(found))
    device = state.device

    def integers(values: Any) -> wp.array:
        return wp.array(np.asarray(values), dtype=wp.int32, device=device)

    return Side(
        integers(places.reshape(ties, m, 2)),
        wp.array(weights, dtype=state.real, device=device),
        integers(found.reshape(-1, 2)),
        integers(np.concatenate([[0], np.cumsum(counts)])),
        integers(listed[order] // m),
        wp.array(weights.reshape(-1)[listed[order]], dtype=state.real, device=device),
    )


class SoftTies(Coupling):
    """Springs of length zero between nodes of one body and material points of another: k |d|^2 / 2 each.

    Args:
        state: The body whose nodes are tied.
        other: The other one, or the same.
        ties: The ties.
        stiffness: k [N/m].

    Attributes:
        stiffness: k of each tie [N/m], shape (ties,); may be changed between steps.
    """

    name = "attachment"

    def __init__(self, state: State, other: State, ties: Ties, stiffness: float) -> None:
        count = len(ties.nodes)
        self.states = (state, other)
        self._sides = (
            side_of(state, ties.nodes[:, None], np.ones((count, 1))),
            side_of(other, ties.points, ties.weights),
        )
        real, device = state.real, state.device
        self.stiffness: wp.array = wp.array(np.full(count, stiffness), dtype=real, device=device)
        self._stretch: wp.array = wp.zeros((count, 3), dtype=real, device=device)
        self._change: wp.array = wp.zeros((count, 3), dtype=real, device=device)
        self._kernels = tie_kernels(real)
        self._signs = (real(1.0), real(-1.0))

    @property
    def kernels(self) -> tuple[str, ...]:
        return tuple(f"ties.{name}" for name in ("stretch", "pull", "pull_without_own", "add_energy", "add_blocks"))

    def bytes(self) -> int:
        arrays = (self.stiffness, self._stretch, self._change)
        return sum(side.bytes() for side in self._sides) + sum(int(array.capacity) for array in arrays)

    def linearise(self, vector: str) -> None:
        self._measure(vector, self._stretch)

    def add_energy(self, vector: str) -> None:
        # In the memory of the change of a product, which is measured anew whenever it is needed.
        self._measure(vector, self._change)
        side, (state, _) = self._sides[0], self.states
        self._launch(
            "add_energy", len(side.nodes), side.nodes, side.starts, side.tie_of, self.stiffness, self._change,
            state.partials,
        )  # fmt: skip

    def add_gradient(self, vector: str, gradient: str) -> None:
        self._pull(self._stretch, gradient)

    def add_hessian_product(self, direction: str, product: str) -> None:
        self._measure(direction, self._change)
        self._pull(self._change, product, direction)

    def add_node_blocks(self, state: State, blocks: wp.array) -> None:
        for own, side in zip(self.states, self._sides, strict=True):
            if own is state:
                lists = (side.nodes, side.starts, side.tie_of, side.shares)
                self._launch("add_blocks", len(side.nodes), *lists, self.stiffness, blocks)

    def _measure(self, vector: str, stretch: wp.array) -> None:
        (near, far), (a, b) = self._sides, self.states
        tables = (near.places, near.weights, far.places, far.weights)
        self._launch("stretch", len(stretch), *tables, getattr(a, vector), getattr(b, vector), stretch)

    def _pull(self, stretch: wp.array, out: str, direction: str = "") -> None:
        for state, side, sign in zip(self.states, self._sides, self._signs, strict=True):
            inputs = [side.nodes, side.starts, side.tie_of, side.shares, self.stiffness, stretch, sign]
            inputs += [getattr(state, direction)] if direction else []
            name = "pull_without_own" if direction else "pull"
            self._launch(name, len(side.nodes), *inputs, getattr(state, out))

    def _launch(self, name: str, dim: int, *inputs: Any) -> None:
        if dim:
            launch_alone(getattr(self._kernels, name), dim, *inputs, device=self.states[0].device)


class RigidTies:
    """Nodes that follow material points of another body: they are no unknowns of their own.

    With r = T q, where q are the nodes that do not follow, gradients become T' g (`gather`) and corrections T z
    (`spread`): so conjugate gradient works on T' A T, and preconditioners on T P T', symmetric and positive definite.
    They treat every body by itself, but the diagonal blocks of nodes that follow hang on those that they follow
    (`hang`): without, a light ring that a curtain hangs on needs hundreds of iterations. Pinning the nodes that follow
    in P was tried too: 12 instead of 20 iterations for rings, 29 instead of 18 for two sheets that share an edge.

    Args:
        state: The body whose nodes follow.
        other: The body that they follow, or the same.
        ties: The ties; no node may follow twice, be pinned, or be followed itself.

    Attributes:
        nodes: The nodes that follow, shape (ties, axes).
    """

    def __init__(self, state: State, other: State, ties: Ties) -> None:
        self.states, self.nodes = (state, other), ties.nodes
        self._follower = side_of(state, ties.nodes[:, None], np.ones((len(ties.nodes), 1)))
        self._followed = side_of(other, ties.points, ties.weights, only_free=True)
        self._kernels = tie_kernels(state.real)

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return self._follower.bytes() + self._followed.bytes()

    def spread(self, vector: str) -> None:
        """Give the nodes that follow the value at their points."""
        a, b = (getattr(state, vector) for state in self.states)
        tables = (self._follower.places, self._followed.places, self._followed.weights)
        self._launch("spread", len(self._follower.places), *tables, b, a)

    def gather(self, vector: str) -> None:
        """Hand what lies at nodes that follow to the nodes that they follow."""
        a, b = (getattr(state, vector) for state in self.states)
        side = self._followed
        lists = (side.nodes, side.starts, side.tie_of, side.shares)
        self._launch("gather", len(side.nodes), *lists, self._follower.places, a, b)
        self._launch("clear", len(self._follower.places), self._follower.places, a)

    def hang(self, blocks: wp.array, other_blocks: wp.array) -> None:
        """Add blocks of the nodes that follow to those that they follow, arrays of shape (6, rows, columns)."""
        side = self._followed
        lists = (side.nodes, side.starts, side.tie_of, side.shares)
        self._launch("hang_blocks", len(side.nodes), *lists, self._follower.places, blocks, other_blocks)

    def _launch(self, name: str, dim: int, *inputs: Any) -> None:
        if dim:
            launch_alone(getattr(self._kernels, name), dim, *inputs, device=self.states[0].device)


def make_ties(
    attachments: Sequence[Attachment], bodies: Mapping[str, Body], states: Mapping[str, State]
) -> tuple[tuple[SoftTies, ...], tuple[RigidTies, ...]]:
    """What attachments become.

    Raises:
        InputError: All mistakes (:func:`warpdeform.attachment.find_all_ties`).
    """
    soft: list[SoftTies] = []
    rigid: list[RigidTies] = []
    for attachment, ties in zip(attachments, find_all_ties(attachments, bodies), strict=True):
        state, other = states[attachment.body], states[attachment.to]
        if attachment.stiffness is None:
            rigid.append(RigidTies(state, other, ties))
        else:
            soft.append(SoftTies(state, other, ties, attachment.stiffness))
    return tuple(soft), tuple(rigid)
