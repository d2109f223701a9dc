"""The lookout of contact: tells, before nodes move, whether anything can come near anything on the way (design 5.2)."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.contact_mesh import BLOCK, ContactMesh
from warpdeform.forces.contact_slots import ContactSlots
from warpdeform.kernels.boxes import box_words
from warpdeform.kernels.contact_lookout import BOUNDLESS, contact_lookout
from warpdeform.launching import do_alone

Ints = NDArray[np.int64]


class Lookout:
    """Finds out whether search and guard have anything to do; see :mod:`warpdeform.kernels.contact_lookout`.

    Edges are looked at on surfaces with open axes. Closed ones, strands and solids are near themselves wherever they
    feel themselves.

    Args:
        slots: The bodies in slots.

    Attributes:
        near: int32 view, 1 if something may come near on the way that was asked about last, or none was.
    """

    def __init__(self, slots: ContactSlots) -> None:
        self._slots, self._kernels = slots, contact_lookout(slots.width, slots.real)
        self.near = slots.zeros(1, wp.int32)
        ends, masks = _edges(slots.mesh)
        self._ends, self._masks = slots.upload(ends, wp.int32), slots.upload(masks, slots.real)
        around = _around(slots.mesh.place)
        self._around, self._joined = slots.upload(around, wp.int32), slots.upload(_joined(around), wp.int32)
        self._edge_boxes = slots.zeros(2 * slots.blocks, box_words(slots.real).Box)
        self._along = (slots.tree(), slots.tree())

    def bytes(self) -> int:
        """Device memory [bytes]."""
        tables = (self._ends, self._masks, self._around, self._joined, self._edge_boxes, *self._along)
        return sum(int(array.capacity) for array in tables)

    def begin(self) -> None:
        """What is known of a way holds no longer."""
        do_alone(lambda: self.near.fill_(1))

    def look(self, directions: wp.array, drifts: wp.array) -> None:
        """Look along the way from the slots' points, with the scene's boxes around them.

        Args:
            directions: Displacements in slots [m].
            drifts: Boxes of the tree around them.
        """
        slots, kernels, (along_u, along_v) = self._slots, self._kernels, self._along
        flat = (slots.flattened(slots.points), slots.flattened(directions))
        do_alone(self.near.zero_)
        slots.launch(
            kernels.box_edges, (slots.blocks, 2), slots.blocks, self._ends, self._masks, slots.points, directions,
            *flat, self._edge_boxes,
        )  # fmt: skip
        inputs = (slots.blocks, slots.tables, self._joined, self._edge_boxes)
        slots.launch(kernels.close_rectangles, slots.blocks, *inputs, along_u, along_v)
        slots.fit_levels(along_u)
        slots.fit_levels(along_v)
        slots.launch(
            kernels.look_around, slots.blocks, slots.tables, slots.scene, drifts, self._around, along_u, along_v,
            self.near,
        )  # fmt: skip


def _edges(mesh: ContactMesh) -> tuple[Ints, NDArray[np.float64]]:
    """Slot at the end of the edge that begins at each slot, along u and v, shape (2 blocks, 16), and their masks."""
    ends = np.tile(np.arange(mesh.slot_count).reshape(1, -1, BLOCK), (2, 1, 1))
    masks = np.full(ends.shape, -BOUNDLESS)
    for body, surface in enumerate(mesh.surfaces):
        grid = surface.grid
        if grid.dimension != 2 or any(grid.periodic):
            continue
        mine = mesh.body == body
        nodes, slots = mesh.nodes[mine], mesh.slots[body]
        index, steps = np.divmod(nodes, grid.nodes[1]), (grid.nodes[1], 1)
        for axis in range(2):
            # Empty slots repeat the first: so do their edges.
            has_edge = index[axis] < grid.nodes[axis] - 1
            masks[axis, mine] = np.where(has_edge, 0.0, BOUNDLESS)
            ends[axis, mine] = slots[np.where(has_edge, nodes + steps[axis], nodes)]
    return ends.reshape(-1, BLOCK), masks


def _around(place: Ints) -> Ints:
    """Blocks around each, by rows, -1 for none, shape (9, blocks)."""
    size = place.max(axis=0) + 1
    table = np.full(size + [0, 2, 2], -1)
    patch, row, column = place.T
    table[patch, row + 1, column + 1] = np.arange(len(place))
    return np.stack([table[patch, row + i, column + j] for i in range(3) for j in range(3)])


def _joined(around: Ints) -> Ints:
    """Blocks in which a rectangle's last edges are, below and beside it, or where there are none those before it."""

    def one_of(*choices: Any) -> Ints:
        found = around[4]
        for k in choices:
            found = np.where(around[k] >= 0, around[k], found)
        return found

    return np.stack([one_of(1, 7), one_of(3, 5)])
