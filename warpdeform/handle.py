"""One body of a simulation, as users see it: its arrays and what can be measured on it."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.body import Body
from warpdeform.clamps import Clamps
from warpdeform.forces.curve_elasticity import CurveElasticity
from warpdeform.forces.drag import Drag
from warpdeform.forces.force import Force
from warpdeform.forces.gravity import Gravity
from warpdeform.forces.obstacle_field import ObstacleField
from warpdeform.forces.pressure import Pressure
from warpdeform.forces.solid_coefficients import refuse_inverted
from warpdeform.forces.solid_elasticity import SolidElasticity
from warpdeform.forces.springs import Springs
from warpdeform.forces.surface_elasticity import SurfaceElasticity
from warpdeform.forces.wind_load import WindLoad
from warpdeform.measure import exposed_shares
from warpdeform.model import Model
from warpdeform.obstacle import Obstacle
from warpdeform.result import Energy
from warpdeform.settings import Settings
from warpdeform.state import State
from warpdeform.tensors import Curvature, CurveCurvature, Metric, curvature_of_curve, metric_of
from warpdeform.wind import Wind

Array = NDArray[np.float64]


def _surface(model: Model) -> SurfaceElasticity:
    body, device = model.body, model.device
    rest, growth = body.shape.positions, body.growth
    return SurfaceElasticity(model.grid, model.layout, rest, body.material, model.real, device, growth=growth)


def _curve(model: Model) -> CurveElasticity:
    body, clamps = model.body, Clamps(model.body)
    return CurveElasticity(
        model.grid,
        model.layout,
        body.shape.positions,
        body.material,
        model.real,
        model.device,
        section=body.section,
        natural=None if body.natural is None else body.natural.positions,
        director=body.director,
        framed=clamps.twist,
        start=(model.initial_positions, body.rotation),
        clamps=clamps,
        growth=body.growth,
    )


def _solid(model: Model) -> SolidElasticity:
    body, rest = model.body, model.body.shape.positions
    if body.material.inversion_barrier:
        refuse_inverted(model.grid, rest, model.initial_positions)
    device, growth = model.device, body.growth
    return SolidElasticity(model.grid, model.layout, rest, body.material, model.real, device, growth=growth)


def _skin(body: Body, model: Model) -> Array:
    """How far the skin is from each node [m]; negative at inner nodes of solids, which have none."""
    skin = 0.5 * body.skin_thicknesses()
    if body.kind == "solid":
        skin[~exposed_shares(model.grid, body.shape.positions).any(axis=-1)] = -1.0
    return skin


ELASTICITY: dict[str, Callable[[Model], Force]] = {
    "curve": _curve,
    "surface": _surface,
    "solid": _solid,
}
"""The elastic energy of each kind of body."""


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
        self.elasticity = ELASTICITY[body.kind](model)
        terms: list[Force] = [self.elasticity]
        if any(settings.gravity):
            terms.append(Gravity(state, settings.gravity))
        if body.springs:
            terms.append(Springs(state, body.springs, model.initial_positions, body.kind))
        if body.drag + body.material.damping > 0:
            terms.append(Drag(state, body.drag + body.material.damping))
        if wind is not None and body.wind_coefficient > 0:
            faces = exposed_shares(model.grid, body.shape.positions, body.diameter)
            if faces.any():
                terms.append(WindLoad(state, wind, body.wind_coefficient, body.kind, faces))
        if body.pressure:
            terms.append(Pressure(state, body.pressure, body.shape.positions))
        if obstacles:
            speed = float(np.linalg.norm(body.velocity))
            positions = model.initial_positions
            skin = _skin(body, model)
            terms.append(ObstacleField(state, obstacles, settings.gravity, positions, speed, skin))
        self.terms = tuple(terms)

    @property
    def name(self) -> str:
        """Name in files and messages."""
        return self.body.name

    @property
    def nodes(self) -> tuple[int, ...]:
        """Nodes along the axes: (n, strands) of a curve, (nu, nv) of a surface, (nu, nv, nw) of a solid."""
        return self.body.nodes

    @property
    def mass(self) -> float:
        """Mass of the whole body [kg]."""
        return float(self.model.node_mass.sum())

    def leave_bare(self, nodes: NDArray[np.int64]) -> None:
        """Let obstacles hold some nodes, shape (n, axes), as if they had no thickness: they are inside another body."""
        for term in self.terms:
            if isinstance(term, ObstacleField):
                term.leave_bare(self.model.layout.places(nodes))

    def raise_walls(self) -> None:
        """Let obstacles have a wall for this body: it carries more than itself, and their field is made for itself."""
        for term in self.terms:
            if isinstance(term, ObstacleField):
                term.raise_walls()

    @property
    def rest_positions(self) -> Array:
        """Rest positions [m], shape (*nodes, 3)."""
        return self.body.shape.positions

    @property
    def position_array(self) -> wp.array:
        """Live positions [m] on the device, components first, with halo: shape (3, rows, columns).

        Node (i, j) of a curve or surface lies at ``[:, i + 1, j + layout.halo]``, nodes of any body where
        ``model.layout.places`` says. Kernels and DLPack see the array without a copy.
        """
        return self.state.x

    def positions(self) -> Array:
        """Positions [m], shape (*nodes, 3), a copy on the host."""
        return self.model.download(self.state.x)

    def velocities(self) -> Array:
        """Velocities [m/s], shape (*nodes, 3), a copy on the host."""
        return self.model.download(self.state.v)

    def metric(self) -> Metric:
        """The metric tensor G at its samples, by the differences that the energy measures (paper: first form)."""
        return metric_of(self.model.grid, self.positions())

    def curvature(self) -> Curvature | CurveCurvature:
        """The curvature of a surface or curve at its samples.

        Returns:
            Of a surface the curvature tensor B with n along r_u x r_v (paper, second fundamental form), from the
            kernels that measure it for the energy; of a curve the curvature binormals.

        Raises:
            ValueError: The body is a solid, or a membrane: it has no bending and so no curvature operator.
        """
        grid = self.model.grid
        if self.body.kind == "curve":
            return curvature_of_curve(grid, self.positions())
        elasticity = self.elasticity
        if not isinstance(elasticity, SurfaceElasticity):
            raise ValueError(f"body {self.name!r} is a {self.body.kind}; curves and surfaces have a curvature")
        if not elasticity.bending:
            raise ValueError(f"body {self.name!r} is a membrane without bending; give its material a bending stiffness")
        b = self.model.zeros(3)
        elasticity.measure(self.state.x, self.model.zeros(5), b)
        b11, b22, b12 = np.moveaxis(self.model.download(b), -1, 0)
        h1, h2 = grid.spacing
        start, end = (None if pole else cut for pole, cut in zip(grid.poles, (1, -1), strict=True))
        inside_u, inside_v = (slice(None) if wraps else slice(start, end) for wraps in grid.periodic)
        cells = tuple(slice(count) for count in grid.cells)
        return Curvature(b11[inside_u] / h1**2, b12[cells] / (h1 * h2), b22[:, inside_v] / h2**2)

    def max_stretch(self) -> float:
        """Longest edge over its rest length, which may have grown."""
        growth = getattr(self.elasticity, "growth", None)
        return self.model.max_stretch(self.state.x, None if growth is None else growth.edge_scales())

    def add_energies(self, energy: Energy) -> None:
        """Add this body's energies [J] to `energy`."""
        velocity = self.velocities()
        energy.kinetic += float(0.5 * np.sum(self.model.node_mass[..., None] * velocity**2))
        for term in self.terms:
            if term.energy_kind:
                stored = term.stored_energy(self.state, self.state.x)
                setattr(energy, term.energy_kind, getattr(energy, term.energy_kind) + stored)
