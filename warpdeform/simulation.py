"""A simulation: bodies, obstacles and wind under one solver, stepped through time."""

import time as clock
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.body import Body
from warpdeform.errors import InputError, Mistake, SimulationFailure
from warpdeform.forces.drag import Drag
from warpdeform.forces.force import Force
from warpdeform.forces.gravity import Gravity
from warpdeform.forces.obstacle_field import ObstacleField
from warpdeform.forces.springs import Springs
from warpdeform.forces.surface_elasticity import SurfaceElasticity
from warpdeform.forces.wind_load import WindLoad
from warpdeform.integrators import INTEGRATORS
from warpdeform.integrators.newton import NewtonSolver
from warpdeform.linear import PRECONDITIONERS
from warpdeform.model import Model
from warpdeform.obstacle import Obstacle
from warpdeform.result import Energy, Outcome, RunRecord, StepRecord
from warpdeform.settings import Settings
from warpdeform.state import State
from warpdeform.wind import Wind

Array = NDArray[np.float64]


class Simulation:
    """Bodies, obstacles and wind, stepped through time on one device.

    The first step runs uncaptured while kernels load; from then on a step is the replay of one graph, on CPU and CUDA.

    Args:
        bodies: At least one body, with names of their own.
        obstacles: Obstacles that every body meets.
        wind: Moving air; None is still air that does not resist either.
        settings: Solver settings.
        lane_width: Nodes per lane group, for tests; None takes what suits the device.
        captured: Replay steps as graphs; False launches every kernel by itself, for tests.

    Raises:
        InputError: Settings or bodies that do not fit together.
    """

    def __init__(
        self,
        bodies: Sequence[Body],
        *,
        obstacles: Sequence[Obstacle] = (),
        wind: Wind | None = None,
        settings: Settings | None = None,
        lane_width: int | None = None,
        captured: bool = True,
    ) -> None:
        started = clock.perf_counter()
        self.settings = settings or Settings()
        _check(bodies, self.settings)
        self.device = find_device(self.settings.device)
        self.obstacles, self.wind = tuple(obstacles), wind
        self.integrator = INTEGRATORS[self.settings.integrator]()
        self._captured = captured
        self._iteration: wp.array = wp.zeros(1, dtype=wp.int32, device=self.device)
        self.bodies = tuple(BodyHandle(self, body, lane_width) for body in bodies)
        states = [handle.state for handle in self.bodies]
        self._solver = NewtonSolver(states, [handle.terms for handle in self.bodies], self.settings, self._iteration)
        self._graph: Any = None
        self._record = RunRecord(
            nodes=sum(handle.model.grid.node_count for handle in self.bodies),
            device=str(self.device),
            precision=self.settings.precision,
            integrator=self.integrator.name,
        )
        self._steps = 0
        self._dt_before: float | None = None
        self._compile()
        self._record.setup_s = clock.perf_counter() - started

    @property
    def gravity(self) -> tuple[float, float, float]:
        """Acceleration of gravity [m/s2]."""
        return self.settings.gravity

    @property
    def dt(self) -> float:
        """Time step [s]."""
        return self.settings.dt

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._steps * self.dt

    @property
    def frame(self) -> int:
        """Whole frames advanced since the start."""
        return self._steps // self.settings.substeps

    def __getitem__(self, name: str) -> "BodyHandle":
        """The body of that name."""
        for handle in self.bodies:
            if handle.name == name:
                return handle
        raise KeyError(f"no body named {name!r}; there are {', '.join(h.name for h in self.bodies)}")

    def step(self) -> StepRecord:
        """Advance by one time step.

        Raises:
            SimulationFailure: The step is not finite; the message names body, time, node and likely cause.
        """
        started = clock.perf_counter()
        end = (self._steps + 1) * self.dt
        self._solver.prepare(self.integrator.stage(self.dt, self._dt_before), end, self.dt)
        if self._graph is not None:
            wp.capture_launch(self._graph)
        else:
            self._solver.record()
        report = self._solver.report()
        self._record.add_step(report)
        self._record.wall_s += clock.perf_counter() - started
        if report.outcome is Outcome.NOT_FINITE or not np.isfinite(report.residual):
            raise self._failure(end)
        self._steps += 1
        self._dt_before = self.dt
        return report

    def advance_frame(self) -> None:
        """Advance by one frame: `settings.substeps` steps."""
        for _ in range(self.settings.substeps):
            self.step()
        for handle in self.bodies:
            self._record.max_stretch = max(self._record.max_stretch, handle.max_stretch())

    def reset(self) -> None:
        """Back to the initial state, bit for bit."""
        for handle in self.bodies:
            handle.state.reset()
            handle.model.place_targets(0.0)
            for term in handle.terms:
                term.reset()
        fresh = RunRecord(
            nodes=self._record.nodes,
            device=self._record.device,
            precision=self._record.precision,
            integrator=self._record.integrator,
            setup_s=self._record.setup_s,
        )
        self._record, self._steps, self._dt_before = fresh, 0, None

    def record(self) -> RunRecord:
        """Statistics up to now, with the energies of the present state."""
        energy = Energy(work_in=self._record.energy.work_in)
        for handle in self.bodies:
            handle.add_energies(energy)
        return replace(self._record, frames=self.frame + 1, sim_s=self.time, energy=energy)

    def info(self) -> "SimulationInfo":
        """Terms, kernels and bytes of every body."""
        bodies = []
        for handle in self.bodies:
            terms = [TermInfo(term.name, term.kernels, term.bytes()) for term in handle.terms]
            bodies.append(BodyInfo(handle.name, handle.nodes, tuple(terms), handle.state.bytes()))
        solver = self._solver.operator.bytes() + self._solver.preconditioner.bytes()
        return SimulationInfo(tuple(bodies), self._solver.preconditioner.name, solver)

    def _compile(self) -> None:
        """Load every kernel of a step by running one, capture it, and put everything back."""
        self._solver.prepare(self.integrator.stage(self.dt, None), self.dt, self.dt)
        self._solver.record()
        if self._captured:
            with wp.ScopedCapture(device=self.device) as capture:
                self._solver.record()
            self._graph = capture.graph
        for handle in self.bodies:
            handle.state.reset()
            for term in handle.terms:
                term.reset()

    def _failure(self, time: float) -> SimulationFailure:
        for handle in self.bodies:
            bad = np.argwhere(~np.isfinite(handle.positions()).all(axis=-1))
            if len(bad):
                return SimulationFailure(
                    body=handle.name,
                    time=time,
                    node=tuple(int(k) for k in bad[0]),
                    cause="the linear solve or a force overflowed, most likely from forces too large for the time step",
                    remedy="Use more substeps, precision float64, or softer materials and slower obstacles.",
                )
        return SimulationFailure(
            body=self.bodies[0].name,
            time=time,
            node=(0, 0),
            cause="the potential of the step overflowed although every position is finite",
            remedy="Use precision float64, or check masses, stiffnesses and wind for absurd values.",
        )


class BodyHandle:
    """One body of a simulation: its arrays and what can be measured on it.

    Attributes:
        body: What the user described.
        model: Its constants on the device.
        state: Its state on the device.
        terms: Its energies and loads.
    """

    def __init__(self, simulation: Simulation, body: Body, lane_width: int | None) -> None:
        settings = simulation.settings
        self.body = body
        self.model = Model(body, settings.precision, simulation.device, lane_width)
        self.state = State(self.model, simulation._iteration)
        model, state = self.model, self.state
        rest = body.shape.positions
        self.elasticity = SurfaceElasticity(
            model.grid, model.layout, rest, body.material, model.real, simulation.device
        )
        terms: list[Force] = [self.elasticity]
        if any(settings.gravity):
            terms.append(Gravity(state, settings.gravity))
        if body.springs:
            terms.append(Springs(state, body.springs, model.initial_positions))
        if body.drag + body.material.damping > 0:
            terms.append(Drag(state, body.drag + body.material.damping))
        if simulation.wind is not None and body.wind_coefficient > 0:
            terms.append(WindLoad(state, simulation.wind, body.wind_coefficient, model.grid.periodic))
        if simulation.obstacles:
            speed = float(np.linalg.norm(body.velocity))
            positions = model.initial_positions
            terms.append(ObstacleField(state, simulation.obstacles, settings.gravity, positions, speed))
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

    def metric(self) -> "Metric":
        """The metric tensor G at its samples, from the same operators as the energy (paper, first fundamental form)."""
        q = self.model.zeros(5)
        self.elasticity.measure(self.state.x, q, self.model.zeros(3))
        nu, nv = self.nodes
        s, t, c, u, v = np.moveaxis(self.model.layout.unpack(q.numpy(), (nu - 1, nv - 1)), -1, 0)
        h1, h2 = self.model.grid.spacing
        # Squared lengths of the two u-edges of a cell are (s + t)/2 -+ (u + v)/2, of the v-edges (s - t)/2 -+ (u - v)/2.
        g11 = np.concatenate([0.5 * (s + t - u - v), 0.5 * (s + t + u + v)[:, -1:]], axis=1) / h1**2
        g22 = np.concatenate([0.5 * (s - t - u + v), 0.5 * (s - t + u - v)[-1:]], axis=0) / h2**2
        return Metric(g11, 0.5 * c / (h1 * h2), g22)

    def curvature(self) -> "Curvature":
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
        return self.model.max_stretch(self.positions())

    def add_energies(self, energy: Energy) -> None:
        """Add this body's energies [J] to `energy`."""
        velocity = self.velocities()
        energy.kinetic += float(0.5 * np.sum(self.model.node_mass[..., None] * velocity**2))
        for term in self.terms:
            if term.energy_kind == "gravity":
                heights = self.positions() @ np.asarray(self.state_gravity)
                energy.gravity -= float(np.sum(self.model.node_mass * heights))
            elif term.energy_kind:
                self.state.partials.zero_()
                term.add_energy(self.state, self.state.x, self.state.partials)
                total = float(self.state.partials.numpy().sum())
                setattr(energy, term.energy_kind, getattr(energy, term.energy_kind) + total)

    @property
    def state_gravity(self) -> tuple[float, ...]:
        """Acceleration of gravity that this body feels [m/s2]."""
        return next((tuple(t.acceleration) for t in self.terms if isinstance(t, Gravity)), (0.0, 0.0, 0.0))


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


@dataclass(frozen=True)
class TermInfo:
    """A term: its name, kernels and memory [bytes]."""

    name: str
    kernels: tuple[str, ...]
    bytes: int


@dataclass(frozen=True)
class BodyInfo:
    """A body: its name, nodes, terms, and the memory of its state and step vectors [bytes]."""

    name: str
    nodes: tuple[int, int]
    terms: tuple[TermInfo, ...]
    bytes: int


@dataclass(frozen=True)
class SimulationInfo:
    """What a simulation launches and allocates.

    Attributes:
        bodies: One entry per body.
        preconditioner: Name of the preconditioner.
        solver_bytes: Memory of operator and preconditioner [bytes].
    """

    bodies: tuple[BodyInfo, ...]
    preconditioner: str
    solver_bytes: int

    @property
    def bytes_total(self) -> int:
        """Device memory in all [bytes]."""
        return self.solver_bytes + sum(b.bytes + sum(t.bytes for t in b.terms) for b in self.bodies)

    def lines(self) -> list[str]:
        """The table as people read it."""
        nodes = sum(body.nodes[0] * body.nodes[1] for body in self.bodies)
        lines = []
        for body in self.bodies:
            count = body.nodes[0] * body.nodes[1]
            lines.append(
                f"{body.name}: surface {body.nodes[0]} x {body.nodes[1]}, state {body.bytes / count:.0f} B/node"
            )
            for term in body.terms:
                lines.append(f"  {term.name}: {term.bytes / count:.0f} B/node; kernels {', '.join(term.kernels)}")
        lines.append(f"solver: conjugate gradient, {self.preconditioner}, {self.solver_bytes / nodes:.0f} B/node")
        lines.append(f"total: {self.bytes_total} bytes, {self.bytes_total / nodes:.0f} B/node")
        return lines


def find_device(name: str) -> Any:
    """The Warp device of that name; "auto" is the first CUDA device, or the CPU.

    Raises:
        InputError: There is no such device; the message lists those that exist.
    """
    vars(wp.config)["quiet"] = True
    wp.init()
    if name == "auto":
        return wp.get_preferred_device()
    try:
        return wp.get_device(name)
    except (ValueError, RuntimeError):
        names = ", ".join(str(device) for device in wp.get_devices())
        raise InputError(
            Mistake("device", name, "does not exist on this machine", f"Use auto or one of: {names}.")
        ) from None


def _check(bodies: Sequence[Body], settings: Settings) -> None:
    mistakes = []
    if not bodies:
        mistakes.append(Mistake("body", None, "is missing", "Give at least one body."))
    names = [body.name for body in bodies]
    for name in sorted({n for n in names if names.count(n) > 1}):
        mistakes.append(Mistake("body.name", name, "is used twice", "Give every body a name of its own."))
    for key, known in (("integrator", INTEGRATORS), ("preconditioner", {"auto": None, **PRECONDITIONERS})):
        value = getattr(settings, key)
        if value not in known:
            mistakes.append(Mistake(key, value, "is not known", f"Use one of: {', '.join(known)}."))
    if mistakes:
        raise InputError(mistakes)
