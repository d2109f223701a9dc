"""The lookout of contact: tells, before nodes move, whether anything can come near anything on the way (design 5.2)."""

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
        tiles = _tiles(slots.mesh.place)
        self._tiles = slots.upload(tiles, wp.int32)
        without = np.asarray((masks[:2] > 0.0).all(axis=-1))
        self._joined = slots.upload(_joined(tiles, slots.mesh.place, without), wp.int32)
        self._boxes, self._first = (slots.zeros(2 * slots.blocks, box_words(slots.real).Box) for _ in range(2))
        self._along = (slots.tree(), slots.tree())

    def bytes(self) -> int:
        """Device memory [bytes]."""
        tables = (self._ends, self._masks, self._tiles, self._joined, self._boxes, self._first, *self._along)
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
            *flat, self._boxes, self._first,
        )  # fmt: skip
        inputs = (slots.tables, self._joined, self._boxes, self._first)
        slots.launch(kernels.close_rectangles, slots.blocks, *inputs, along_u, along_v)
        slots.fit_levels(along_u)
        slots.fit_levels(along_v)
        slots.launch(
            kernels.look_around, slots.blocks, slots.tables, slots.scene, drifts, self._tiles, along_u, along_v,
            self.near,
        )  # fmt: skip


def _edges(mesh: ContactMesh) -> tuple[Ints, NDArray[np.float64]]:
    """Slot at the end of the edge that begins at each slot, along u and v, shape (2 blocks, 16), and masks.

    See :func:`warpdeform.kernels.contact_lookout.contact_lookout`. Empty slots repeat the first one: so do their edges.
    """
    ends = np.tile(np.arange(mesh.slot_count).reshape(1, -1, BLOCK), (2, 1, 1))
    masks = np.full((4, *ends.shape[1:]), -BOUNDLESS)
    for body, surface in enumerate(mesh.surfaces):
        grid = surface.grid
        if grid.dimension != 2 or any(grid.periodic):
            continue
        mine = mesh.body == body
        nodes, slots = mesh.nodes[mine], mesh.slots[body]
        index, steps = np.divmod(nodes, grid.nodes[1]), (grid.nodes[1], 1)
        for axis in range(2):
            has_edge, across = index[axis] < grid.nodes[axis] - 1, index[1 - axis]
            is_first = has_edge & (across == across[:, :1])
            masks[axis, mine] = np.where(has_edge, 0.0, BOUNDLESS)
            masks[2 + axis, mine] = np.where(is_first, 0.0, BOUNDLESS)
            ends[axis, mine] = slots[np.where(has_edge, nodes + steps[axis], nodes)]
    return ends.reshape(-1, BLOCK), masks


def _tiles(place: Ints) -> Ints:
    """Block at each place, -1 for none, shape (patches, rows, columns)."""
    tiles = np.full(place.max(axis=0) + 1, -1)
    tiles[tuple(place.T)] = np.arange(len(place))
    return tiles


def _joined(tiles: Ints, place: Ints, without: NDArray[np.bool_]) -> Ints:
    """Whose boxes make up those of each block's rectangle: see `close_rectangles` there.

    Args:
        tiles: Block at each place.
        place: Place of each block.
        without: Blocks without edges along u, along v: they have those of the blocks before, if there are any.
    """
    own = np.arange(len(place))
    table = np.pad(tiles, ((0, 0), (1, 1), (1, 1)), constant_values=-1)

    def there(row: int, column: int) -> Ints:
        found = table[place[:, 0], place[:, 1] + 1 + row, place[:, 2] + 1 + column]
        return np.where(found >= 0, found, own)

    along_u = [np.where(without[0], there(-1, 0), own), there(0, 1)]
    along_v = [np.where(without[1], there(0, -1), own), there(1, 0)]
    return np.stack([*along_u, *(len(place) + blocks for blocks in along_v)])
