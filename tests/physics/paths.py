"""The ways that nodes take past an obstacle within a step, seen from the obstacle, for the tests that nothing crosses.

A step moves a node several times: out of the way of a moving obstacle, to the predictor, once per Newton iteration.
Each time on a straight line, which must not touch the obstacle. The line from one accepted position to the next may:
a node that slides around an edge or over a tip has crossed nothing.
"""

import itertools
from typing import Any

import numpy as np
from obstacle_shapes import distance_to
from physics.statics import Array

from warpdeform.obstacle import Obstacle
from warpdeform.result import StepRecord
from warpdeform.simulation import Simulation
from warpdeform.track import rotation_matrix


class WatchedNodes:
    """A body under watch while it meets one convex obstacle that does not turn.

    Args:
        simulation: A simulation of one body, not captured, so that every launch can be followed.
        obstacle: The obstacle.

    Attributes:
        nearest: Smallest distance at the end of any step [m].
        touches: Straight lines that touched or crossed the obstacle.
    """

    def __init__(self, simulation: Simulation, obstacle: Obstacle) -> None:
        self.simulation, self.obstacle = simulation, obstacle
        self.handle = simulation.bodies[0]
        self.nearest, self.touches = np.inf, 0
        self._ways: list[Array] = []
        solver: Any = simulation._stepper
        step_along = solver._step_along

        def watched(vector: str) -> None:
            if vector == "z" and not self._ways:
                self._ways.append(self._iterate())
            step_along(vector)
            if vector == "z":
                self._ways.append(self._iterate())

        solver._step_along = watched

    def step(self) -> StepRecord:
        """One step, with every line of every node's way tested."""
        self._ways.clear()
        start = self._seen(self.handle.positions(), self.simulation.time)
        report = self.simulation.step()
        corners = [start] + [self._seen(way, self.simulation.time) for way in self._ways]
        for a, b in itertools.pairwise(corners):
            self.touches += int((closest(self.obstacle, a, b) <= 0.0).sum())
        self.nearest = min(self.nearest, float(self.distances().min()))
        return report

    def distances(self) -> Array:
        """Distances of the nodes from the obstacle as they are [m], shape (nu * nv,)."""
        return distances(self.obstacle, self._seen(self.handle.positions(), self.simulation.time))

    def _iterate(self) -> Array:
        return self.handle.model.download(self.handle.state.z)

    def _seen(self, points: Array, time: float) -> Array:
        """Points in the obstacle's frame, shape (nu * nv, 3)."""
        position, rotation = self.obstacle.track.pose(time)
        return (points.reshape(-1, 3).astype(np.float64) - position) @ rotation_matrix(rotation)


def distances(obstacle: Obstacle, points: Array) -> Array:
    """Distances in the obstacle's frame by the tests' own formulas [m]."""
    return distance_to(obstacle.kind, obstacle.size_vector, points)


def closest(obstacle: Obstacle, start: Array, end: Array) -> Array:
    """Smallest distance along segments from `start` to `end`, shape (n, 3); convex bodies have convex distances."""
    at_start, at_end = distances(obstacle, start), distances(obstacle, end)
    least = np.minimum(at_start, at_end)
    doubtful = at_start + at_end < np.linalg.norm(end - start, axis=1)
    a, way = start[doubtful], (end - start)[doubtful]
    low, high = np.zeros((len(a), 1)), np.ones((len(a), 1))
    for _ in range(50 if len(a) else 0):
        left, right = low + (high - low) / 3, high - (high - low) / 3
        falls = distances(obstacle, a + left * way) > distances(obstacle, a + right * way)
        low, high = np.where(falls[:, None], left, low), np.where(falls[:, None], high, right)
    if len(a):
        least[doubtful] = np.minimum(least[doubtful], distances(obstacle, a + 0.5 * (low + high) * way))
    return least
