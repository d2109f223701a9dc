"""One body of a simulation, as users see it: its arrays and what can be measured on it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.body import Body
from warpdeform.forces.drag import Drag
from warpdeform.forces.force import Force
from warpdeform.forces.gravity import Gravity
from warpdeform.forces.obstacle_field import ObstacleField
from warpdeform.forces.springs import Springs
from warpdeform.forces.surface_elasticity import SurfaceElasticity
from warpdeform.forces.wind_load import WindLoad
from warpdeform.model import Model
from warpdeform.obstacle import Obstacle
from warpdeform.result import Energy
from warpdeform.settings import Settings
from warpdeform.state import State
from warpdeform.wind import Wind

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Metric:
    """Metric tensor at its samples, in parameter units.

    Attributes:
        G11: On the u-edges, shape (nu - 1, nv).
        G12: At the cells, shape (nu - 1, nv - 1).
        G22: On the v-edges, shape (nu, nv - 1).
    """

    G11: Array
    G12: Array
    G22: Array


@dataclass(frozen=True)
class Curvature:
    """Curvature tensor at its samples [m over parameter units squared].

    Attributes:
        B11: At the nodes that have both u-neighbours, shape (nu - 2, nv).
        B12: At the cells, shape (nu - 1, nv - 1).
        B22: At the nodes that have both v-neighbours, shape (nu, nv - 2).
    """

    B11: Array
    B12: Array
    B22: Array


class BodyHandle:
    """One body of a simulation: its arrays and what can be measured on it.

    Attributes:
        body: What the user described.
        model: Its constants on the device.
        state: Its state on the device.
        terms: Its energies and loads.
    """

    def __init__(
        self,
        body: Body,
        obstacles: Sequence[Obstacle],
        wind: Wind | None,
        settings: Settings,
        device: Any,
        iteration: wp.array,
        lane_width: int | None,
    ) -> None:
        self.body = body
        self.model = Model(body, settings.precision, device, lane_width)
        self.state = State(self.model, iteration)
        model, state = self.model, self.state
        rest = body.shape.positions
        self.elasticity = SurfaceElasticity(model.grid, model.layout, rest, body.material, model.real, device)
        terms: list[Force] = [self.elasticity]
        if any(settings.gravity):
            terms.append(Gravity(state, settings.gravity))
        if body.springs:
            terms.append(Springs(state, body.springs, model.initial_positions))
        if body.drag + body.material.damping > 0:
            terms.append(Drag(state, body.drag + body.material.damping))
        if wind is not None and body.wind_coefficient > 0:
            terms.append(WindLoad(state, wind, body.wind_coefficient, model.grid.periodic))
        if obstacles:
            speed = float(np.linalg.norm(body.velocity))
            positions = model.initial_positions
            terms.append(ObstacleField(state, obstacles, settings.gravity, positions, speed))
        self.terms = tuple(terms)

    @property
    def name(self) -> str:
        """Name in files and messages."""
        return self.body.name

    @property
    def nodes(self) -> tuple[int, int]:
        """Nodes along u and v."""
        return self.body.nodes

    @property
    def rest_positions(self) -> Array:
        """Rest positions [m], shape (nu, nv, 3)."""
        return self.body.shape.positions

    @property
    def position_array(self) -> wp.array:
        """Live positions [m] on the device, components first, with halo: shape (3, rows, columns).

        Node (i, j) lies at ``[:, i + 1, j + layout.halo]``. Kernels and DLPack see the array without a copy.
        """
        return self.state.x

    def positions(self) -> Array:
        """Positions [m], shape (nu, nv, 3), a copy on the host."""
        return self.model.download(self.state.x)

    def velocities(self) -> Array:
        """Velocities [m/s], shape (nu, nv, 3), a copy on the host."""
        return self.model.download(self.state.v)

    def metric(self) -> Metric:
        """The metric tensor G at its samples, from the same operators as the energy (paper, first fundamental form)."""
        q = self.model.zeros(5)
        self.elasticity.measure(self.state.x, q, self.model.zeros(3))
        nu, nv = self.nodes
        s, t, c, u, v = np.moveaxis(self.model.layout.unpack(q.numpy(), (nu - 1, nv - 1)), -1, 0)
        h1, h2 = self.model.grid.spacing
        # Squared lengths of a cell: u-edges (s + t)/2 -+ (u + v)/2, v-edges (s - t)/2 -+ (u - v)/2.
        g11 = np.concatenate([0.5 * (s + t - u - v), 0.5 * (s + t + u + v)[:, -1:]], axis=1) / h1**2
        g22 = np.concatenate([0.5 * (s - t - u + v), 0.5 * (s - t + u - v)[-1:]], axis=0) / h2**2
        return Metric(g11, 0.5 * c / (h1 * h2), g22)

    def curvature(self) -> Curvature:
        """The curvature tensor B at its samples (paper, second fundamental form), with n along r_u x r_v.

        Raises:
            ValueError: The body is a membrane; it has no bending and so no curvature operator.
        """
        if not self.elasticity.bending:
            raise ValueError(f"body {self.name!r} is a membrane without bending; give its material a bending stiffness")
        b = self.model.zeros(3)
        self.elasticity.measure(self.state.x, self.model.zeros(5), b)
        b11, b22, b12 = np.moveaxis(self.model.download(b), -1, 0)
        h1, h2 = self.model.grid.spacing
        return Curvature(b11[1:-1] / h1**2, b12[:-1, :-1] / (h1 * h2), b22[:, 1:-1] / h2**2)

    def max_stretch(self) -> float:
        """Longest edge over its rest length."""
        return self.model.max_stretch(self.state.x)

    def add_energies(self, energy: Energy) -> None:
        """Add this body's energies [J] to `energy`."""
        velocity = self.velocities()
        energy.kinetic += float(0.5 * np.sum(self.model.node_mass[..., None] * velocity**2))
        for term in self.terms:
            if term.energy_kind:
                stored = term.stored_energy(self.state, self.state.x)
                setattr(energy, term.energy_kind, getattr(energy, term.energy_kind) + stored)
