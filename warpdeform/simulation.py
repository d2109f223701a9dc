"""A simulation: bodies, obstacles and wind under one solver, stepped through time."""

import time as clock
from collections.abc import Sequence
from dataclasses import replace

import warp as wp

from warpdeform.attachment import Attachment
from warpdeform.body import Body
from warpdeform.contact import Contact
from warpdeform.device import find_device
from warpdeform.errors import InputError, Mistake, SimulationFailure
from warpdeform.forces.coupling import Coupling
from warpdeform.forces.ties import make_ties
from warpdeform.handle import BodyHandle
from warpdeform.information import BodyInfo, SimulationInfo, TermInfo
from warpdeform.integrators import INTEGRATORS, Problem
from warpdeform.linear import PRECONDITIONERS
from warpdeform.obstacle import Obstacle
from warpdeform.relaxing import relax_start
from warpdeform.result import REMEDIES, ContactRecord, Energy, Outcome, RunRecord, StepRecord, joined
from warpdeform.settings import Settings
from warpdeform.team import Team, choose_threads
from warpdeform.touching import add_contacts
from warpdeform.wind import Wind


class Simulation:
    """Bodies, obstacles and wind, stepped through time on one device.

    The first step runs uncaptured while kernels load; from then on a step is the replay of one graph, on CPU and CUDA.

    Args:
        bodies: At least one body, with names of their own.
        obstacles: Obstacles that every body meets.
        contacts: Pairs of bodies that feel each other; bodies with `self_contact` need none.
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
        contacts: Sequence[Contact] = (),
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
        bodies, self.relaxed = relax_start(bodies, contacts, attachments)
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
        soft, rigid = make_ties(
            self.attachments, {n: h.body for n, h in named.items()}, {n: h.state for n, h in named.items()}
        )
        for ties in rigid:
            next(handle for handle in self.bodies if handle.state is ties.states[0]).leave_bare(ties.nodes)
        for attachment in self.attachments:
            if attachment.stiffness is None and named[attachment.body].mass > named[attachment.to].mass:
                named[attachment.to].raise_walls()
        self.contact, self._skins = add_contacts(self.bodies, contacts, self.settings, rigid)
        self.couplings: tuple[Coupling, ...] = soft if self.contact is None else (*soft, self.contact)
        problem = Problem(states, terms, self.settings, self._iteration, self.threads, self.couplings, rigid)
        self._stepper = self.integrator.stepper(problem)
        self._team = Team(self.threads, self.device)
        self._record = RunRecord(
            nodes=nodes,
            device=str(self.device),
            precision=self.settings.precision,
            integrator=self.integrator.name,
            contact=self._fresh_contact(),
        )
        self._steps = 0
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
        """Advance by one time step, which the solver may take in several.

        Raises:
            SimulationFailure: The step cannot be completed; the message names body, time, node and likely cause. The
                state is what it was before.
        """
        return self._advance(1)

    def advance_frame(self) -> None:
        """Advance by one frame: `settings.substeps` steps.

        Raises:
            SimulationFailure: As `step`.
        """
        steps = self.settings.substeps
        together = steps if self._stepper.takes_frames else 1
        for _ in range(steps // together):
            self._advance(together)
        for handle in self.bodies:
            self._record.max_stretch = max(self._record.max_stretch, handle.max_stretch())

    def restart(self) -> None:
        """Say that the state was changed from outside: the next step takes nothing from those before it."""
        self._stepper.restart()

    def reset(self) -> None:
        """Back to the initial state, bit for bit."""
        self._rewind()
        fresh = RunRecord(
            nodes=self._record.nodes,
            device=self._record.device,
            precision=self._record.precision,
            integrator=self._record.integrator,
            setup_s=self._record.setup_s,
            contact=self._fresh_contact(),
        )
        self._record, self._steps = fresh, 0

    def record(self) -> RunRecord:
        """Statistics up to now, with the energies of the present state."""
        energy = Energy(work_in=self._record.energy.work_in)
        for handle in self.bodies:
            handle.add_energies(energy)
        for coupling in self.couplings:
            kind = coupling.energy_kind
            setattr(energy, kind, getattr(energy, kind) + coupling.stored_energy())
        return replace(
            self._record,
            frames=self.frame + 1,
            sim_s=self.time,
            energy=energy,
            outcomes=dict(self._record.outcomes),
            error_estimate=dict(self._record.error_estimate),
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """What is done otherwise than the user says, by the method or before the start, as sentences for people."""
        return self._stepper.notes if self.relaxed is None else (*self._stepper.notes, *self.relaxed.notes)

    def count_crossings(self) -> int:
        """Edges that go through triangles, of bodies that feel each other: 0, by all that is held true here.

        Counted on the host in double precision; takes as long as some steps.
        """
        if self._skins is None:
            return 0
        points = self._skins.joined([self[body.name].positions() for body in self._skins.bodies])
        return len(self._skins.crossing(points)[0])

    def info(self) -> SimulationInfo:
        """Terms, kernels and bytes of every body."""
        bodies = []
        for handle in self.bodies:
            terms = [TermInfo(term.name, term.kernels, term.bytes()) for term in handle.terms]
            bodies.append(BodyInfo(handle.name, handle.body.kind, handle.nodes, tuple(terms), handle.state.bytes()))
        couplings = tuple(TermInfo(each.name, each.kernels, each.bytes()) for each in self.couplings)
        return SimulationInfo(tuple(bodies), couplings, self._stepper.preconditioner_name, self._stepper.bytes())

    def _fresh_contact(self) -> ContactRecord | None:
        return None if self.relaxed is None else ContactRecord(relaxed=self.relaxed.largest)

    def _advance(self, steps: int) -> StepRecord:
        """Take so many steps at once."""
        started = clock.perf_counter()
        start, end = self.time, (self._steps + steps) * self.dt
        attempts = self._stepper.advance(start, end, steps, self._replay)
        for attempt in attempts:
            self._record.add_step(attempt)
        self._record.wall_s += clock.perf_counter() - started
        if not attempts[-1].completed:
            raise self._failure(attempts[-1])
        self._steps += steps
        return joined(attempts)

    def _replay(self, name: str) -> None:
        """Run what the stepper has recorded under that name."""
        if self._captured:
            self._team.replay(name)
        else:
            self._recordings[name]()

    def _compile(self) -> None:
        """Load every kernel of a step by running one, capture it, and put everything back."""
        self._recordings = self._stepper.recordings()
        self._stepper.rehearse()
        if self._captured:
            for name, record in self._recordings.items():
                self._team.record(record, name)
        self._rewind()
        mistakes = self._stepper.mistakes(self._replay)
        if mistakes:
            raise InputError(mistakes)

    def _rewind(self) -> None:
        """State, pins, terms and what the solver has learnt as they are at the start."""
        self._stepper.reset()
        for handle in self.bodies:
            handle.state.reset()
            for term in handle.terms:
                term.reset()
        for coupling in self.couplings:
            coupling.reset()

    def _last_pin(self) -> tuple[int, tuple[int, ...]]:
        """Body and node of the pin that is farthest behind its target in the last attempt."""
        lags = [handle.model.pin_lag(handle.state.z) for handle in self.bodies]
        index = max(range(len(lags)), key=lambda k: lags[k][0])
        return index, lags[index][1]

    def _failure(self, attempt: StepRecord) -> SimulationFailure:
        outcome = attempt.outcome
        index, node = self._last_pin() if outcome is Outcome.BLOCKED else self._stepper.worst_node()
        cause = f"a step of {attempt.dt:.3g} s could not be completed: {outcome.value[0].lower()}{outcome.value[1:-1]}"
        return SimulationFailure(self.bodies[index].name, attempt.start, node, cause, REMEDIES[outcome])


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
