"""What is constant of one body on the device, frozen once built."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.body import Body, rotate, select_nodes
from warpdeform.grid import Layout, ParameterGrid

Array = NDArray[np.float64]

LANE_WIDTHS = {"float32": 16, "float64": 8}
"""Nodes per lane group on the CPU; on CUDA it is one."""


class Model:
    """Constants of one body.

    Attributes:
        body: What the user described.
        grid: Parameter grid.
        layout: Memory layout.
        real: ``wp.float32`` or ``wp.float64``.
        lane_width: Nodes per lane group.
        device: Warp device.
        initial_positions: Node positions at the start [m], shape (nu, nv, 3).
        node_mass: Node masses [kg], shape (nu, nv).
        spacing: Smallest rest length of an edge [m].
        lengths: Mean rest lengths of the edges along u and v [m].
        has_pins: Some nodes are pinned.
        mass: Node masses [kg] on the device, shape (1, rows, columns).
        area: Trapezoid shares of the rest area [m2], shape (1, rows, columns).
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
        self.grid = ParameterGrid(body.nodes, body.shape.spacing)
        self.layout = Layout(body.nodes, self.lane_width)
        self.initial_positions = body.placed_positions()
        rest = body.shape.positions
        node_area = self.grid.cells_to_nodes(cell_areas(rest))
        self.node_mass = body.material.surface().areal_density * node_area
        lengths = [np.linalg.norm(np.diff(rest, axis=axis), axis=-1) for axis in (0, 1)]
        self.spacing = float(min(length.min() for length in lengths))
        self.lengths = (float(lengths[0].mean()), float(lengths[1].mean()))
        self._rest_lengths = lengths
        free = np.ones(body.nodes)
        self._pinned = [(pin, select_nodes(pin.nodes, body.nodes)) for pin in body.pins]
        for _, pairs in self._pinned:
            free[pairs[:, 0], pairs[:, 1]] = 0.0
        self.has_pins = bool(self._pinned)
        self.mass = self.upload(self.node_mass)
        self.area = self.upload(node_area)
        self.free = self.upload(free)
        self._targets = np.zeros((*body.nodes, 3))
        self.pins_move = any(pin.track is not None and not pin.track.static for pin in body.pins)
        self.target = self.upload(self._pin_targets(0.0))

    def upload(self, values: Array) -> wp.array:
        """Values per node, shape (nu, nv) or (nu, nv, n), as a component array on the device."""
        return wp.array(self.layout.pack(values), dtype=self.real, device=self.device)

    def zeros(self, components: int) -> wp.array:
        """A component array of zeros."""
        return wp.zeros((components, self.layout.rows, self.layout.columns), dtype=self.real, device=self.device)

    def download(self, array: wp.array) -> Array:
        """A component array as values per node, shape (nu, nv, n), a fresh copy."""
        return self.layout.unpack(array.numpy())

    def place_targets(self, time: float) -> None:
        """Write where moving pins are at `time` [s]; does nothing for pins that stay."""
        if self.pins_move:
            self.target.assign(self.layout.pack(self._pin_targets(time)))

    def _pin_targets(self, time: float) -> Array:
        """Targets of the pinned nodes; a track moves them relative to where they start."""
        for pin, pairs in self._pinned:
            points = self.initial_positions[pairs[:, 0], pairs[:, 1]]
            if pin.track is not None:
                position, rotation = pin.track.pose(time)
                points = np.add(position, rotate(rotation.tolist(), points))
            self._targets[pairs[:, 0], pairs[:, 1]] = points
        return self._targets

    def max_stretch(self, positions: wp.array) -> float:
        """Longest edge over its rest length; positions as a component array (3, rows, columns)."""
        inside = positions.numpy()[:, 1:-1, self.layout.halo : self.layout.halo + self.grid.nodes[1]]
        worst = 0.0
        for axis, rest in zip((1, 2), self._rest_lengths, strict=True):
            edges = np.diff(inside, axis=axis)
            worst = max(worst, float(np.max(np.einsum("cij,cij->ij", edges, edges) / rest**2)))
        return float(np.sqrt(worst))


def cell_areas(rest: Array) -> Array:
    """Areas of the cells of a shape [m2] by their mean edges, shape (nu - 1, nv - 1)."""
    diagonal, other = rest[1:, 1:] - rest[:-1, :-1], rest[1:, :-1] - rest[:-1, 1:]
    return 0.5 * np.linalg.norm(np.cross(diagonal, other), axis=-1)
