"""Springs of zero rest length from nodes to points in the world: the paper's k (p - r) (design 1.1)."""

from collections.abc import Sequence

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.body import Spring, rotate
from warpdeform.forces.force import BodyArrays, Force
from warpdeform.forces.parameters import Parameters
from warpdeform.kernels.loads import springs
from warpdeform.launching import launch_alone
from warpdeform.selectors import select_nodes


class Springs(Force):
    """Force k (p - z) on the sprung nodes. The potential is relative to the start x of the step.

    Several springs at one node are one spring: their stiffnesses add up, and its point is their weighted mean (the
    potential changes by a constant). So each sprung node has one thread, and only sprung nodes take memory.

    Attributes:
        places: Row and column of each sprung node in component arrays, int32, shape (n, 2).
        stiffness: Stiffness at each sprung node [N/m], shape (n,).
    """

    name = "springs"
    energy_kind = "field"

    def __init__(
        self,
        body: BodyArrays,
        specs: Sequence[Spring],
        initial_positions: NDArray[np.float64],
        kind: str = "surface",
    ) -> None:
        """Make the term.

        Args:
            body: The body's arrays.
            specs: The springs.
            initial_positions: Where the body starts [m], shape (*nodes, 3): the points of springs that name none.
            kind: "curve", "surface" or "solid": how the nodes are selected.
        """
        selected = [select_nodes(spec.nodes, body.layout.nodes, kind) for spec in specs]
        nodes, owners = np.unique(np.concatenate(selected), axis=0, return_inverse=True)
        self._specs = tuple(specs)
        self._rows = np.split(owners.reshape(-1), np.cumsum([len(pairs) for pairs in selected])[:-1])
        self._rest = [
            np.broadcast_to(initial_positions[tuple(pairs.T)] if spec.point is None else spec.point, (len(pairs), 3))
            for spec, pairs in zip(self._specs, selected, strict=True)
        ]
        self._moving = any(spec.track is not None and not spec.track.static for spec in self._specs)
        self.most_steps = 8 if self._moving else self.most_steps
        self._stiffness = np.zeros(len(nodes))
        for spec, rows in zip(self._specs, self._rows, strict=True):
            np.add.at(self._stiffness, rows, spec.stiffness)
        self.places: wp.array = wp.array(body.layout.places(nodes), dtype=int, device=body.device)
        self.stiffness: wp.array = wp.array(self._stiffness, dtype=body.real, device=body.device)
        self._points = Parameters(self.points(0.0), body.real, body.device)
        self._kernels = springs(body.real)

    @property
    def kernels(self) -> tuple[str, ...]:
        return ("springs.add_energy", "springs.add_gradient", "springs.add_blocks")

    def bytes(self) -> int:
        return int(self.places.capacity) + int(self.stiffness.capacity) + self._points.bytes()

    def points(self, time: float) -> NDArray[np.float64]:
        """The points of the sprung nodes at `time` [s]: [m], shape (n, 3)."""
        total = np.zeros((len(self._stiffness), 3))
        for spec, rows, rest in zip(self._specs, self._rows, self._rest, strict=True):
            points = rest
            if spec.track is not None:
                position, rotation = spec.track.pose(time)
                points = position + rotate(tuple(rotation), rest)
            np.add.at(total, rows, spec.stiffness * points)
        return total / self._stiffness[:, None]

    def prepare(self, time: float, dt: float, tau: float) -> None:
        if self._moving:
            self._points.write(self.points(time))

    def add_energy(self, body: BodyArrays, position: wp.array, partials: wp.array) -> None:
        launch_alone(
            self._kernels.add_energy,
            len(self._stiffness),
            self.places,
            self.stiffness,
            self._points.array,
            body.x,
            position,
            partials,
            device=body.device,
        )

    def add_gradient(self, body: BodyArrays, position: wp.array, gradient: wp.array) -> None:
        launch_alone(
            self._kernels.add_gradient,
            len(self._stiffness),
            self.places,
            self.stiffness,
            self._points.array,
            position,
            gradient,
            device=body.device,
        )

    def add_node_blocks(self, body: BodyArrays, blocks: wp.array) -> None:
        launch_alone(
            self._kernels.add_blocks, len(self._stiffness), self.places, self.stiffness, blocks, device=body.device
        )

    def stored_energy(self, body: BodyArrays, position: wp.array) -> float:
        """Energy sum (k/2) |z - p|^2 of the springs [J], in float64 on the host: for reports, between steps."""
        rows, columns = self.places.numpy().T
        stretch = position.numpy()[:, rows, columns].T.astype(np.float64) - self._points.array.numpy()
        return 0.5 * float(np.sum(self._stiffness[:, None] * stretch**2))
