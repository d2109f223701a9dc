"""The nodes of all bodies that feel each other in one order, on the device: slots, and what is around them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.contact_mesh import BLOCK, ContactMesh, Surface
from warpdeform.forces.force import BodyArrays
from warpdeform.kernels.boxes import Tables, box_words, boxes
from warpdeform.kernels.contact_law import contact_law
from warpdeform.kernels.contact_search import contact_search
from warpdeform.launching import launch_alone, launch_nodes

Array = NDArray[np.float64]

PARTS = 16
"""Threads that share a block in a search on CUDA; on the CPU it has one."""


class ContactSlots:
    """Bodies in slots, with the tree of boxes.

    Args:
        bodies: Arrays of the bodies.
        surfaces: What they show.
        laws: Records of :func:`warpdeform.kernels.contact_law.contact_law`, for every ordered pair of bodies.

    Attributes:
        mesh: The tables on the host.
        tables: The tables on the device.
        scene: What searches read: positions, boxes, cones and laws.
        points: Positions in slots [m]; those that the boxes of the scene are around.
        width: Lane width of the kernels.
        parts: Threads that share a block in a search.
    """

    def __init__(
        self, bodies: Sequence[BodyArrays], surfaces: Sequence[Surface], laws: Sequence[dict[str, float]]
    ) -> None:
        self.bodies, self.mesh = tuple(bodies), ContactMesh(surfaces)
        self.real, self.device = bodies[0].real, bodies[0].device
        self.width = 1 if self.device.is_cuda else bodies[0].lane_width
        self.parts = PARTS if self.device.is_cuda else 1
        self.blocks, self.count = self.mesh.blocks, self.mesh.slot_count
        self._kernels = boxes(self.width, self.real)
        self._flat: dict[int, wp.array] = {}
        self._first_block = [int(np.flatnonzero(self.mesh.body == k)[0]) for k in range(len(bodies))]
        self._block_count = [int(np.count_nonzero(self.mesh.body == k)) for k in range(len(bodies))]
        self._levels = [self.upload(level, wp.int32) for level in self.mesh.levels]
        self._border = self.upload(self.mesh.wings.min(axis=0)[None] < 0, self.real)
        self._node_slots = [self._slots_of(k) for k in range(len(bodies))]
        self._nodes = self._places()
        self.tables = self._make_tables()
        self.points = self.vectors()
        self.scene = self._make_scene(laws)

    def bytes(self) -> int:
        """Device memory [bytes]."""
        held = [*self._levels, self._border, *self._node_slots, self._nodes]
        kinds: list[tuple[Any, Any]] = [(self.tables, Tables)]
        kinds.append((self.scene, contact_search(self.width, self.real).Scene))
        for struct, kind in kinds:
            held += [each for name in kind.vars if isinstance(each := getattr(struct, name), wp.array)]
        return sum(int(array.capacity) for array in held)

    def zeros(self, count: int, dtype: Any) -> wp.array:
        """An array of zeros."""
        return wp.zeros(count, dtype=dtype, device=self.device)

    def vectors(self) -> wp.array:
        """A vector per slot, shape (3, blocks, 16)."""
        return wp.zeros((3, self.blocks, BLOCK), dtype=self.real, device=self.device)

    def tree(self) -> wp.array:
        """A box for every box of the tree."""
        return self.zeros(len(self.mesh.skip), box_words(self.real).Box)

    def upload(self, values: NDArray[Any], dtype: Any) -> wp.array:
        """An array on the device."""
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)

    def upload_by_slot(self, of_nodes: Sequence[Array]) -> wp.array:
        """A number per node of each body, as one per slot."""
        slots = np.zeros((self.blocks, BLOCK))
        for k, values in enumerate(of_nodes):
            mine = self.mesh.body == k
            slots[mine] = np.reshape(values, -1)[self.mesh.nodes[mine]]
        return self.upload(slots.reshape(-1), self.real)

    def gather(self, vector: str, slots: wp.array) -> None:
        """Bring a vector of all bodies, by its name, into slots."""
        for k, body in enumerate(self.bodies):
            flat = self.flattened(getattr(body, vector))
            dim = (self._block_count[k], BLOCK // self.width)
            self.launch(self._kernels.gather, dim, self._first_block[k], self._nodes, flat, slots)

    def fit_tree(self, slots: wp.array, tree: wp.array) -> None:
        """Boxes of the tree around vectors in slots."""
        self.launch(self._kernels.fit_leaves, self.blocks, self.tables, slots, tree)
        self.fit_levels(tree)

    def fit_levels(self, tree: wp.array) -> None:
        """Inner boxes of a tree around its leaves."""
        for level in self._levels:
            self.launch(self._kernels.fit_level, level.shape[0], self.tables, level, tree)

    def fit(self) -> None:
        """Boxes and cones of the scene around `points`."""
        self.fit_boxes()
        self.fit_simplices()

    def fit_boxes(self) -> None:
        """Boxes of the scene's tree around `points`."""
        self.fit_tree(self.points, self.scene.boxes)

    def fit_simplices(self) -> None:
        """Cones of blocks, and boxes of triangles and edges, around `points`."""
        scene = self.scene
        self.launch(
            self._kernels.fit_simplices, self.blocks, self.tables, self.flattened(self.points), self._border,
            scene.cones, scene.triangle_boxes, scene.edge_boxes, scene.sharp,
        )  # fmt: skip

    def launch(self, kernel: Any, dim: Any, *inputs: Any) -> None:
        """Launch a kernel over blocks, slots or pairs."""
        launch_alone(kernel, dim, *inputs, device=self.device)

    def launch_nodes(self, kernel: Any, body: int, *inputs: Any) -> None:
        """Launch a kernel over the nodes of a body; it is given the halo and the slots of the nodes first."""
        layout = self.bodies[body].layout
        launch_nodes(kernel, layout, layout.halo, self._node_slots[body], *inputs, device=self.device)

    def flattened(self, array: wp.array) -> wp.array:
        """A component array with all places in one row."""
        if array.ptr not in self._flat:
            self._flat[array.ptr] = array.reshape((array.shape[0], 1, -1))
        return self._flat[array.ptr]

    def _slots_of(self, body: int) -> wp.array:
        """Slot at every place of a body's component arrays, -1 where there is none."""
        layout = self.bodies[body].layout
        table = np.full((layout.rows, layout.columns), -1)
        row, column = layout.places(_indices(layout.nodes)).T
        table[row, column] = self.mesh.slots[body]
        return self.upload(table, wp.int32)

    def _places(self) -> wp.array:
        """Place of the node of each slot in the component arrays of its body, all rows taken as one."""
        places = np.zeros_like(self.mesh.nodes)
        for k, body in enumerate(self.bodies):
            row, column = body.layout.places(_indices(body.layout.nodes)).T
            mine = self.mesh.body == k
            places[mine] = (row * body.layout.columns + column)[self.mesh.nodes[mine]]
        return self.upload(places, wp.int32)

    def _make_tables(self) -> Any:
        mesh = self.mesh
        tables: Any = Tables()
        tables.bodies = len(self.bodies)
        tables.place = self.upload(mesh.place, wp.vec3i)
        corners = (("triangle", mesh.triangles), ("across", mesh.across), ("edge", mesh.edges), ("wing", mesh.wings))
        for name, parts in corners:
            for letter, part in zip("abc", parts, strict=False):
                setattr(tables, f"{name}_{letter}", self.upload(part, wp.int32))
        for name in ("body", "present", "ring", "ring_start", "owner", "border", "border_start"):
            setattr(tables, name, self.upload(getattr(mesh, name), wp.int32))
        for name in ("triangle_count", "triangle_row_start", "edge_count", "edge_row_start"):
            setattr(tables, name, self.upload(getattr(mesh, name), wp.int32))
        for name in ("skip", "leaf", "tree_body", "leaf_box"):
            setattr(tables, name, self.upload(getattr(mesh, name), wp.int32))
        return tables

    def _make_scene(self, laws: Sequence[dict[str, float]]) -> Any:
        mesh, scene = self.mesh, contact_search(self.width, self.real).Scene()

        def rows(components: int, like: NDArray[Any]) -> wp.array:
            return wp.zeros((components, like.shape[-2], BLOCK), dtype=self.real, device=self.device)

        records = np.zeros(len(laws), dtype=contact_law(self.real).numpy_dtype())
        for record, law in zip(records, laws, strict=True):
            for key, value in law.items():
                record[key] = value
        active = records["active"] == 1
        scene.laws = wp.array(records, dtype=contact_law(self.real), device=self.device)
        scene.reaches = self.upload(np.where(active, records["cutoff"] + records["offset"], -1.0), self.real)
        scene.floors = self.upload(np.where(active, records["floor"], -1.0), self.real)
        scene.largest_floor = self.real(records["floor"].max())
        scene.points, scene.rest = self.points, self.upload(np.moveaxis(mesh.rest, -1, 0), self.real)
        scene.boxes, scene.cones = self.tree(), self.zeros(self.blocks, box_words(self.real).Cone)
        scene.triangle_boxes, scene.edge_boxes = rows(6, mesh.triangles), rows(6, mesh.edges)
        scene.sharp = rows(1, mesh.edges)
        return scene


def _indices(nodes: Sequence[int]) -> NDArray[np.int64]:
    return np.stack(np.meshgrid(*(np.arange(n) for n in nodes), indexing="ij"), axis=-1).reshape(-1, len(nodes))
