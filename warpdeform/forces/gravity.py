"""Weight: the constant acceleration of gravity on every node's mass (design 1.1)."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from warpdeform.forces.force import BodyArrays, Force
from warpdeform.forces.parameters import Parameters
from warpdeform.kernels.loads import gravity
from warpdeform.launching import launch_lanes


class Gravity(Force):
    """Force m g. The potential is -m g.(z - x), relative to the start x of the step, which keeps its digits.

    Attributes:
        acceleration: g [m/s2], three numbers; may be changed between steps.
    """

    name = "gravity"
    energy_kind = "gravity"

    def __init__(self, body: BodyArrays, acceleration: Sequence[float] = (0.0, 0.0, -9.81)) -> None:
        """Make the term for a body under `acceleration` [m/s2]."""
        self.acceleration = tuple(acceleration)
        self._g = Parameters(self.acceleration, body.real, body.device)
        self.uniform = self._g.array
        self._kernels = gravity(body.lane_width, body.real)

    @property
    def kernels(self) -> tuple[str, ...]:
        return ("gravity.add_energy", "gravity.add_gradient")

    def bytes(self) -> int:
        return self._g.bytes()

    def prepare(self, time: float, dt: float, tau: float) -> None:
        self._g.write(self.acceleration)

    def add_energy(self, body: BodyArrays, position: wp.array, partials: wp.array) -> None:
        launch_lanes(
            self._kernels.add_energy,
            body.layout,
            body.mass,
            body.x,
            position,
            self._g.array,
            partials,
            device=body.device,
        )

    def add_gradient(self, body: BodyArrays, position: wp.array, gradient: wp.array) -> None:
        launch_lanes(self._kernels.add_gradient, body.layout, body.mass, self._g.array, gradient, device=body.device)

    def stored_energy(self, body: BodyArrays, position: wp.array) -> float:
        """Potential energy -sum m g.z [J], in float64 on the host: for reports, between steps."""
        moment = np.einsum("ij,cij->c", body.mass.numpy()[0], position.numpy().astype(np.float64))
        return -float(np.dot(self.acceleration, moment))
