"""Plain drag: a force against the velocity, in proportion to mass (the paper's gamma; design 1.1)."""

import warp as wp

from warpdeform.forces.force import BodyArrays, Force
from warpdeform.forces.parameters import Parameters
from warpdeform.kernels.loads import drag
from warpdeform.launching import launch_lanes


class Drag(Force):
    """Force -gamma m (z - w)/tau on every node; velocities fade as exp(-gamma t).

    Attributes:
        rate: gamma, the material's damping and the body's drag together [1/s]; may be changed between steps.
    """

    name = "drag"
    energy_kind = ""

    def __init__(self, body: BodyArrays, rate: float) -> None:
        """Make the term for a body that loses the share `rate` of its velocity per second [1/s]."""
        self.rate = rate
        self._damping = Parameters([0.0], body.real, body.device)
        self._kernels = drag(body.lane_width, body.real)

    @property
    def kernels(self) -> tuple[str, ...]:
        return ("drag.add_energy", "drag.add_gradient", "drag.add_blocks")

    def bytes(self) -> int:
        return self._damping.bytes()

    def prepare(self, time: float, dt: float, tau: float) -> None:
        self._damping.write([self.rate / tau])

    def add_energy(self, body: BodyArrays, position: wp.array, partials: wp.array) -> None:
        launch_lanes(
            self._kernels.add_energy,
            body.layout,
            body.mass,
            body.w,
            position,
            self._damping.array,
            partials,
            device=body.device,
        )

    def add_gradient(self, body: BodyArrays, position: wp.array, gradient: wp.array) -> None:
        launch_lanes(
            self._kernels.add_gradient,
            body.layout,
            body.mass,
            body.w,
            position,
            self._damping.array,
            gradient,
            device=body.device,
        )

    def add_node_blocks(self, body: BodyArrays, blocks: wp.array) -> None:
        launch_lanes(self._kernels.add_blocks, body.layout, body.mass, self._damping.array, blocks, device=body.device)
