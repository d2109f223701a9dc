"""What of all bodies can touch, laid out for the search: nodes in blocks, blocks in a tree, simplices by block.

A block holds up to 16 neighbouring nodes of one body: 4 x 4 of a sheet or of a side of a solid, a run of a strand. Its
nodes lie in 16 *slots*, one after the other, so that a block is one lane group in single precision; slots without a
node repeat the first one. Slot s of all bodies together is component [c, s // 16, s % 16] of an array. The tree is in
preorder: box k is followed by its first child, and `skip[k]` is where the search goes on when k is of no interest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpdeform.grid import ParameterGrid
from warpdeform.simplices import Simplices
from warpdeform.topology import block_sides

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

BLOCK = 16
"""Slots of a block."""
TILE = 4
"""Nodes of a block along each axis of a grid."""


@dataclass(frozen=True, eq=False)
class Surface:
    """What a body shows.

    Attributes:
        grid: Its parameter grid.
        rest: Rest positions [m], shape (nodes, 3).
        spacing: Smallest distance of neighbours at rest [m].
    """

    grid: ParameterGrid
    rest: Array
    spacing: float


class ContactMesh:
    """The tables of all bodies; see the module.

    Attributes:
        surfaces: What it is of.
        blocks: Number of blocks.
        nodes: Node of its body in each slot, shape (blocks, 16); empty slots repeat the first.
        present: Nodes in each block.
        body: Body of each block.
        place: Patch of tiles of each block, and its row and column there, shape (blocks, 3).
        slots: Slot of each node of each body; -1 for nodes that do not show.
        triangles: Slots of the corners, in rows of 16, shape (3, rows, 16), by block; rows are filled up with their
            first. Triangle t is at [t // 16, t % 16] of the rows.
        triangle_count: Triangles in each row.
        triangle_row_start: First row of each block, one more at the end.
        across: Triangle beyond the edge opposite each corner, -1 at borders, shape (3, rows, 16).
        edges: Slots of both ends, shape (2, rows, 16), in rows as triangles are.
        edge_count, edge_row_start: As those of triangles.
        wings: Corners opposite each edge in its triangles, -1 for none, shape (2, rows, 16).
        ring_start: First neighbour of each slot, one more at the end.
        ring: Slots that an edge joins to each slot.
        owner: First triangle at each slot; -1 without triangles.
        border_start: First of `border` of each block, one more at the end.
        border: Slots of other blocks that simplices of a block reach.
        skip, leaf, tree_body: Of each box of the tree: where to go on, its block or -1, its body or -1 for several.
        leaf_box: Box of each block.
        levels: Inner boxes by their depth, the deepest first.
    """

    def __init__(self, surfaces: Sequence[Surface]) -> None:
        self.surfaces = tuple(surfaces)
        self._tiles: list[Ints] = []
        self._places: list[tuple[int, int, int]] = []
        self.body: Ints
        tree = _Tree()
        owners: list[int] = []
        starts = np.cumsum([0, *(s.grid.node_count for s in surfaces)])
        patch = 0
        with tree.node():
            for body, surface in enumerate(surfaces):
                with tree.node(body):
                    for tiles in _tilings(surface.grid):
                        self._add_tiles(tree, tiles, (patch, 0, 0), body, owners)
                        patch += 1
        self.skip, self.leaf, self.tree_body, self.levels = tree.finish()
        self.leaf_box = np.flatnonzero(self.leaf >= 0)
        self.blocks, self.body = len(self._tiles), np.array(owners)
        self.place = np.array(self._places)
        self.present = np.array([len(tile) for tile in self._tiles])
        self.nodes = np.array([np.concatenate([t, np.repeat(t[:1], BLOCK - len(t))]) for t in self._tiles])
        self.slots = []
        of_node = np.full(starts[-1], -1)
        for block, tile in enumerate(self._tiles):
            of_node[starts[owners[block]] + tile] = BLOCK * block + np.arange(len(tile))
        self.slots = [of_node[a:b] for a, b in pairwise(starts)]
        self.rest = np.zeros((self.blocks, BLOCK, 3))
        for body, surface in enumerate(surfaces):
            self.rest[self.body == body] = surface.rest.reshape(-1, 3)[self.nodes[self.body == body]]
        parts = [Simplices.of_grid(surface.grid) for surface in surfaces]
        joined = Simplices.joined(parts)
        # Strands have triangles of no width, so that what is true of points and triangles is true of them.
        segments = np.concatenate(
            [part.edges + start for part, start in zip(parts, starts[:-1], strict=True) if not len(part.triangles)]
            or [np.zeros((0, 2), np.int64)]
        )
        corners = np.concatenate([joined.triangles, segments[:, [0, 1, 1]]])
        self._take_triangles(of_node[corners])
        self._take_edges(np.sort(of_node[joined.edges], axis=1))
        self._take_border()

    @property
    def slot_count(self) -> int:
        """Number of slots."""
        return BLOCK * self.blocks

    def _add_tiles(
        self, tree: _Tree, tiles: NDArray[np.object_], place: tuple[int, int, int], body: int, owners: list[int]
    ) -> None:
        """Add the blocks of a rectangle of tiles, and the boxes around its halves, and around theirs."""
        if tiles.size == 1:
            nodes: Any = tiles.flat[0]
            if len(nodes):
                tree.leaf(len(self._tiles), body)
                self._tiles.append(nodes)
                self._places.append(place)
                owners.append(body)
            return
        patch, row, column = place
        middle, centre = (-(-size // 2) for size in tiles.shape)
        with tree.node(body):
            for i, across in ((0, slice(middle)), (middle, slice(middle, None))):
                for j, along in ((0, slice(centre)), (centre, slice(centre, None))):
                    part = tiles[across, along]
                    if part.size:
                        self._add_tiles(tree, part, (patch, row + i, column + j), body, owners)

    def _take_triangles(self, corners: Ints) -> None:
        corners = corners[np.argsort(corners[:, 0] // BLOCK, kind="stable")]
        rows, self.triangle_row_start, self.triangle_count = _rows(
            np.bincount(corners[:, 0] // BLOCK, minlength=self.blocks)
        )
        self.triangles = np.moveaxis(corners[rows], -1, 0)
        number = np.zeros(len(corners), np.int64)
        number[rows.reshape(-1)[::-1]] = np.arange(rows.size)[::-1]
        # The edge opposite each corner, and which triangles have it.
        ends = np.sort(np.stack([corners[:, [1, 2]], corners[:, [2, 0]], corners[:, [0, 1]]], axis=1), axis=2)
        keys = (ends[..., 0] * self.slot_count + ends[..., 1]).reshape(-1)
        real = np.repeat(corners[:, 1] != corners[:, 2], 3)
        order = np.argsort(keys, kind="stable")
        across = np.full(3 * len(corners), -1)
        same = (keys[order[:-1]] == keys[order[1:]]) & real[order[:-1]] & real[order[1:]]
        first, second = order[:-1][same], order[1:][same]
        across[first], across[second] = number[second // 3], number[first // 3]
        self.across = np.moveaxis(across.reshape(-1, 3)[rows], -1, 0)
        self._keys, self._opposite = keys[real], corners.reshape(-1)[real]
        self.owner = np.full(self.slot_count, -1)
        self.owner[corners[::-1].reshape(-1)] = np.repeat(number[::-1], 3)

    def _take_edges(self, edges: Ints) -> None:
        edges = edges[np.argsort(edges[:, 0] // BLOCK, kind="stable")]
        block = edges[:, 0] // BLOCK
        rows, self.edge_row_start, self.edge_count = _rows(np.bincount(block, minlength=self.blocks))
        self.edges = np.moveaxis(edges[rows], -1, 0)
        keys = edges[:, 0] * self.slot_count + edges[:, 1]
        order = np.argsort(self._keys, kind="stable")
        low, high = (np.searchsorted(self._keys[order], keys, side=side) for side in ("left", "right"))
        wings = np.full((2, len(edges)), -1)
        for k in range(2):
            has = low + k < high
            wings[k, has] = self._opposite[order[low[has] + k]]
        self.wings = wings[:, rows]
        both = np.concatenate([edges, edges[:, ::-1]])
        both = both[np.argsort(both[:, 0], kind="stable")]
        self.ring, self.ring_start = both[:, 1], np.searchsorted(both[:, 0], np.arange(self.slot_count + 1))

    def _take_border(self) -> None:
        found = np.concatenate(
            [
                np.stack([np.tile(self.triangles[0].reshape(-1) // BLOCK, 3), self.triangles.reshape(-1)], axis=1),
                np.stack([self.edges[0].reshape(-1) // BLOCK, self.edges[1].reshape(-1)], axis=1),
            ]
        )
        found = np.unique(found[found[:, 0] != found[:, 1] // BLOCK], axis=0)
        self.border, self.border_start = found[:, 1], np.searchsorted(found[:, 0], np.arange(self.blocks + 1))


def _rows(counts: Ints) -> tuple[Ints, Ints, Ints]:
    """Rows of 16 that hold so many things of each block, which are sorted by block.

    Returns:
        Number of the thing in each place, rows filled up with their first, shape (rows, 16); first row of each block,
        one more at the end; things in each row.
    """
    per_block = -(-counts // BLOCK)
    row_start = np.concatenate([[0], np.cumsum(per_block)])
    block = np.repeat(np.arange(len(counts)), per_block)
    within = (np.arange(row_start[-1]) - row_start[block]) * BLOCK
    first = (np.cumsum(counts) - counts)[block] + within
    filled = np.minimum(counts[block] - within, BLOCK)
    places = np.arange(BLOCK)
    return first[:, None] + np.where(places < filled[:, None], places, 0), row_start, filled


def _tilings(grid: ParameterGrid) -> list[NDArray[np.object_]]:
    """Rectangles of tiles, each tile the numbers of its nodes: one of curves and surfaces, one per side of solids."""
    if grid.dimension == 1:
        return [_tiles(np.arange(grid.node_count).reshape(grid.nodes), (BLOCK, 1))]
    if grid.dimension == 2:
        return [_tiles(np.arange(grid.node_count).reshape(grid.nodes), (TILE, TILE))]
    tilings, taken = [], np.zeros(grid.node_count, bool)
    for side in block_sides(grid.nodes, grid.periodic):
        tiles = _tiles(side.nodes, (TILE, TILE))
        for index, tile in np.ndenumerate(tiles):
            tiles[index] = tile[~taken[tile]]
            taken[tile] = True
        tilings.append(tiles)
    return tilings


def _tiles(numbers: Ints, size: tuple[int, int]) -> NDArray[np.object_]:
    rows, columns = (-(-n // s) for n, s in zip(numbers.shape, size, strict=True))
    tiles = np.empty((rows, columns), dtype=object)
    for i in range(rows):
        for j in range(columns):
            tile = numbers[i * size[0] : (i + 1) * size[0], j * size[1] : (j + 1) * size[1]]
            tiles[i, j] = tile.reshape(-1)
    return tiles


class _Tree:
    """Writes a tree in preorder."""

    def __init__(self) -> None:
        self._skip: list[int] = []
        self._leaf: list[int] = []
        self._body: list[int] = []
        self._depths: list[int] = []
        self._depth = 0

    def node(self, body: int = -1) -> _Open:
        """Add an inner box; what is added while it is open is inside."""
        return _Open(self, self._add(-1, body))

    def leaf(self, block: int, body: int) -> None:
        """Add the box of a block."""
        self._skip[self._add(block, body)] += 1

    def _add(self, leaf: int, body: int) -> int:
        self._skip.append(len(self._skip))
        self._leaf.append(leaf)
        self._body.append(body)
        self._depths.append(self._depth)
        return len(self._skip) - 1

    def finish(self) -> tuple[Ints, Ints, Ints, list[Ints]]:
        """Skips, leaves, bodies, and the inner boxes by depth."""
        depths, leaf = np.array(self._depths), np.array(self._leaf)
        inner = [np.flatnonzero((depths == d) & (leaf < 0)) for d in range(depths.max(), -1, -1)]
        return np.array(self._skip), leaf, np.array(self._body), [level for level in inner if len(level)]


class _Open:
    """An inner box that is being filled."""

    def __init__(self, tree: _Tree, box: int) -> None:
        self._tree, self._box = tree, box

    def __enter__(self) -> None:
        self._tree._depth += 1

    def __exit__(self, *_: object) -> None:
        self._tree._depth -= 1
        self._tree._skip[self._box] = len(self._tree._skip)
