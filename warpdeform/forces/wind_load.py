"""The force of the air on a sheet: the paper's viscous force c (n . v) n (design 1.1)."""

import numpy as np
import warp as wp

from warpdeform.forces.force import LAGGED_ITERATIONS, BodyArrays, Force
from warpdeform.forces.parameters import Parameters
from warpdeform.forces.surface_coefficients import difference_weights
from warpdeform.halo import Halo
from warpdeform.kernels.loads import FACING_COMPONENTS, gusts, wind
from warpdeform.launching import launch_lanes
from warpdeform.wind import Wind


class WindLoad(Force):
    """Force c A (n.v) n with v = u - (z - w)/tau, on the current normal n and the node's share A of the rest area.

    n, and u where the wind gusts, follow the iterate in the first three Newton iterations of a stage and are then
    frozen (taken at iterates and not where the step began, they keep the order of the integrator). With both frozen
    the force is the exact gradient of (c A tau/2) (n.v)^2, here relative to a node at rest, z = w.

    The pressure of air on a sheet is (rho/2) Cd |n.v| n.v, with rho = 1.2 kg/m3 and Cd = 1.2 broadside on: the linear
    law meets it where c = 0.7 kg/m3 times |n.v|. c = 2 kg/(m2 s) belongs to the 3 m/s at which a flag slips through a
    wind of 5 to 8 m/s: a cotton flag of 1.5 m then stands out and, where time steps resolve it (1/480 s), beats two to
    three times a second. Larger c makes it stiffer and faster (8: 6 to 10 Hz), smaller lets it hang (0.5).

    Attributes:
        wind: Velocity of the air.
        coefficient: c [kg/(m2 s)]; may be changed between steps.
        facing: Unit normal and stream along it [m/s], shape (4, rows, columns).
    """

    name = "wind"
    energy_kind = ""

    def __init__(self, body: BodyArrays, air: Wind, coefficient: float) -> None:
        """Make the term.

        Args:
            body: The body's arrays.
            air: Velocity of the air.
            coefficient: c [kg/(m2 s)].
        """
        layout, real, device = body.layout, body.real, body.device
        self.wind = air
        self.coefficient = coefficient
        self._air = Parameters([coefficient, 0.0], real, device)
        self._mean = Parameters(air.mean(0.0), real, device)
        slopes_u, slopes_v = difference_weights(layout)
        self._slopes_u: wp.array = wp.array(slopes_u, dtype=real, device=device)
        self._slopes_v: wp.array = wp.array(slopes_v, dtype=real, device=device)
        self._halo = Halo(layout, real, device)
        self.facing: wp.array = wp.zeros((FACING_COMPONENTS, layout.rows, layout.columns), dtype=real, device=device)
        self._kernels = wind(body.lane_width, real)
        self._gusting = air.gusting
        self.most_steps = 8 if self._gusting or callable(air.velocity) else self.most_steps
        if self._gusting:
            self._waves = air.waves()
            table = np.hstack([self._waves.wave_vectors / (2.0 * np.pi), self._waves.amplitudes])
            self._wave_table: wp.array = wp.array(table, dtype=real, device=device)
            self._turns = Parameters(self._waves.turns_at(0.0), real, device)
            self._gust_kernels = gusts(body.lane_width, real)

    @property
    def kernels(self) -> tuple[str, ...]:
        facing = "gusts.face_gusts" if self._gusting else "wind.face_stream"
        return (facing, "wind.add_energy", "wind.add_gradient", "wind.add_blocks")

    def bytes(self) -> int:
        arrays = [self._slopes_u, self._slopes_v, self.facing]
        parameters = [self._air, self._mean]
        if self._gusting:
            arrays.append(self._wave_table)
            parameters.append(self._turns)
        return sum(int(a.capacity) for a in arrays) + sum(p.bytes() for p in parameters) + self._halo.bytes()

    def prepare(self, time: float, dt: float, tau: float) -> None:
        self._air.write([self.coefficient, 1.0 / tau])
        self._mean.write(self.wind.mean(time))
        if self._gusting:
            self._turns.write(self._waves.turns_at(time))

    def linearise(self, body: BodyArrays, position: wp.array) -> None:
        face, stream = self._kernels.face_stream, [self._mean.array]
        if self._gusting:
            face, stream = self._gust_kernels.face_gusts, [self._mean.array, self._wave_table, self._turns.array]
        self._halo.refresh(position)
        launch_lanes(
            face,
            body.layout,
            body.iteration,
            LAGGED_ITERATIONS,
            position,
            self._slopes_u,
            self._slopes_v,
            *stream,
            self.facing,
            device=body.device,
        )

    def add_energy(self, body: BodyArrays, position: wp.array, partials: wp.array) -> None:
        launch_lanes(
            self._kernels.add_energy,
            body.layout,
            body.area,
            self.facing,
            body.w,
            position,
            self._air.array,
            partials,
            device=body.device,
        )

    def add_gradient(self, body: BodyArrays, position: wp.array, gradient: wp.array) -> None:
        launch_lanes(
            self._kernels.add_gradient,
            body.layout,
            body.area,
            self.facing,
            body.w,
            position,
            self._air.array,
            gradient,
            device=body.device,
        )

    def add_node_blocks(self, body: BodyArrays, blocks: wp.array) -> None:
        launch_lanes(
            self._kernels.add_blocks, body.layout, body.area, self.facing, self._air.array, blocks, device=body.device
        )
