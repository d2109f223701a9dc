"""The guard of contact: changes displacements so that nothing crosses on the way (design 5.2)."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from warpdeform.forces.contact_lists import FoundRows, PairList
from warpdeform.forces.contact_slots import ContactSlots
from warpdeform.forces.force import BodyArrays, Force
from warpdeform.forces.ties import RigidTies
from warpdeform.kernels.contact_guard import contact_guard
from warpdeform.kernels.contact_impulses import ACTIVE, GUARD_STATE, HALVE, LIMITED, contact_impulses
from warpdeform.launching import choose, do_alone, repeat_while

RISKS_PER_NODE = 2
"""Pairs at risk that the guard takes on at a time, per node; what does not fit is found again in the next round."""
ROUNDS = 20
"""How often the guard looks for pairs at risk before it halves what nodes want to go."""
HALVINGS = 5
"""How often it does so before it shortens what is left."""
MOST_LAG = 1e-3
"""How far behind its path a pin may be held up by contact [m]."""
SWEEPS = 12
"""How often the pairs at risk are given impulses before they are looked for again."""


class ContactGuard:
    """Finds pairs at risk and takes the risk away; see :mod:`warpdeform.kernels.contact_guard`.

    Args:
        slots: The bodies in slots.
        found: Where searches leave what they find.
        inverse_masses: 1 over the mass of each slot [1/kg], 0 where it may not be pushed.
        spacing: Smallest distance of neighbours at rest [m].
        nodes: Nodes of all bodies.

    Attributes:
        state: int32 entries of :mod:`warpdeform.kernels.contact_impulses`; UPDATES, PUSHED and SHORTENED count over a
            step: updates, nodes that were pushed in them, and how often all of an update was made shorter.
        lag: How far behind their targets pinned nodes are at the end of a step [m], shape (1,).
        others: Terms, with their bodies, whose own guards must hold too.
        rigid: Nodes that follow others; they are not pushed themselves.
        directions: Displacements in slots [m].
        drifts: Boxes of the tree around them.
    """

    def __init__(
        self, slots: ContactSlots, found: FoundRows, inverse_masses: wp.array, spacing: float, nodes: int
    ) -> None:
        self._slots, self._found, self._unpinned = slots, found, inverse_masses
        self._spacing = slots.real(spacing)
        self._search, self._impulses = contact_guard(slots.width, slots.real), contact_impulses(slots.real)
        self._risks = PairList(found, slots.parts, slots.count, int(RISKS_PER_NODE * nodes), slots.device)
        self.directions, self._wanted, self.drifts = slots.vectors(), slots.vectors(), slots.tree()
        self._walls = slots.zeros(self._risks.capacity, self._impulses.Wall)
        self._amounts = slots.zeros(self._risks.capacity, self._impulses.Amounts)
        self._pushed = slots.zeros(slots.count, wp.int32)
        self._inverse_masses = slots.zeros(slots.count, slots.real)
        self._stirred = slots.zeros(slots.blocks, wp.int32)
        self.state, self._share = slots.zeros(GUARD_STATE, wp.int32), slots.zeros(1, slots.real)
        self._active, self._halve, self._limited = (self.state[k : k + 1] for k in (ACTIVE, HALVE, LIMITED))
        self.lag = slots.zeros(1, slots.real)
        self.others: list[tuple[Force, BodyArrays]] = []
        self.rigid: Sequence[RigidTies] = ()

    def bytes(self) -> int:
        """Device memory [bytes]."""
        arrays = (
            self.directions,
            self.drifts,
            self._inverse_masses,
            self._unpinned,
            self._walls,
            self._amounts,
            self._pushed,
            self._stirred,
            self.state,
            self._share,
        )
        return sum(int(a.capacity) for a in arrays) + self._risks.bytes()

    def begin(self) -> None:
        """A step begins: nothing has been cut yet."""
        do_alone(self.state.zero_)

    def find_way(self, position: str, goal: str, direction: str) -> None:
        """direction = goal - position."""
        for k, body in enumerate(self._slots.bodies):
            vectors = (getattr(body, name) for name in (position, goal, direction))
            self._slots.launch_nodes(self._impulses.find_way, k, *vectors)

    def go_way(self, position: str, direction: str, goal: str) -> None:
        """goal = position + direction."""
        for k, body in enumerate(self._slots.bodies):
            vectors = (getattr(body, name) for name in (position, direction, goal))
            self._slots.launch_nodes(self._impulses.go_way, k, *vectors)

    def judge_lag(self, targets: Sequence[wp.array], position: str, state: wp.array) -> None:
        """Measure how far behind their targets pinned nodes are, and veto a step where that is too far.

        Args:
            targets: Where pinned nodes of each body should be [m].
            position: Name of the vector of where they are.
            state: int32 entries of :mod:`warpdeform.kernels.newton`.
        """
        do_alone(self.lag.zero_)
        for k, (body, target) in enumerate(zip(self._slots.bodies, targets, strict=True)):
            inputs = (body.mass, body.free, target, getattr(body, position), self.lag)
            self._slots.launch_nodes(self._impulses.measure_lag, k, *inputs)
        self._slots.launch(self._impulses.judge_lag, 1, self._slots.real(MOST_LAG), self.lag, state)

    def take(self, direction: str) -> None:
        """Bring displacements of all bodies, by their name, into slots, and boxes around them."""
        self._slots.gather(direction, self.directions)
        self._slots.fit_tree(self.directions, self.drifts)

    def guard(self, position: str, direction: str) -> None:
        """Change displacements of all bodies; the boxes of the slots are around `position`, `take` was called.

        Args:
            position: Name of the vector that they start from.
            direction: Name of the displacements.
        """
        slots = self._slots
        for k, body in enumerate(slots.bodies):
            inputs = (body.free, self._unpinned, self._inverse_masses)
            slots.launch_nodes(self._impulses.hold_pinned, k, *inputs)
        slots.launch(self._impulses.begin_guard, slots.blocks, self.state, self._stirred)
        slots.launch(self._impulses.keep_directions, slots.count, self.directions, self._wanted)
        repeat_while(self._active, self._look, position=position, direction=direction)
        choose(self._limited, lambda: self._on_nodes(self._impulses.shorten, direction, self._share), None)

    def rest(self) -> None:
        """There is nothing to guard in this update."""
        self._slots.launch(self._impulses.count_update, 1, self.state)

    def _look(self, position: str, direction: str) -> None:
        """Look for pairs at risk, and push them apart."""
        slots, found = self._slots, self._found
        slots.launch(self._impulses.begin_round, 1, self._share, self._risks.lost)
        slots.launch(
            self._search.find_risks, (slots.blocks, slots.parts), slots.parts, self._spacing, slots.tables, slots.scene,
            self.directions, self.drifts, self._stirred, self._risks.lost, self._share,
            found.numbers, found.points, found.edges,
        )  # fmt: skip
        self._risks.pack(slots.tables)
        slots.launch(self._impulses.judge_round, 1, ROUNDS, HALVINGS, self._share, self.state)
        choose(self._active, lambda: self._push(position, direction), None)

    def _push(self, position: str, direction: str) -> None:
        choose(self._halve, lambda: self._start_again(direction), lambda: self._give_impulses(direction))
        for term, body in self.others:
            term.guard(body, getattr(body, position), getattr(body, direction))
        for ties in self.rigid:
            ties.spread(direction)
        self.take(direction)

    def _start_again(self, direction: str) -> None:
        """With half of what nodes wanted to go."""
        slots = self._slots
        slots.launch(self._impulses.halve_wanted, slots.count, self._stirred, self._wanted)
        self._on_nodes(self._impulses.halve_directions, direction, self._wanted)

    def _give_impulses(self, direction: str) -> None:
        slots, risks, kernels = self._slots, self._risks, self._impulses
        listed = (risks.threads, risks.counts, risks.pairs)
        masses, entered = self._inverse_masses, (risks.starts, risks.entries)
        slots.launch(kernels.raise_walls, risks.threads, *listed, slots.scene.laws, slots.points, self._walls)
        for _ in range(SWEEPS):
            slots.launch(
                kernels.find_impulses, risks.threads, *listed, self._walls, masses, self.directions, self._amounts
            )
            slots.launch(kernels.count_pushed, slots.count, *entered, self._amounts, self._pushed)
            slots.launch(kernels.share_impulses, risks.threads, *listed, self._pushed, self._amounts)
            slots.launch(kernels.give_impulses, slots.count, *entered, self._walls, self._amounts, self.directions)
        slots.launch(kernels.note_stirred, slots.blocks, slots.tables, risks.starts, risks.lost, self._stirred)
        self._on_nodes(kernels.return_directions, direction, risks.starts, self.directions, self.state)

    def _on_nodes(self, kernel: Any, vector: str, *inputs: Any) -> None:
        for k, body in enumerate(self._slots.bodies):
            self._slots.launch_nodes(kernel, k, *inputs, getattr(body, vector))


GUARD_KERNELS: Sequence[str] = (
    "contact_guard.find_risks",
    *(f"contact_impulses.{name}" for name in ("raise_walls", "find_impulses", "give_impulses", "return_directions")),
)
"""What the guard launches where something is at risk."""
