"""The force of the air on a body: the paper's viscous force c (n . v) n (design 1.1)."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.force import LAGGED_ITERATIONS, BodyArrays, Force
from warpdeform.forces.parameters import Parameters
from warpdeform.grid import Layout
from warpdeform.halo import Halo
from warpdeform.kernels.wind import facing, wind
from warpdeform.launching import launch_lanes
from warpdeform.wind import Wind


class WindLoad(Force):
    """Force c A (n.v) n with v = u - (z - w)/tau, on the current normal n and the node's share A of the rest area.

    A solid is met at its skin, each side with its own normal, so that edges are met on both sides. A curve is met as a
    cylinder across its length: c A (v - t (t.v)), t its tangent, A length times diameter; a curve without a section has
    none and meets no wind.

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
        facing: Unit normals (of curves: tangents) of each node's faces and stream [m/s], (3 faces + 3, rows, columns).
    """

    name = "wind"
    energy_kind = ""

    def __init__(self, body: BodyArrays, air: Wind, coefficient: float, kind: str, faces: NDArray[np.float64]) -> None:
        """Make the term.

        Args:
            body: The body's arrays.
            air: Velocity of the air.
            coefficient: c [kg/(m2 s)].
            kind: "curve", "surface" or "solid".
            faces: Share of each face of the nodes in the rest area [m2], shape (*nodes, faces).
        """
        layout, real, device = body.layout, body.real, body.device
        self.wind = air
        self.coefficient = coefficient
        self._air = Parameters([coefficient, 0.0], real, device)
        self._mean = Parameters(air.mean(0.0), real, device)
        self._slopes: list[wp.array] = [
            wp.array(slopes, dtype=real, device=device) for slopes in difference_weights(layout)
        ]
        self._halo = Halo(layout, real, device)
        self._area: wp.array = wp.array(layout.pack(faces), dtype=real, device=device)
        components = 3 * faces.shape[-1] + 3
        self.facing: wp.array = wp.zeros((components, layout.rows, layout.columns), dtype=real, device=device)
        self._kernels = wind(body.lane_width, real, kind)
        self._gusting = air.gusting
        self.most_steps = 8 if self._gusting or callable(air.velocity) else self.most_steps
        self._kind = kind
        self._face = facing(body.lane_width, real, kind, self._gusting).face
        self._waves = air.waves() if self._gusting else None
        table = np.zeros((0, 6))
        if self._waves is not None:
            table = np.hstack([self._waves.wave_vectors / (2.0 * np.pi), self._waves.amplitudes])
        self._wave_table: wp.array = wp.array(table, dtype=real, device=device)
        self._turns = Parameters(self._waves.turns_at(0.0) if self._waves is not None else [], real, device)

    @property
    def kernels(self) -> tuple[str, ...]:
        facing_module = f"facing_{self._kind}_gusts" if self._gusting else f"facing_{self._kind}"
        return (
            f"{facing_module}.face",
            *(f"wind_{self._kind}.add_{what}" for what in ("energy", "gradient", "blocks")),
        )

    def bytes(self) -> int:
        arrays = [*self._slopes, self._area, self.facing, self._wave_table]
        parameters = [self._air, self._mean, self._turns]
        return sum(int(a.capacity) for a in arrays) + sum(p.bytes() for p in parameters) + self._halo.bytes()

    def prepare(self, time: float, dt: float, tau: float) -> None:
        self._air.write([self.coefficient, 1.0 / tau])
        self._mean.write(self.wind.mean(time))
        if self._waves is not None:
            self._turns.write(self._waves.turns_at(time))

    def linearise(self, body: BodyArrays, position: wp.array) -> None:
        self._halo.refresh(position)
        launch_lanes(
            self._face,
            body.layout,
            body.iteration,
            LAGGED_ITERATIONS,
            body.layout.first_row,
            body.layout.stride,
            position,
            *self._slopes,
            self._mean.array,
            self._wave_table,
            self._turns.array,
            self.facing,
            device=body.device,
            inner=True,
        )

    def add_energy(self, body: BodyArrays, position: wp.array, partials: wp.array) -> None:
        launch_lanes(
            self._kernels.add_energy,
            body.layout,
            self._area,
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
            self._area,
            self.facing,
            body.w,
            position,
            self._air.array,
            gradient,
            device=body.device,
        )

    def add_node_blocks(self, body: BodyArrays, blocks: wp.array) -> None:
        launch_lanes(
            self._kernels.add_blocks, body.layout, self._area, self.facing, self._air.array, blocks, device=body.device
        )


def difference_weights(layout: Layout) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Weights of the differences to the next and from the last node along each axis that make tangents at the nodes.

    Half and half inside, all on the one difference that exists at a border.

    Returns:
        Weights along the axes in the rows, shape (2 axes, rows, 1), and along the one in the columns, (2, 1, columns).
    """
    rows, columns = np.zeros((2 * len(layout.nodes) - 2, layout.rows, 1)), np.zeros((2, 1, layout.columns))
    for axis, (count, periodic) in enumerate(zip(layout.nodes, layout.periodic, strict=True)):
        weights = np.full((2, count), 0.5)
        if not periodic:
            weights[:, 0], weights[:, -1] = (1.0, 0.0), (0.0, 1.0)
        if axis == len(layout.nodes) - 1:
            columns[:, 0, layout.halo : layout.halo + count] = weights
        else:
            alone = np.ones(len(layout.nodes) - 1, dtype=int)
            alone[axis] = count
            rows[2 * axis : 2 * axis + 2, layout.node_rows, 0] = weights.reshape(2, *alone)
    return rows, columns
