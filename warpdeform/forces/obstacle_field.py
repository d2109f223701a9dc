"""All obstacles as one body feels them: field, friction, guard and carry (design 5.1)."""

import weakref
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.force import LAGGED_ITERATIONS, BodyArrays, Force
from warpdeform.kernels.distance import KINDS, MEMORY, distances
from warpdeform.kernels.fields import LAGGED, STICK, fields
from warpdeform.kernels.guard import guards
from warpdeform.launching import do_alone, launch_nodes
from warpdeform.obstacle import Obstacle
from warpdeform.track import multiply, rotation_matrix, to_rotation_vector

_meshes: "weakref.WeakKeyDictionary[Obstacle, dict[str, wp.Mesh]]" = weakref.WeakKeyDictionary()


INNER = 0.15
"""Distance towards which the wall grows without bound, as a share of the gap: the guard lets nothing come nearer."""
WALL = 0.35
"""Thickness of the wall outside of it, as a share of the gap: what rests at the gap does not feel it."""


class ObstacleField(Force):
    """The obstacles of a scene acting on one body, all of them in each launch.

    The field is the force; the guard forbids crossing. It lets no node that is outside come nearer than 0.15 gaps, and
    a node that is inside a solid move by half of eps against it at a time; the slack of half the inradius of design 5.1
    let nodes through by 0.7 gaps where Newton was capped. Thin obstacles (a plate thinner than two gaps, the cone with
    its tip, meshes) give no way at all.

    Distances are those of the skin: of a node less the half thickness of its body there. Inner nodes of solids feel no
    field, but the guard holds for them too. Inside half the gap there may be a wall, see
    :mod:`warpdeform.kernels.potential`.

    `linearise` keeps gradient and blocks; `finish` expects the accepted position in `body.x`. In `prepare`, dt is the
    time from the start of the step to the end of the stage.

    Attributes:
        constants: Design speed, eps and cutoff of each obstacle.
    """

    name = "obstacles"

    def __init__(
        self,
        body: BodyArrays,
        obstacles: Sequence[Obstacle],
        gravity: Sequence[float],
        positions: NDArray[np.float64],
        speed: float = 0.0,
        skin: NDArray[np.float64] | None = None,
        walled: bool = False,
    ) -> None:
        """Make the term.

        Args:
            body: The body's arrays.
            obstacles: At least one.
            gravity: Acceleration of gravity [m/s2].
            positions: Initial node positions [m], shape (nu, nv, 3), for the design speeds that are left out.
            speed: Fastest initial node speed [m/s], likewise.
            skin: Distance of the skin from each node [m], shape (*nodes), negative where there is none; None: 0.
            walled: Whether there is a wall from the start (`raise_walls`).
        """
        real, device, layout = body.real, body.device, body.layout
        self.obstacles = tuple(obstacles)
        self.constants = tuple(
            each.field_constants(gravity, each.expected_speed(positions, speed, gravity)) for each in self.obstacles
        )
        self._has_mesh = any(each.kind == "mesh" for each in self.obstacles)
        self._has_friction = any(each.friction > 0.0 for each in self.obstacles)
        self._moving = not all(each.track.static for each in self.obstacles)
        self.most_steps = 1 if self._moving else self.most_steps
        self.most_rate = max(
            constants.design_speed**2 / (2.0 * constants.range) * max(1.0 / constants.range, each.friction / STICK)
            for each, constants in zip(self.obstacles, self.constants, strict=True)
        )
        self._geometry = distances(real, self._has_mesh)
        self._kernels = fields(real, self._has_mesh, self._has_friction)
        self._guards = guards(real, self._has_mesh)
        self._held = [_mesh(each, device) for each in self.obstacles if each.kind == "mesh"]
        frictional = sum(each.friction > 0.0 for each in self.obstacles)
        plane = (layout.rows, layout.columns)

        def zeros(components: int) -> wp.array:
            return wp.zeros((components, *plane), dtype=real, device=device)

        self._walled = walled
        self._skin = zeros(1)
        if skin is not None:
            self._skin.assign(layout.pack(np.asarray(skin)[..., None]))
        self._records: wp.array = wp.array(self._describe(), dtype=self._geometry.Obstacle, device=device)
        self._pose_values = self._pose_records(0.0, 0.0)
        self._poses: wp.array = wp.array(self._pose_values, dtype=self._geometry.Pose, device=device)
        self._gradient, self._block = zeros(3), zeros(6)
        self._start = zeros(3 if frictional else 0)
        self._lagged = zeros(LAGGED * frictional)
        self._memory = zeros(MEMORY * len(self._held))

    @property
    def kernels(self) -> tuple[str, ...]:
        names = ["linearise_fields", "add_field_gradient", "add_field_blocks", "add_field_energy"]
        names += ["begin_friction", "finish_friction"] if self._has_friction else []
        guards = ["guard_direction", "carry_nodes"] if self._moving else ["guard_direction"]
        return (*(f"fields.{name}" for name in names), *(f"guard.{name}" for name in guards))

    def bytes(self) -> int:
        arrays = (
            self._records,
            self._poses,
            self._gradient,
            self._block,
            self._start,
            self._lagged,
            self._memory,
            self._skin,
        )
        meshes = (array for mesh in self._held for array in (mesh.points, mesh.indices))
        return sum(int(array.capacity) for array in (*arrays, *meshes))

    def reset(self) -> None:
        """Forget the friction anchors, as at the start of a run."""
        self._lagged.zero_()
        self._memory.zero_()

    def leave_bare(self, places: NDArray[np.int64]) -> None:
        """Take no thickness of nodes at these rows and columns, shape (n, 2) (host, before a run)."""
        skin = self._skin.numpy()
        skin[0, places[:, 0], places[:, 1]] = np.minimum(skin[0, places[:, 0], places[:, 1]], 0.0)
        self._skin.assign(skin)

    def raise_walls(self) -> None:
        """Give all obstacles a wall, for nodes that are pressed by more than their own weight (host, before a run)."""
        self._walled = True
        self._records.assign(self._describe())

    def prepare(self, time: float, dt: float, tau: float) -> None:
        if self._moving:
            values = self._pose_records(time - dt, time)
            if values.tobytes() != self._pose_values.tobytes():
                self._pose_values = values
                self._poses.assign(values)

    def begin(self, body: BodyArrays) -> None:
        if self._has_friction:
            inputs = [body.layout.halo, body.mass, self._skin, body.x, self._records, self._poses, self._memory]
            self._launch(body, self._kernels.begin_friction, inputs, [self._start, self._lagged])

    def linearise(self, body: BodyArrays, position: wp.array) -> None:
        inputs = [body.layout.halo, LAGGED_ITERATIONS, body.mass, self._skin, position, body.x, body.iteration]
        outputs = [self._lagged, self._memory, self._gradient, self._block]
        self._launch(body, self._kernels.linearise_fields, [*inputs, self._records, self._poses], outputs)

    def add_energy(self, body: BodyArrays, position: wp.array, partials: wp.array) -> None:
        inputs = [body.layout.halo, body.mass, self._skin, position, body.x]
        inputs += [self._records, self._poses, self._lagged, self._memory]
        self._launch(body, self._kernels.add_field_energy, inputs, [partials])

    def add_gradient(self, body: BodyArrays, position: wp.array, gradient: wp.array) -> None:
        self._launch(body, self._kernels.add_field_gradient, [body.layout.halo, self._gradient], [gradient])

    def add_node_blocks(self, body: BodyArrays, blocks: wp.array) -> None:
        self._launch(body, self._kernels.add_field_blocks, [body.layout.halo, self._block], [blocks])

    def carry(self, body: BodyArrays, start: wp.array) -> None:
        if self._moving:
            inputs = [body.layout.halo, body.free, self._skin, body.x, self._records, self._poses]
            self._launch(body, self._guards.carry_nodes, inputs, [start])

    def guard(self, body: BodyArrays, position: wp.array, direction: wp.array) -> None:
        inputs = [body.layout.halo, body.free, self._skin, position, self._records, self._poses, self._memory]
        self._launch(body, self._guards.guard_direction, inputs, [direction])

    def foresee(self, body: BodyArrays, predicted: wp.array, impact: wp.array) -> None:
        inputs = [body.layout.halo, body.free, self._skin, body.x, predicted, self._records, self._poses, self._memory]
        self._launch(body, self._guards.foresee_impacts, inputs, [impact])

    def finish(self, body: BodyArrays) -> None:
        if self._has_friction:
            inputs = [body.layout.halo, body.mass, self._skin, body.x, self._start, self._records, self._poses]
            self._launch(body, self._kernels.finish_friction, inputs, [self._lagged])

    def keep(self, body: BodyArrays) -> None:
        if self._has_friction:
            do_alone(lambda: self._kept.assign(self._lagged))

    def restore(self, body: BodyArrays) -> None:
        if self._has_friction:
            do_alone(lambda: self._lagged.assign(self._kept))

    @cached_property
    def _kept(self) -> wp.array:
        return wp.zeros_like(self._lagged)

    def _launch(self, body: BodyArrays, kernel: Any, inputs: list[Any], outputs: list[Any]) -> None:
        launch_nodes(kernel, body.layout, *inputs, *outputs, device=body.device)

    def _describe(self) -> NDArray[np.void]:
        """What of the obstacles does not change."""
        records = np.zeros(len(self.obstacles), dtype=self._geometry.Obstacle.numpy_dtype())
        frictional, meshes = 0, iter(self._held)
        memory = 0
        for record, each, constants in zip(records, self.obstacles, self.constants, strict=True):
            record["kind"], record["size"] = KINDS.index(each.kind), each.size_vector
            record["half_thickness"] = 0.5 * each.thickness
            record["bound"] = each.bounding_radius
            record["strength"], record["eps"] = 0.5 * constants.design_speed**2, constants.range
            record["cutoff"], record["gap"] = constants.cutoff, each.gap
            if self._walled:
                record["inner"], record["wall"] = INNER * each.gap, WALL * each.gap
            record["floor"] = 0.5 * constants.range if each.inradius >= each.gap else 0.0
            record["friction"], record["lagged"], record["memory"] = each.friction, -1, -1
            if each.friction > 0.0:
                record["lagged"] = LAGGED * frictional
                frictional += 1
            if each.kind == "mesh":
                record["mesh"], record["memory"] = next(meshes).id, memory
                memory += MEMORY
        return records

    def _pose_records(self, start: float, end: float) -> NDArray[np.void]:
        """Poses at `end` [s] and their motion since `start`, differences taken in float64."""
        records = np.zeros(len(self.obstacles), dtype=self._geometry.Pose.numpy_dtype())
        for record, each in zip(records, self.obstacles, strict=True):
            position, rotation = each.track.pose(end)
            position_before, rotation_before = each.track.pose(start)
            inverse_before = rotation_before * np.array([-1.0, -1.0, -1.0, 1.0])
            record["position"], record["rotation"] = position, rotation_matrix(rotation)
            record["shift"] = position - position_before
            if not np.array_equal(rotation, rotation_before):
                record["turn"] = rotation_matrix(rotation).T - rotation_matrix(rotation_before).T
                record["spin"] = to_rotation_vector(multiply(rotation, inverse_before))
        return records


def _mesh(obstacle: Obstacle, device: Any) -> wp.Mesh:
    """The mesh of an obstacle on a device, one for all bodies."""
    on_devices = _meshes.setdefault(obstacle, {})
    key = str(device)
    if key not in on_devices:
        assert obstacle.vertices is not None
        assert obstacle.faces is not None
        points: wp.array = wp.array(obstacle.vertices, dtype=wp.vec3, device=device)
        indices: wp.array = wp.array(obstacle.faces.reshape(-1), dtype=wp.int32, device=device)
        on_devices[key] = wp.Mesh(points, indices, support_winding_number=obstacle.thickness == 0.0)
    return on_devices[key]
