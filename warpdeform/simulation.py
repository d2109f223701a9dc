"""A simulation: bodies, obstacles and wind under one solver, stepped through time."""

import time as clock
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import warp as wp

from warpdeform.attachment import Attachment
from warpdeform.body import Body
from warpdeform.device import find_device
from warpdeform.errors import InputError, Mistake, SimulationFailure
from warpdeform.forces.ties import make_ties
from warpdeform.handle import BodyHandle
from warpdeform.information import BodyInfo, SimulationInfo, TermInfo
from warpdeform.integrators import INTEGRATORS
from warpdeform.integrators.newton import NewtonSolver
from warpdeform.linear import PRECONDITIONERS
from warpdeform.obstacle import Obstacle
from warpdeform.result import Energy, Outcome, RunRecord, StepRecord
from warpdeform.settings import Settings
from warpdeform.team import Team, choose_threads
from warpdeform.wind import Wind


class Simulation:
    """Bodies, obstacles and wind, stepped through time on one device.

    The first step runs uncaptured while kernels load; from then on a step is the replay of one graph, on CPU and CUDA.

    Args:
        bodies: At least one body, with names of their own.
        obstacles: Obstacles that every body meets.
        attachments: What ties bodies to each other.
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
        attachments: Sequence[Attachment] = (),
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
        self.bodies = tuple(
            BodyHandle(body, self.obstacles, wind, self.settings, self.device, self._iteration, lane_width)
            for body in bodies
        )
        states = [handle.state for handle in self.bodies]
        nodes = sum(handle.model.grid.node_count for handle in self.bodies)
        self.threads = choose_threads(self.settings.threads, nodes, self.device) if captured else 1
        terms = [handle.terms for handle in self.bodies]
        self.attachments = tuple(attachments)
        named = {handle.name: handle for handle in self.bodies}
        self.couplings, rigid = make_ties(
            self.attachments, {n: h.body for n, h in named.items()}, {n: h.state for n, h in named.items()}
        )
        self._solver = NewtonSolver(states, terms, self.settings, self._iteration, self.threads, self.couplings, rigid)
        self._team = Team(self.threads, self.device)
        self._record = RunRecord(
            nodes=nodes,
            device=str(self.device),
            precision=self.settings.precision,
            integrator=self.integrator.name,
        )
        self._steps = 0
        self._dt_before: float | None = None
        self._impact = False
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

    def __getitem__(self, name: str) -> BodyHandle:
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
        self._solver.prepare(self.integrator.stage(self.dt, self._dt_before), end, self.dt, self._impact)
        if self._team.recorded:
            self._team.replay()
        else:
            self._solver.record()
        report = self._solver.report()
        self._record.add_step(report)
        self._record.wall_s += clock.perf_counter() - started
        if report.outcome is Outcome.NOT_FINITE or not np.isfinite(report.residual):
            raise self._failure(end)
        self._steps += 1
        # The step of an impact and the one after it are backward Euler: BDF2 would extrapolate the speed from before.
        self._dt_before = None if report.impact_ahead or self._impact else self.dt
        self._impact = report.impact_ahead
        return report

    def advance_frame(self) -> None:
        """Advance by one frame: `settings.substeps` steps."""
        for _ in range(self.settings.substeps):
            self.step()
        for handle in self.bodies:
            self._record.max_stretch = max(self._record.max_stretch, handle.max_stretch())

    def reset(self) -> None:
        """Back to the initial state, bit for bit."""
        self._rewind()
        fresh = RunRecord(
            nodes=self._record.nodes,
            device=self._record.device,
            precision=self._record.precision,
            integrator=self._record.integrator,
            setup_s=self._record.setup_s,
        )
        self._record, self._steps, self._dt_before, self._impact = fresh, 0, None, False

    def record(self) -> RunRecord:
        """Statistics up to now, with the energies of the present state."""
        energy = Energy(work_in=self._record.energy.work_in)
        for handle in self.bodies:
            handle.add_energies(energy)
        for coupling in self.couplings:
            kind = coupling.energy_kind
            setattr(energy, kind, getattr(energy, kind) + coupling.stored_energy())
        return replace(self._record, frames=self.frame + 1, sim_s=self.time, energy=energy)

    def info(self) -> SimulationInfo:
        """Terms, kernels and bytes of every body."""
        bodies = []
        for handle in self.bodies:
            terms = [TermInfo(term.name, term.kernels, term.bytes()) for term in handle.terms]
            bodies.append(BodyInfo(handle.name, handle.body.kind, handle.nodes, tuple(terms), handle.state.bytes()))
        solver = self._solver.operator.bytes() + self._solver.preconditioner.bytes()
        return SimulationInfo(tuple(bodies), self._solver.preconditioner.name, solver)

    def _compile(self) -> None:
        """Load every kernel of a step by running one, capture it, and put everything back."""
        self._solver.prepare(self.integrator.stage(self.dt, None), self.dt, self.dt)
        self._solver.rehearse()
        if self._captured:
            self._team.record(self._solver.record)
        self._rewind()

    def _rewind(self) -> None:
        """State, pins, terms and what the solver has learnt as they are at the start."""
        self._solver.prepare(self.integrator.stage(self.dt, None), 0.0, self.dt)
        for handle in self.bodies:
            handle.state.reset()
            for term in handle.terms:
                term.reset()
        self._solver.preconditioner.reset()

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
