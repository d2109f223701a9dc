"""Contact of deformable bodies with themselves and with each other (design 5.2)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.contact_lists import FoundRows, PairList
from warpdeform.forces.contact_mesh import BLOCK, ContactMesh, Surface
from warpdeform.forces.force import BodyArrays, Force
from warpdeform.kernels.boxes import Tables, box_words, boxes
from warpdeform.kernels.contact import contact
from warpdeform.kernels.contact_guard import ACTIVE, GUARD_STATE, LIMITED, contact_guard, contact_impulses
from warpdeform.kernels.contact_law import contact_law
from warpdeform.kernels.contact_search import contact_search
from warpdeform.launching import choose, do_alone, launch_alone, launch_nodes, repeat_while

Array = NDArray[np.float64]

ROW_CAPACITY = 96
"""Pairs of either kind that one block of nodes may have."""
PAIRS_PER_NODE = 3
"""Pairs that the whole scene may have, per node."""
RISKS_PER_NODE = 2
"""Pairs at risk that the guard takes on at a time, per node."""
ROUNDS = 16
"""How often the guard looks for pairs at risk before it shortens everything."""
SWEEPS = 6
"""How often the pairs at risk are given impulses before they are looked for again."""
FLOOR = 0.02
"""Share of the gap below which the guard lets nothing come nearer."""
PARTS = 16
"""Threads that share a block on CUDA."""


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


class ContactSystem:
    """All contact of a scene: one search, one list of pairs, one guard for all bodies.

    Each body has a :class:`Contact` term. What concerns all bodies is launched in the term of the first of them.

    Args:
        bodies: Arrays of the bodies.
        surfaces: What they show.
        masses: Node masses [kg], by the nodes of each body.
        touching: Which of them feel each other.
    """

    def __init__(
        self,
        bodies: Sequence[BodyArrays],
        surfaces: Sequence[Surface],
        masses: Sequence[Array],
        touching: Sequence[Touching],
    ) -> None:
        first = bodies[0]
        self.bodies, self.touching = tuple(bodies), tuple(touching)
        self.real, self.device = first.real, first.device
        self.mesh = mesh = ContactMesh(surfaces)
        self._width = 1 if self.device.is_cuda else first.lane_width
        self._parts = PARTS if self.device.is_cuda else 1
        self._boxes, self._search = boxes(self._width, self.real), contact_search(self._width, self.real)
        self._pairs, self._guard = contact(self.real), contact_guard(self._width, self.real)
        self._impulses = contact_impulses(self.real)
        rows = mesh.blocks * self._parts
        nodes = sum(surface.grid.node_count for surface in surfaces)
        self._found = FoundRows(rows, max(ROW_CAPACITY // self._parts, 8), self.device)
        self.list = PairList(self._found, self._parts, mesh.slot_count, PAIRS_PER_NODE * nodes, self.device)
        self.risks = PairList(self._found, self._parts, mesh.slot_count, RISKS_PER_NODE * nodes, self.device)
        self._tables = self._make_tables()
        self._laws: wp.array = wp.array(self._law_records(), dtype=contact_law(self.real), device=self.device)

        def zeros(count: int, dtype: Any) -> wp.array:
            return wp.zeros(count, dtype=dtype, device=self.device)

        self.points, self._moved, self.directions = (self._slots_array() for _ in range(3))
        self.rest = self._upload(np.moveaxis(mesh.rest, -1, 0), self.real)
        self._scene = self._make_scene()
        self._tree = self._scene.boxes
        self._border = self._upload(mesh.wings.min(axis=0)[None] < 0, self.real)
        self._weights = zeros(self.list.capacity, self.real)
        self._pushes = zeros(self.list.capacity, self._pairs.Push)
        self._pulls = zeros(self.list.capacity, self._pairs.V)
        self._energies = zeros(self.list.threads, wp.float64)
        self._levels = [self._upload(level, wp.int32) for level in mesh.levels]
        self._masses = self._upload(self._by_slot(masses), self.real)
        inverse = [
            body.layout.unpack(body.free.numpy())[..., 0] / mass for body, mass in zip(bodies, masses, strict=True)
        ]
        self._inverse_masses = self._upload(self._by_slot(inverse), self.real)
        self._drifts = zeros(len(mesh.skip), box_words(self.real).Box)
        self._walls = zeros(self.risks.capacity, self._impulses.Wall)
        self._amounts = zeros(self.risks.capacity, self._impulses.Amounts)
        self.guard_state, self._share = zeros(GUARD_STATE, wp.int32), zeros(1, self.real)
        self._guard_active = self.guard_state[ACTIVE : ACTIVE + 1]
        self._guard_limits = self.guard_state[LIMITED : LIMITED + 1]
        self._spacing = self.real(min(surface.spacing for surface in surfaces))
        self.other_guards: list[tuple[Force, BodyArrays]] = []
        self._fitted = ""
        self._flat: dict[int, wp.array] = {}
        self._node_slots = [self._slots_of(k) for k in range(len(bodies))]

    def terms(self) -> list["Contact"]:
        """The term of each body."""
        return [Contact(self, k) for k in range(len(self.bodies))]

    def bytes(self) -> int:
        """Device memory [bytes]."""
        held = [self._moved, self.directions, self._drifts, self._walls, self._amounts, self._inverse_masses]
        held += [self._border, self._weights, self._pushes, self._pulls, self._masses, self._nodes]
        held += [*self._node_slots, *self._levels]
        for struct, kind in ((self._tables, Tables), (self._scene, self._search.Scene)):
            held += [each for name in kind.vars if isinstance(each := getattr(struct, name), wp.array)]
        own = sum(int(array.capacity) for array in held)
        return own + self._found.bytes() + self.list.bytes() + self.risks.bytes()

    # What the terms ask for ----------------------------------------------------------------------------------------

    def search(self, vector: str) -> None:
        """Find the pairs at a vector of all bodies, for example "z"."""
        self._take_positions(vector)
        blocks, scene = self.mesh.blocks, self._scene
        self._alone(
            self._search.find_pairs, (blocks, self._parts), self._parts, self._tables, scene,
            self.list.lost, self._found.numbers, self._found.points, self._found.edges,
        )  # fmt: skip
        self.list.pack(self._tables)
        choose(self.list.any, self._weigh, None)

    def _take_positions(self, vector: str) -> None:
        """Bring positions into slots, with the boxes and cones around them."""
        self._gather(vector, self.points)
        self._fit(self.points, self._tree)
        blocks, flat, scene = self.mesh.blocks, self._flattened(self.points), self._scene
        self._alone(
            self._boxes.fit_simplices, blocks, self._tables, flat, self._border, scene.cones,
            scene.triangle_boxes, scene.edge_boxes, scene.sharp,
        )  # fmt: skip
        self._fitted = vector

    def _weigh(self) -> None:
        listed = (self.list.threads, self.list.counts, self.list.pairs)
        self._alone(self._pairs.weigh_pairs, self.list.threads, *listed, self.points, self._masses, self._weights)

    def linearise(self, vector: str) -> None:
        """Find the pairs, and what they do, at a vector of all bodies."""
        self.search(vector)
        choose(self.list.any, self._linearise, None)

    def _linearise(self) -> None:
        self._alone(self._pairs.linearise_pairs, self.list.threads, *self._listed(), self.points, self._pushes)

    def add_energy(self, vector: str, partials: wp.array, halo: int) -> None:
        """Add the energy [J] of the listed pairs at a vector of all bodies to one entry of `partials`."""

        def add() -> None:
            self._gather(vector, self._moved)
            self._alone(self._pairs.pair_energies, self.list.threads, *self._listed(), self._moved, self._energies)
            self._alone(self._pairs.add_energies, 1, halo, self._energies, partials)

        choose(self.list.any, add, None)

    def add_gradient(self, body: int, gradient: wp.array) -> None:
        """Add the gradient [N] of one body."""
        choose(self.list.any, lambda: self._spread(body, "add_pair_gradients", self._pushes, gradient), None)

    def add_blocks(self, body: int, blocks: wp.array) -> None:
        """Add the diagonal blocks [N/m] of one body."""
        choose(self.list.any, lambda: self._spread(body, "add_pair_blocks", self._pushes, blocks), None)

    def multiply(self, vector: str) -> None:
        """Multiply the pairs' blocks with a vector of all bodies."""

        def multiply() -> None:
            self._gather(vector, self.directions)
            listed = (self.list.threads, self.list.counts, self.list.pairs)
            self._alone(
                self._pairs.multiply_pairs, self.list.threads, *listed, self._pushes, self.directions, self._pulls
            )

        choose(self.list.any, multiply, None)

    def add_couplings(self, body: int, direction: wp.array, product: wp.array) -> None:
        """Add the product with what couples the nodes of one body to others, after `multiply`."""
        inputs = (self._pushes, self._pulls, direction, product)
        choose(self.list.any, lambda: self._spread(body, "add_couplings", *inputs), None)

    def begin(self) -> None:
        """A step begins: nothing has been cut yet, and positions have changed."""
        do_alone(self.guard_state.zero_)
        do_alone(self.list.lost.zero_)
        do_alone(self.risks.lost.zero_)
        self._fitted = ""

    def guard(self, position: str, direction: str) -> None:
        """Change displacements of all bodies so that nothing crosses on the way.

        The boxes of the positions are those of `linearise` where that was asked for the same vector just before.
        """
        if self._fitted != position:
            self._take_positions(position)
        self._alone(self._impulses.begin_guard, 1, self.guard_state)
        repeat_while(self._guard_active, self._look_for_risks, position=position, direction=direction)
        choose(self._guard_limits, lambda: self._shorten(direction), None)

    def _look_for_risks(self, position: str, direction: str) -> None:
        blocks, found = self.mesh.blocks, self._found
        self._gather(direction, self.directions)
        self._fit(self.directions, self._drifts)
        self._alone(self._impulses.begin_round, 1, self._share)
        self._alone(
            self._guard.find_risks, (blocks, self._parts), self._parts, self._spacing, self._tables, self._scene,
            self.directions, self._drifts, self.risks.lost, self._share, found.numbers, found.points, found.edges,
        )  # fmt: skip
        self.risks.pack(self._tables)
        self._alone(
            self._impulses.judge_round, 1, ROUNDS, self.risks.counts, self._share, self.guard_state
        )
        choose(self._guard_active, lambda: self._push(position, direction), None)

    def _push(self, position: str, direction: str) -> None:
        risks = self.risks
        self._give_impulses()
        for k, body in enumerate(self.bodies):
            inputs = (self._node_slots[k], risks.starts, self.directions, getattr(body, direction))
            layout = body.layout
            launch_nodes(self._impulses.return_directions, layout, layout.halo, *inputs, device=self.device)
        for term, body in self.other_guards:
            term.guard(body, getattr(body, position), getattr(body, direction))

    def _give_impulses(self) -> None:
        risks, slots = self.risks, self.mesh.slot_count
        listed = (risks.threads, risks.counts, risks.pairs)
        self._alone(self._impulses.raise_walls, risks.threads, *listed, self._laws, self.points, self._walls)
        for _ in range(SWEEPS):
            self._alone(
                self._impulses.find_impulses, risks.threads, *listed, self._walls, risks.starts, self._inverse_masses,
                self.directions, self._amounts,
            )  # fmt: skip
            self._alone(
                self._impulses.give_impulses, slots, risks.starts, risks.entries, self._walls, self._amounts,
                self.directions,
            )  # fmt: skip

    def _shorten(self, direction: str) -> None:
        for body in self.bodies:
            layout, inputs = body.layout, (self._share, getattr(body, direction))
            launch_nodes(self._impulses.shorten, layout, layout.halo, *inputs, device=self.device)

    def clear(self) -> None:
        """Forget all pairs."""
        self.list.counts.zero_()

    # How it is done ------------------------------------------------------------------------------------------------

    def _listed(self) -> tuple[Any, ...]:
        return (self.list.threads, self.list.counts, self.list.pairs, self._laws, self._weights)

    def _spread(self, body: int, name: str, *inputs: Any) -> None:
        """Launch a kernel over the nodes of a body that collects what its pairs do."""
        layout = self.bodies[body].layout
        pairs = (self._node_slots[body], self.list.starts, self.list.entries)
        launch_nodes(getattr(self._pairs, name), layout, layout.halo, *pairs, *inputs, device=self.device)

    def _gather(self, vector: str, slots: wp.array) -> None:
        """Bring a vector of all bodies into slots."""
        for k, body in enumerate(self.bodies):
            array = getattr(body, vector)
            blocks = np.flatnonzero(self.mesh.body == k)
            dim = (len(blocks), BLOCK // self._width)
            self._alone(self._boxes.gather, dim, int(blocks[0]), self._nodes, self._flattened(array), slots)

    def _fit(self, points: wp.array, tree: wp.array) -> None:
        """Boxes of the tree around points in slots."""
        self._alone(self._boxes.fit_leaves, self.mesh.blocks, self._tables, points, tree)
        for level in self._levels:
            self._alone(self._boxes.fit_level, level.shape[0], self._tables, level, tree)

    def _alone(self, kernel: Any, dim: Any, *inputs: Any) -> None:
        launch_alone(kernel, dim, *inputs, device=self.device)

    def _flattened(self, array: wp.array) -> wp.array:
        """A component array with all places in one row."""
        if array.ptr not in self._flat:
            self._flat[array.ptr] = array.reshape((array.shape[0], 1, -1))
        return self._flat[array.ptr]

    # Tables --------------------------------------------------------------------------------------------------------

    def _upload(self, values: NDArray[Any], dtype: Any) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)

    def _slots_array(self) -> wp.array:
        return wp.zeros((3, self.mesh.blocks, BLOCK), dtype=self.real, device=self.device)

    def _by_slot(self, values: Sequence[Array]) -> Array:
        """A number per node of each body as one per slot."""
        slots = np.zeros(self.mesh.slot_count)
        for k, of_nodes in enumerate(values):
            mine = self.mesh.body == k
            slots.reshape(-1, BLOCK)[mine] = np.reshape(of_nodes, -1)[self.mesh.nodes[mine]]
        return slots

    def _slots_of(self, body: int) -> wp.array:
        """Slot at every place of a body's component arrays, -1 where there is none."""
        layout, slots = self.bodies[body].layout, self.mesh.slots[body]
        table = np.full((layout.rows, layout.columns), -1)
        row, column = layout.places(_indices(layout.nodes)).T
        table[row, column] = slots
        return self._upload(table, wp.int32)

    def _make_tables(self) -> Any:
        mesh, tables = self.mesh, Tables()
        tables.bodies = len(self.bodies)
        named = {
            **{f"{name}_{letter}": part for name, parts in (
                ("triangle", mesh.triangles), ("across", mesh.across), ("edge", mesh.edges), ("wing", mesh.wings),
            ) for letter, part in zip("abcd", parts, strict=False)},
        }  # fmt: skip
        tables.place = self._upload(mesh.place, wp.vec3i)
        for name in Tables.vars:
            if name not in ("bodies", "place"):
                setattr(tables, name, self._upload(named.get(name, getattr(mesh, name, None)), wp.int32))
        places = np.zeros_like(mesh.nodes)
        for k, body in enumerate(self.bodies):
            row, column = body.layout.places(_indices(body.layout.nodes)).T
            mine = mesh.body == k
            places[mine] = (row * body.layout.columns + column)[mesh.nodes[mine]]
        self._nodes = self._upload(places, wp.int32)
        return tables

    def _make_scene(self) -> Any:
        mesh, scene, shape = self.mesh, self._search.Scene(), box_words(self.real)

        def rows(components: int, like: NDArray[Any]) -> wp.array:
            return wp.zeros((components, like.shape[-2], BLOCK), dtype=self.real, device=self.device)

        scene.points, scene.rest = self.points, self.rest
        scene.boxes = wp.zeros(len(mesh.skip), dtype=shape.Box, device=self.device)
        scene.cones = wp.zeros(mesh.blocks, dtype=shape.Cone, device=self.device)
        scene.triangle_boxes, scene.edge_boxes = rows(6, mesh.triangles), rows(6, mesh.edges)
        scene.sharp, scene.laws = rows(1, mesh.edges), self._laws
        reaches, floors = (np.full((len(self.bodies), len(self.bodies)), -1.0) for _ in range(2))
        for each in self.touching:
            a, b = each.bodies
            reaches[a, b] = reaches[b, a] = each.cutoff + each.offset
            floors[a, b] = floors[b, a] = FLOOR * each.gap
        scene.reaches = self._upload(reaches.reshape(-1), self.real)
        scene.floors = self._upload(floors.reshape(-1), self.real)
        scene.largest_floor = self.real(floors.max())
        return scene

    def _law_records(self) -> NDArray[np.void]:
        count = len(self.bodies)
        records = np.zeros(count * count, dtype=contact_law(self.real).numpy_dtype())
        for each in self.touching:
            a, b = each.bodies
            for record in (records[a * count + b : a * count + b + 1], records[b * count + a : b * count + a + 1]):
                record["active"], record["strength"] = 1, 0.5 * each.design_speed**2
                record["eps"], record["cutoff"], record["offset"] = each.range, each.cutoff, each.offset
                record["gap"], record["friction"] = each.gap, each.friction
                record["floor"] = FLOOR * each.gap
        return records


class Contact(Force):
    """The contact of one body with itself and others.

    Attributes:
        system: What it shares with the other bodies.
    """

    name = "contact"

    def __init__(self, system: ContactSystem, body: int) -> None:
        self.system, self._body = system, body
        self._leads, self._ends = body == 0, body == len(system.bodies) - 1

    @property
    def kernels(self) -> tuple[str, ...]:
        names = (
            "boxes.gather",
            "boxes.fit_leaves",
            "boxes.fit_level",
            "boxes.fit_simplices",
            "contact_search.find_pairs",
        )
        lists = ("note_length", "fill_pairs", "count_corners", "enter_corners", "sort_entries")
        pairs = ("weigh_pairs", "linearise_pairs", "pair_energies", "add_pair_gradients", "add_pair_blocks")
        return (
            *names,
            *(f"contact_lists.{name}" for name in lists),
            *(f"contact.{name}" for name in (*pairs, "multiply_pairs", "add_couplings")),
        )

    def bytes(self) -> int:
        return self.system.bytes() if self._leads else 0

    def begin(self, body: BodyArrays) -> None:
        if self._leads:
            self.system.begin()

    def linearise(self, body: BodyArrays, position: wp.array) -> None:
        if self._leads:
            self.system.linearise(_name_of(body, position))

    def add_energy(self, body: BodyArrays, position: wp.array, partials: wp.array) -> None:
        if self._leads:
            self.system.add_energy(_name_of(body, position), partials, body.layout.halo)

    def add_gradient(self, body: BodyArrays, position: wp.array, gradient: wp.array) -> None:
        self.system.add_gradient(self._body, gradient)

    def add_node_blocks(self, body: BodyArrays, blocks: wp.array) -> None:
        self.system.add_blocks(self._body, blocks)

    def add_coupling_product(self, body: BodyArrays, direction: wp.array, product: wp.array) -> None:
        if self._leads:
            self.system.multiply(_name_of(body, direction))
        self.system.add_couplings(self._body, direction, product)

    def guard(self, body: BodyArrays, position: wp.array, direction: wp.array) -> None:
        if self._ends:
            self.system.guard(_name_of(body, position), _name_of(body, direction))

    def reset(self) -> None:
        if self._leads:
            self.system.clear()


def _name_of(body: BodyArrays, array: wp.array) -> str:
    """Which vector of a body an array is: that of the others has the same name."""
    for name, value in vars(body).items():
        if value is array:
            return name
    raise ValueError("contact needs the vectors of all its bodies: the array is none of the body's own")


def _indices(nodes: Sequence[int]) -> NDArray[np.int64]:
    return np.stack(np.meshgrid(*(np.arange(n) for n in nodes), indexing="ij"), axis=-1).reshape(-1, len(nodes))
