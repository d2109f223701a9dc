"""The scenes of `bench contact` in Newton's vertex block descent, with its self-contact and without."""

from collections.abc import Callable
from typing import Any

import numpy as np

from warpdeform.shape import sheet
from warpdeform.study.accordion import folded
from warpdeform.study.peers.sheet import FPS, Array

SUBSTEPS, ITERATIONS = 10, 10
"""Substeps a frame and iterations, those of its own example of a hanging cloth."""
DENSITY, STIFFNESS, POISSON, BENDING = 0.2, 1000.0, 0.3, 1e-4
"""The cloth of the accordion."""
RADIUS = 0.25
"""Contact radius over the node spacing: the gap that our scene takes; the margin is half as much more."""


class VBDSession:
    """A square sheet of 1 m in Newton's solver, stepped by the frame.

    Args:
        nodes: Nodes along each side.
        positions: Where they start [m], shape (nodes, nodes, 3).
        pinned: Numbers of the nodes that are held.
        ground: Whether there is a ground in z = 0.
        self_contact: Whether the sheet feels itself.
    """

    def __init__(self, nodes: int, positions: Array, pinned: list[int], ground: bool, self_contact: bool) -> None:
        import newton
        import warp as wp

        shape, h = sheet((nodes, nodes), (1.0, 1.0)), 1.0 / (nodes - 1)
        k = np.arange(nodes * nodes).reshape(nodes, nodes)
        corners = (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:])
        faces = np.stack([*(corners[i] for i in (0, 1, 2)), *(corners[i] for i in (0, 2, 3))], axis=-1)
        builder = newton.ModelBuilder()
        first_lame = STIFFNESS * POISSON / (1.0 - POISSON**2)
        builder.add_cloth_mesh(
            pos=wp.vec3(0.0, 0.0, 0.0),
            rot=wp.quat_identity(),
            scale=1.0,
            vel=wp.vec3(0.0, 0.0, 0.0),
            vertices=[wp.vec3(*map(float, x)) for x in shape.positions.reshape(-1, 3)],
            indices=faces.reshape(-1).tolist(),
            density=DENSITY,
            tri_ke=STIFFNESS / (2.0 * (1.0 + POISSON)),
            tri_ka=first_lame,
            tri_kd=0.0,
            edge_ke=BENDING / h,
            edge_kd=0.0,
        )
        for node in pinned:
            builder.particle_mass[node] = 0.0
            builder.particle_flags[node] &= ~int(newton.ParticleFlags.ACTIVE)
        if ground:
            builder.add_ground_plane()
        builder.color(include_bending=True)
        model = builder.finalize(device="cpu")
        model.soft_contact_ke, model.soft_contact_kd, model.soft_contact_mu = 1e3, 1e-2, 0.4
        self._solver = newton.solvers.SolverVBD(
            model,
            iterations=ITERATIONS,
            particle_enable_self_contact=self_contact,
            particle_self_contact_radius=RADIUS * h,
            particle_self_contact_margin=1.5 * RADIUS * h,
        )
        self._model, self._states, self._control = model, [model.state(), model.state()], model.control()
        self._contacts = model.contacts() if ground else None
        self._nodes = nodes
        for state in self._states:
            state.particle_q.assign(positions.reshape(-1, 3).astype(np.float32))

    def advance_frame(self) -> None:
        """Take the substeps of a frame."""
        for _ in range(SUBSTEPS):
            before, after = self._states
            before.clear_forces()
            if self._contacts is not None:
                self._model.collide(before, self._contacts)
            self._solver.step(before, after, self._control, self._contacts, 1.0 / (FPS * SUBSTEPS))
            self._states = [after, before]

    def positions(self) -> Array:
        """Node positions [m]."""
        return self._states[0].particle_q.numpy().astype(np.float64).reshape(self._nodes, self._nodes, 3)


def newton_accordion(nodes: int, layers: int) -> Callable[[bool], Any]:
    """What makes the folded sheet above the ground, with self-contact or without."""
    positions = folded(nodes, layers)[1] + [0.0, 0.0, 0.003]
    return lambda self_contact: VBDSession(nodes, positions, [], True, self_contact)


def newton_apart(nodes: int) -> Callable[[bool], Any]:
    """What makes the sheet that hangs by two corners."""
    positions = sheet((nodes, nodes), (1.0, 1.0)).positions
    return lambda self_contact: VBDSession(nodes, positions, [0, nodes - 1], False, self_contact)
