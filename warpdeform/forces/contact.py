"""Contact of deformable bodies with themselves and with each other (design 5.2)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.contact_friction import ContactFriction
from warpdeform.forces.contact_guard import GUARD_KERNELS, ContactGuard
from warpdeform.forces.contact_lists import FoundRows, PairList
from warpdeform.forces.contact_lookout import Lookout
from warpdeform.forces.contact_mesh import Surface
from warpdeform.forces.contact_slots import ContactSlots
from warpdeform.forces.coupling import Coupling
from warpdeform.forces.force import BodyArrays
from warpdeform.kernels.contact import FAR, FITTED, LIST_STATE, STALE, contact
from warpdeform.kernels.contact_impulses import PUSHED, SHORTENED, UPDATES
from warpdeform.kernels.contact_search import contact_search
from warpdeform.launching import choose, do_alone
from warpdeform.result import ContactStep

Array = NDArray[np.float64]

ROW_CAPACITY = 96
"""Pairs of either kind that one block of nodes may have."""
PAIRS_PER_NODE = 3
"""Pairs that the whole scene may have, per node."""
INNER = 0.5
"""Share of the distance at which skins touch that nothing is pressed below."""
WALL = 0.5
"""Share of the gap at which the wall begins."""
FLOOR = 0.01
"""Share of the gap, outside of the wall's inside, below which the guard lets nothing come nearer."""
SLACK = 0.2
"""Share of the smallest gap that nodes may have moved since a list of pairs was made, for it to be used again."""


@dataclass(frozen=True)
class Touching:
    """What holds between two bodies, by their numbers; lengths in metres.

    Attributes:
        bodies: Both bodies; twice the same for self-contact.
        design_speed: V [m/s].
        range: eps.
        cutoff: Distance of the skins beyond which there is no force.
        gap: Distance of the skins at rest.
        offset: Distance of the middle surfaces at which the skins touch.
        friction: Coefficient.
    """

    bodies: tuple[int, int]
    design_speed: float
    range: float
    cutoff: float
    gap: float
    offset: float = 0.0
    friction: float = 0.0

    def law(self) -> dict[str, float]:
        """The record for kernels."""
        inner = INNER * self.offset
        return {
            "active": 1, "strength": 0.5 * self.design_speed**2, "eps": self.range, "cutoff": self.cutoff,
            "offset": self.offset, "gap": self.gap, "friction": self.friction,
            "inner": inner, "wall": self.offset + WALL * self.gap - inner, "floor": inner + FLOOR * self.gap,
        }  # fmt: skip


class ContactSystem(Coupling):
    """All contact of a scene: one search, one list of pairs and one guard for all bodies.

    Args:
        states: Arrays of the bodies.
        surfaces: What they show.
        masses: Node masses [kg], by the nodes of each body.
        touching: Which of them feel each other.
        movable: 1 at nodes that the guard may push unless they are pinned, 0 elsewhere, by the nodes of each body;
            None: at all.

    Attributes:
        targets: Where pinned nodes are held [m], of each body; empty where no pins move and no obstacles push.
    """

    name = "contact"
    guarded = True

    def __init__(
        self,
        states: Sequence[BodyArrays],
        surfaces: Sequence[Surface],
        masses: Sequence[Array],
        touching: Sequence[Touching],
        movable: Sequence[Array] | None = None,
    ) -> None:
        self.states, self.touching = tuple(states), tuple(touching)
        self.slots = slots = ContactSlots(states, surfaces, _laws(len(states), touching))
        self._search, self._kernels = contact_search(slots.width, slots.real), contact(slots.real)
        nodes = sum(surface.grid.node_count for surface in surfaces)
        self._found = FoundRows(slots.blocks * slots.parts, max(ROW_CAPACITY // slots.parts, 8), slots.device)
        self.list = PairList(self._found, slots.parts, slots.count, int(PAIRS_PER_NODE * nodes), slots.device)
        movable = movable or [np.ones_like(mass) for mass in masses]
        inverse = [free / mass for free, mass in zip(movable, masses, strict=True)]
        spacing = min(surface.spacing for surface in surfaces)
        self.guarding = ContactGuard(slots, self._found, slots.upload_by_slot(inverse), spacing, nodes)
        self.lookout = Lookout(slots)
        self._masses = slots.upload_by_slot(masses)
        self._listed, self._moved, self._directions = (slots.vectors() for _ in range(3))
        self._state, self._move = slots.zeros(LIST_STATE, wp.int32), slots.zeros(1, slots.real)
        self._stale, self._boxes_fit = (self._state[entry : entry + 1] for entry in (STALE, FITTED))
        self._slack = slots.real(SLACK * min(each.gap for each in touching))
        self._weights = slots.zeros(self.list.capacity, slots.real)
        self._shares = slots.zeros(self.list.capacity, self._kernels.Shares)
        self._pushes = slots.zeros(self.list.capacity, self._kernels.Push)
        self._pulls = slots.zeros(self.list.capacity, self._kernels.V)
        self._diagonal = slots.zeros(slots.count, self._kernels.S)
        self._energies = slots.zeros(self.list.threads, wp.float64)
        self.friction: ContactFriction | None = None
        if any(each.friction > 0.0 for each in touching):
            self.friction = ContactFriction(slots, self.list, self._stale, states[0].iteration)
        self._closest = slots.zeros(1, slots.real)
        self._nodes, self._fitted = nodes, ""
        self.targets: Sequence[wp.array] = ()
        self.reset()

    @property
    def kernels(self) -> tuple[str, ...]:
        pairs = ("weigh_pairs", "linearise_pairs", "pair_energies", "add_pair_gradients", "add_pair_blocks")
        looks = ("box_edges", "close_rectangles", "look_around")
        lists = ("fill_pairs", "count_corners", "enter_corners", "sort_entries")
        return (
            *(f"boxes.{name}" for name in ("gather", "fit_leaves", "fit_level", "fit_simplices")),
            *(f"contact_lookout.{name}" for name in looks),
            "contact_search.find_pairs",
            *(f"contact_lists.{name}" for name in lists),
            *(f"contact.{name}" for name in (*pairs, "multiply_pairs", "add_couplings")),
            *GUARD_KERNELS,
        )

    def bytes(self) -> int:
        held = (self._masses, self._listed, self._moved, self._directions, self._weights, self._shares, self._pushes)
        own = sum(int(array.capacity) for array in (*held, self._pulls, self._diagonal, self._energies))
        own += self.friction.bytes() if self.friction else 0
        return (
            own
            + self.slots.bytes()
            + self._found.bytes()
            + self.list.bytes()
            + self.guarding.bytes()
            + self.lookout.bytes()
        )

    def begin(self) -> None:
        do_alone(self.list.lost.zero_)
        do_alone(lambda: self._closest.fill_(FAR))
        self.guarding.begin()
        self.lookout.begin()
        if self.friction:
            self.friction.begin()
        self._fitted = ""

    def finish(self) -> None:
        """As told by `Coupling`; `linearise` has been asked for the accepted positions last."""
        if self.friction:
            self.friction.finish(self._shares)
        self.lookout.begin()

    def judge(self, vector: str, state: wp.array) -> None:
        """Veto steps in which pins are held up."""
        if self.targets:
            self.guarding.judge_lag(self.targets, vector, state)

    def carry(self, origin: str, start: str) -> None:
        """Let pins, and what obstacles push, go as far as there is a way."""
        if self.targets:
            self.guarding.find_way(origin, start, "direction")
            self.guard(origin, "direction")
            self.guarding.go_way(origin, "direction", start)

    def report(self) -> ContactStep:
        state, (pairs, _, lost) = self.guarding.state.numpy(), self.list.counts.numpy()
        return ContactStep(
            pairs=int(pairs),
            lost=int(lost),
            guard_active=float(state[PUSHED] / max(int(state[UPDATES]) * self._nodes, 1)),
            shortened=int(state[SHORTENED]),
            smallest_distance=float(self._closest.numpy()[0]),
            lag=float(self.guarding.lag.numpy()[0]),
        )

    def reset(self) -> None:
        if self.friction:
            self.friction.clear()
        self.list.counts.zero_()
        self._state.zero_()
        self.lookout.begin()

    def linearise(self, vector: str) -> None:
        """Find out what pairs do at a vector of all bodies, by its name; find new ones if nodes have moved too far.

        Within a step the vector lies on the way that the guard has been asked about last: if nothing comes near on it,
        there is nothing to find out.
        """
        choose(self.lookout.near, lambda: self._linearise(vector), None)
        self._fitted = vector

    def _linearise(self, vector: str) -> None:
        slots = self.slots
        slots.gather(vector, slots.points)
        slots.launch(self._kernels.begin_move, 1, self._move)
        slots.launch(self._kernels.measure_move, slots.blocks, slots.points, self._listed, self._move)
        slots.launch(self._kernels.judge_move, 1, self._slack, self._move, self._state)
        choose(self._stale, self._find, None)
        choose(self.list.any, self.narrow, None)

    def _find(self) -> None:
        slots = self.slots
        slots.fit()
        self.search()
        slots.launch(self._kernels.keep_points, slots.blocks, slots.points, self._listed)
        choose(self.list.any, lambda: self._on_pairs("weigh_pairs", slots.points, self._masses, self._weights), None)

    def search(self) -> None:
        """List the pairs that feel each other, at the slots' points with boxes around them."""
        slots, found = self.slots, self._found
        slots.launch(
            self._search.find_pairs, (slots.blocks, slots.parts), slots.parts, slots.tables, slots.scene,
            self.list.lost, found.numbers, found.points, found.edges,
        )  # fmt: skip
        self.list.pack(slots.tables)

    def narrow(self) -> None:
        """Find out what the listed pairs do at the slots' points."""
        slots = self.slots
        laws = (slots.scene.laws, self._weights)
        self._on_pairs("linearise_pairs", *laws, slots.points, self._closest, self._shares, self._pushes)
        if self.friction:
            self.friction.linearise(self._shares, self._pushes)
        entered = (self.list.starts, self.list.entries, self._shares, self._pushes)
        slots.launch(self._kernels.sum_diagonal, slots.count, *entered, self._diagonal)

    def add_energy(self, vector: str) -> None:
        """Add the energy [J] of the listed pairs to one entry of the first body's `partials`."""
        first = self.states[0]

        def add() -> None:
            slots = self.slots
            slots.gather(vector, self._moved)
            self._on_pairs("pair_energies", slots.scene.laws, self._weights, self._moved, self._energies)
            if self.friction:
                self.friction.add_energies(self._shares, self._moved, self._energies)
            slots.launch(self._kernels.add_energies, 1, first.layout.halo, self._energies, first.partials)

        choose(self.list.any, add, None)

    def add_gradient(self, vector: str, gradient: str) -> None:
        inputs = (self.list.starts, self.list.entries, self._shares, self._pushes)
        self._on_nodes("add_pair_gradients", lambda state: (*inputs, getattr(state, gradient)))

    def add_node_blocks(self, state: Any, blocks: wp.array) -> None:
        inputs = (self.list.starts, self._diagonal, blocks)
        if state in self.states:
            body = self.states.index(state)
            kernel = self._kernels.add_pair_blocks
            choose(self.list.any, lambda: self.slots.launch_nodes(kernel, body, *inputs), None)

    def add_hessian_product(self, direction: str, product: str) -> None:
        def multiply() -> None:
            self.slots.gather(direction, self._directions)
            self._on_pairs("multiply_pairs", self._shares, self._pushes, self._directions, self._pulls)

        choose(self.list.any, multiply, None)
        inputs = (self.list.starts, self.list.entries, self._shares, self._pulls, self._diagonal)
        self._on_nodes("add_couplings", lambda s: (*inputs, getattr(s, direction), getattr(s, product)))

    def guard(self, position: str, direction: str) -> None:
        """As told by `Coupling`; where `linearise` was asked for the same vector just before, its boxes may fit."""
        slots, fitted = self.slots, self._fitted == position

        def fit() -> None:
            slots.gather(position, slots.points)
            slots.fit_boxes()

        def unless_fitted(operation: Callable[[], None]) -> None:
            if fitted:
                choose(self._boxes_fit, None, operation)
            else:
                operation()

        def guard() -> None:
            unless_fitted(slots.fit_simplices)
            self.guarding.guard(position, direction)

        unless_fitted(fit)
        self.guarding.take(direction)
        self.lookout.look(self.guarding.directions, self.guarding.drifts)
        choose(self.lookout.near, guard, self._rest)

    def _rest(self) -> None:
        """Nothing comes near: there are no pairs, and nothing to guard."""
        self.slots.launch(self._kernels.drop_list, 1, self.list.counts, self._state)
        self.guarding.rest()

    def _on_nodes(self, name: str, inputs: Callable[[BodyArrays], Sequence[Any]]) -> None:
        """Launch a kernel over the nodes of all bodies, if there are pairs."""
        kernel = getattr(self._kernels, name)

        def launch() -> None:
            for body, state in enumerate(self.states):
                self.slots.launch_nodes(kernel, body, *inputs(state))

        choose(self.list.any, launch, None)

    def _on_pairs(self, name: str, *inputs: object) -> None:
        """Launch a kernel over the list."""
        pairs = self.list
        kernel = getattr(self._kernels, name)
        self.slots.launch(kernel, pairs.threads, pairs.threads, pairs.counts, pairs.pairs, *inputs)


def _laws(bodies: int, touching: Sequence[Touching]) -> list[dict[str, float]]:
    """What holds between every two bodies, in rows of the first."""
    laws: list[dict[str, float]] = [{} for _ in range(bodies * bodies)]
    for each in touching:
        a, b = each.bodies
        laws[a * bodies + b] = laws[b * bodies + a] = each.law()
    return laws
