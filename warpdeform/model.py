"""What is constant of one body on the device, frozen once built."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.body import Body, rotate
from warpdeform.grid import Layout
from warpdeform.measure import edge_lengths, node_measures
from warpdeform.selectors import select_nodes

Array = NDArray[np.float64]

LANE_WIDTHS = {"float32": 16, "float64": 8}
"""Nodes per lane group on the CPU; on CUDA it is one."""


class Model:
    """Constants of one body; arrays per node have the shape of its grid: (n, strands), (nu, nv) or (nu, nv, nw).

    Attributes:
        body: What the user described.
        grid: Parameter grid.
        layout: Memory layout.
        real: ``wp.float32`` or ``wp.float64``.
        lane_width: Nodes per lane group.
        device: Warp device.
        initial_positions: Node positions at the start [m], shape (*nodes, 3).
        node_mass: Node masses [kg], shape (*nodes).
        spacing: Smallest rest length of an edge [m].
        lengths: Mean rest lengths of the edges along each axis [m]; infinite where nothing connects nodes.
        has_pins: Some nodes are pinned.
        mass: Node masses [kg] on the device, shape (1, rows, columns).
        free: 1 at free nodes, 0 at pinned ones and outside, shape (1, rows, columns).
        target: Where pinned nodes are held [m], shape (3, rows, columns); zero elsewhere.
    """

    def __init__(self, body: Body, precision: str, device: Any, lane_width: int | None = None) -> None:
        """Upload the constants.

        Args:
            body: The body.
            precision: "float32" or "float64".
            device: Warp device.
            lane_width: Nodes per lane group; None takes what suits the device.
        """
        self.body = body
        self.device = device
        self.real: Any = wp.float32 if precision == "float32" else wp.float64
        self.lane_width = lane_width or (1 if device.is_cuda else LANE_WIDTHS[precision])
        grid = self.grid = body.shape.grid
        self.layout = Layout(body.nodes, self.lane_width, grid.periodic, grid.poles)
        self.initial_positions = body.placed_positions()
        rest = body.shape.positions
        self.node_mass = node_measures(grid, rest, body.density)
        self._rest_lengths = edge_lengths(grid, rest)
        self.spacing = float(min(length.min() for length in self._rest_lengths))
        lengths = [float(length.mean()) for length in self._rest_lengths]
        self.lengths = (*lengths, *[math.inf] * (len(grid.nodes) - grid.dimension))
        self._pinned = [(pin, tuple(select_nodes(pin.nodes, body.nodes, body.kind).T)) for pin in body.pins]
        self.has_pins = bool(self._pinned)
        self._let_go = 0
        self.mass = self.upload(self.node_mass)
        self.free = self.upload(self._free_nodes(0.0))
        self._targets = np.zeros((*body.nodes, 3))
        self.pins_move = any(pin.track is not None and not pin.track.static for pin in body.pins)
        self.target = self.upload(self._pin_targets(0.0))

    def upload(self, values: Array) -> wp.array:
        """Values per node, shape (*nodes) or (*nodes, n), as a component array on the device."""
        return wp.array(self.layout.pack(values), dtype=self.real, device=self.device)

    def zeros(self, components: int) -> wp.array:
        """A component array of zeros."""
        return wp.zeros((components, self.layout.rows, self.layout.columns), dtype=self.real, device=self.device)

    def download(self, array: wp.array) -> Array:
        """A component array as values per node, shape (*nodes, n), a fresh copy."""
        return self.layout.unpack(array.numpy())

    def place_targets(self, time: float) -> bool:
        """Write where moving pins are in the step that ends at `time` [s], and which nodes are held in it.

        Returns:
            Whether other nodes are held than in the step before.
        """
        self.move_targets(time)
        let_go = sum(pin.is_over(time) for pin, _ in self._pinned)
        changed = let_go != self._let_go
        if changed:
            self._let_go = let_go
            self.free.assign(self.layout.pack(self._free_nodes(time)))
        return changed

    def move_targets(self, time: float) -> None:
        """Write where moving pins are at `time` [s], in the middle of a step too; does nothing for pins that stay."""
        if self.pins_move:
            self.target.assign(self.layout.pack(self._pin_targets(time)))

    def _free_nodes(self, time: float) -> Array:
        free = np.ones(self.body.nodes)
        for pin, held in self._pinned:
            if not pin.is_over(time):
                free[held] = 0.0
        return free

    def _pin_targets(self, time: float) -> Array:
        """Targets of the pinned nodes; a track moves them relative to where they start."""
        for pin, held in self._pinned:
            points = self.initial_positions[held]
            if pin.track is not None:
                position, rotation = pin.track.pose(time)
                points = np.add(position, rotate(rotation.tolist(), points))
            self._targets[held] = points
        return self._targets

    def pin_lag(self, positions: wp.array) -> tuple[float, tuple[int, ...]]:
        """How far behind its target the last pinned node is [m], and which; positions as a component array."""
        away = np.linalg.norm(self.download(positions) - self._targets, axis=-1)
        away[self.download(self.free)[..., 0] > 0.0] = 0.0
        node = np.unravel_index(int(np.argmax(away)), away.shape)
        return float(away[node]), tuple(int(k) for k in node)

    def max_stretch(self, positions: wp.array, scales: Sequence[Array] | None = None) -> float:
        """Longest edge over its rest length.

        Args:
            positions: Component array (3, rows, columns) [m].
            scales: Factors by which the edges along each axis have grown at rest; None if they have not.
        """
        lengths, rest_lengths = edge_lengths(self.grid, self.download(positions)), self._rest_lengths
        if scales is not None:
            rest_lengths = [length * scale for length, scale in zip(rest_lengths, scales, strict=True)]
        return float(max(np.max(now / rest) for now, rest in zip(lengths, rest_lengths, strict=True)))
