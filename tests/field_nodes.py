"""Loose nodes under obstacles: the arrays that the term reads, and a step of implicit Euler on the host."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpdeform.forces.obstacle_field import ObstacleField
from warpdeform.grid import Layout
from warpdeform.obstacle import Obstacle

GRAVITY = (0.0, 0.0, -9.81)
MASS = 0.003
Points = NDArray[np.float64]


class LooseNodes:
    """Nodes without any connection, as a body that an obstacle field acts on."""

    def __init__(
        self,
        positions: ArrayLike,
        velocities: ArrayLike = (0.0, 0.0, 0.0),
        *,
        real: Any = wp.float64,
        lane_width: int = 1,
        gravity: Sequence[float] = GRAVITY,
    ) -> None:
        self.real, self.lane_width, self.device = real, lane_width, "cpu"
        self.position = np.array(positions, dtype=np.float64).reshape(-1, 3)
        self.velocity = np.broadcast_to(velocities, self.position.shape).astype(np.float64)
        self.gravity = np.array(gravity, dtype=np.float64)
        self.count = len(self.position)
        self.layout = Layout((self.count, 1), lane_width)
        self.x, self.w = self.upload(self.position), self.upload(self.position)
        self.mass = self.upload(np.full((self.count, 1), MASS))
        self.free = self.upload(np.ones((self.count, 1)))
        self.iteration = wp.zeros(1, dtype=int, device=self.device)
        shape = (self.layout.rows, self.layout.columns)
        self.partials: wp.array = wp.zeros(shape, dtype=wp.float64, device=self.device)
        self.time = 0.0

    def upload(self, values: NDArray[np.float64]) -> wp.array:
        values = values.reshape(self.count, 1, -1)
        return wp.array(self.layout.pack(values), dtype=self.real, device=self.device)

    def download(self, array: wp.array) -> Points:
        return self.layout.unpack(array.numpy())[:, 0].astype(np.float64)

    def field(self, *obstacles: Obstacle, walled: bool = False, skin: Points | None = None) -> ObstacleField:
        speed = float(np.max(np.linalg.norm(self.velocity, axis=1)))
        apart = None if skin is None else skin[:, None]
        return ObstacleField(self, obstacles, tuple(self.gravity), self.position[:, None], speed, apart, walled)

    def energies(self, field: ObstacleField, z: Points) -> Points:
        self.partials.zero_()
        field.add_energy(self, self.upload(z), self.partials)
        return self.layout.unpack(self.partials.numpy()[None])[:, 0, 0].astype(np.float64)

    def gradient(self, field: ObstacleField, z: Points) -> Points:
        position, gradient = self.upload(z), self.upload(np.zeros_like(z))
        field.linearise(self, position)
        field.add_gradient(self, position, gradient)
        return self.download(gradient)

    def blocks(self, field: ObstacleField) -> Points:
        """Blocks at the last linearised position, shape (n, 3, 3)."""
        packed = self.upload(np.zeros((self.count, 6)))
        field.add_node_blocks(self, packed)
        return self.download(packed)[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]

    def guarded(self, field: ObstacleField, z: Points, d: Points) -> Points:
        direction = self.upload(d)
        field.guard(self, self.upload(z), direction)
        return self.download(direction)

    def carried(self, field: ObstacleField, z: Points) -> Points:
        start = self.upload(z)
        field.carry(self, start)
        return self.download(start)

    def foreseen(self, field: ObstacleField, ways: dict[int, ArrayLike]) -> bool:
        """Whether the ways of some nodes, from where they are, end in an impact."""
        d = np.zeros_like(self.position)
        for node, way in ways.items():
            d[node] = way
        impact = wp.zeros(1, dtype=wp.int32, device=self.device)
        field.foresee(self, self.upload(self.position + d), impact)
        return bool(impact.numpy()[0])

    def prepare(self, field: ObstacleField, dt: float) -> None:
        field.prepare(self.time + dt, dt, dt)
        self.x.assign(self.upload(self.position))
        field.begin(self)

    def step(self, field: ObstacleField, dt: float, iterations: int = 10) -> None:
        """One step of implicit Euler: guarded Newton with a line search, each node on its own."""
        self.prepare(field, dt)
        x, target = self.position, self.position + dt * self.velocity + dt**2 * self.gravity
        start = self.carried(field, x)
        z = start + self.guarded(field, start, x + dt * self.velocity - start)

        def potential(z: Points) -> Points:
            return MASS / (2 * dt**2) * np.sum((z - target) ** 2, axis=1) + self.energies(field, z)

        for iteration in range(iterations):
            self.iteration.fill_(iteration)
            slope = MASS / dt**2 * (z - target) + self.gradient(field, z)
            matrix = MASS / dt**2 * np.eye(3) + self.blocks(field)
            newton = -np.linalg.solve(matrix, slope[:, :, None])[:, :, 0].astype(np.float64)
            d = self.guarded(field, z, newton)
            before, share = potential(z), np.ones(self.count)
            for _ in range(12):
                enough = before + 1e-4 * share * np.minimum(np.sum(slope * d, axis=1), 0.0) + 1e-14
                low = potential(z + share[:, None] * d) <= enough
                if low.all():
                    break
                share = np.where(low, share, 0.5 * share)
            z = z + share[:, None] * d
            if np.abs(d).max() < 1e-10:
                break
        self.velocity, self.position, self.time = (z - x) / dt, z, self.time + dt
        self.x.assign(self.upload(z))
        field.finish(self)
