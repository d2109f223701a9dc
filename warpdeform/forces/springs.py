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
        self._moving |= any(spec.until is not None for spec in self._specs)
        self.most_steps = 8 if self._moving else self.most_steps
        self._count = len(nodes)
        self.places: wp.array = wp.array(body.layout.places(nodes), dtype=int, device=body.device)
        self._strengths = Parameters(self.strengths(0.0), body.real, body.device)
        self._points = Parameters(self.points(0.0), body.real, body.device)
        self._kernels = springs(body.real)

    @property
    def kernels(self) -> tuple[str, ...]:
        return ("springs.add_energy", "springs.add_gradient", "springs.add_blocks")

    def bytes(self) -> int:
        return int(self.places.capacity) + self._strengths.bytes() + self._points.bytes()

    @property
    def stiffness(self) -> wp.array:
        """Stiffness at each sprung node [N/m], shape (n,)."""
        return self._strengths.array

    def strengths(self, time: float) -> NDArray[np.float64]:
        """Stiffness at each sprung node in the step that ends at `time` [s]: [N/m], shape (n,)."""
        total = np.zeros(self._count)
        for spec, rows in zip(self._specs, self._rows, strict=True):
            np.add.at(total, rows, _strength(spec, time))
        return total

    def points(self, time: float) -> NDArray[np.float64]:
        """The points of the sprung nodes at `time` [s]: [m], shape (n, 3)."""
        total, strengths = np.zeros((self._count, 3)), self.strengths(time)
        for spec, rows, rest in zip(self._specs, self._rows, self._rest, strict=True):
            points = rest
            if spec.track is not None:
                position, rotation = spec.track.pose(time)
                points = position + rotate(tuple(rotation), rest)
            np.add.at(total, rows, _strength(spec, time) * points)
        return total / np.where(strengths > 0.0, strengths, 1.0)[:, None]

    def prepare(self, time: float, dt: float, tau: float) -> None:
        if self._moving:
            self._points.write(self.points(time))
            self._strengths.write(self.strengths(time))

    def add_energy(self, body: BodyArrays, position: wp.array, partials: wp.array) -> None:
        launch_alone(
            self._kernels.add_energy,
            self._count,
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
            self._count,
            self.places,
            self.stiffness,
            self._points.array,
            position,
            gradient,
            device=body.device,
        )

    def add_node_blocks(self, body: BodyArrays, blocks: wp.array) -> None:
        launch_alone(self._kernels.add_blocks, self._count, self.places, self.stiffness, blocks, device=body.device)

    def stored_energy(self, body: BodyArrays, position: wp.array) -> float:
        """Energy sum (k/2) |z - p|^2 of the springs [J], in float64 on the host: for reports, between steps."""
        rows, columns = self.places.numpy().T
        stretch = position.numpy()[:, rows, columns].T.astype(np.float64) - self._points.array.numpy()
        return 0.5 * float(np.sum(self.stiffness.numpy()[:, None] * stretch**2))


def _strength(spec: Spring, time: float) -> float:
    """Stiffness of a spring in the step that ends at `time` [N/m]."""
    return 0.0 if spec.is_over(time) else spec.stiffness
