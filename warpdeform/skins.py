"""What bodies that feel each other show, on the host: for counting what crosses, and for messages."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from warpdeform.body import Body
from warpdeform.crossings import crossing_pairs
from warpdeform.errors import InputError, Mistake
from warpdeform.simplices import Simplices

Array = NDArray[np.float64]
NAMED = 5
"""Places that a message names at most."""


class Skins:
    """Edges and triangles of bodies, their nodes one after the other.

    Args:
        bodies: The bodies.
        pairs: Which of them feel each other, by their numbers; a number twice for itself.

    Attributes:
        bodies: The bodies.
        simplices: Their edges and triangles.
        owner: Body of each node.
        feels: Whether one body feels another, shape (bodies, bodies).
    """

    def __init__(self, bodies: Sequence[Body], pairs: Sequence[tuple[int, int]]) -> None:
        self.bodies = tuple(bodies)
        self.simplices = Simplices.joined([Simplices.of_grid(body.shape.grid) for body in bodies])
        counts = [body.shape.grid.node_count for body in bodies]
        self.owner = np.repeat(np.arange(len(bodies)), counts)
        self._number = np.concatenate([np.arange(n) for n in counts])
        self.feels = np.zeros((len(bodies), len(bodies)), bool)
        for a, b in pairs:
            self.feels[a, b] = self.feels[b, a] = True

    def joined(self, positions: Sequence[NDArray[np.floating]]) -> Array:
        """Positions of all nodes, shape (nodes, 3), from those of each body."""
        return np.concatenate([each.reshape(-1, 3).astype(np.float64) for each in positions])

    def crossing(self, points: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Edges and the triangles that they go through, by their nodes, of bodies that feel each other."""
        pairs = crossing_pairs(points, self.simplices)
        edges, triangles = self.simplices.edges[pairs[:, 0]], self.simplices.triangles[pairs[:, 1]]
        felt = self.feels[self.owner[edges[:, 0]], self.owner[triangles[:, 0]]]
        return edges[felt], triangles[felt]

    def refuse_crossing(self, points: Array) -> None:
        """Refuse a start that crosses.

        Raises:
            InputError: Which bodies do, and where.
        """
        edges, triangles = self.crossing(points)
        if not len(edges):
            return
        some = zip(edges[:NAMED], triangles[:NAMED], strict=True)
        where = [f"{self.place(e)} through {self.place(t)}" for e, t in some]
        names = {self.bodies[self.owner[v]].name for v in (*edges[:, 0], *triangles[:, 0])}
        problem = f"{' and '.join(sorted(names))} cross at the start in {len(edges)} places: {'; '.join(where)}"
        remedy = "Move them apart, or let them not feel each other; relax = true does not help what crosses."
        raise InputError(Mistake("contact", None, problem, remedy))

    def place(self, vertices: Sequence[int]) -> str:
        """Body and nodes, for messages."""
        body = self.bodies[self.owner[vertices[0]]]
        nodes = [[int(k) for k in np.unravel_index(self._number[v], body.nodes)] for v in dict.fromkeys(vertices)]
        return f"{body.name} {' '.join(str(node) for node in nodes)}"
