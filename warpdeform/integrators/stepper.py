"""What carries the bodies of a simulation through time: the face of the solvers that methods are written for."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpdeform.errors import Mistake
from warpdeform.forces.coupling import Coupling
from warpdeform.forces.force import Force
from warpdeform.forces.ties import RigidTies
from warpdeform.kernels.krylov import krylov
from warpdeform.kernels.newton import decisions
from warpdeform.kernels.stage import stage
from warpdeform.launching import launch_alone, launch_lanes
from warpdeform.result import StepRecord
from warpdeform.settings import Settings
from warpdeform.state import State

Replay = Callable[[str], None]
"""Runs what a stepper has recorded, by its name."""


@dataclass(frozen=True)
class Problem:
    """What is to be carried through time.

    Attributes:
        states: The bodies.
        terms: The terms of each body.
        settings: Solver settings.
        iteration: The iteration counter that the states share, int32, shape (1,).
        threads: Threads that a step is shared by.
        couplings: What acts between bodies.
        rigid: Nodes that follow others.
    """

    states: Sequence[State]
    terms: Sequence[Sequence[Force]]
    settings: Settings
    iteration: wp.array
    threads: int = 1
    couplings: Sequence[Coupling] = ()
    rigid: Sequence[RigidTies] = ()

    @property
    def guarded(self) -> bool:
        """Whether something has to be asked before anything moves."""
        return any(coupling.guarded for coupling in self.couplings)

    @property
    def device(self) -> Any:
        """Warp device."""
        return self.states[0].device


MOST_SIZES = 30.0
"""Sizes of the largest body that a node may move by in a frame, or a 60th of a second where frames are longer, before a
step of a method that nothing else bounds is disbelieved."""
SLOW = 2000.0
"""Speed that is believed of any body [m/s],"""
LONG_FALL = 100.0
"""what a fall of this time adds to it [s],"""
RELEASED = 10.0
"""and so many times the speed that the energy stored at first can give."""


class Stepper:
    """Carries all bodies at once over intervals of time.

    What runs on the device is recorded once, as `recordings` names it, and replayed from then on; between replays the
    host writes parameters and reads one small block of outcomes.

    Args:
        problem: What is to be carried.
    """

    takes_frames: bool = False
    """Several steps are best taken in one call of `advance`."""
    notes: tuple[str, ...] = ()
    """What the method does otherwise than the settings say, as sentences for people."""
    preconditioner_name: str = ""
    """Name of the preconditioner; empty where nothing is solved."""

    def __init__(self, problem: Problem) -> None:
        self.states, self.settings = tuple(problem.states), problem.settings
        self.terms = [tuple(own) for own in problem.terms]
        self._couplings = tuple(problem.couplings)
        self._device, self._iteration = problem.device, problem.iteration
        extents = [np.ptp(s.model.initial_positions.reshape(-1, 3), axis=0) for s in self.states]
        size = max(float(np.linalg.norm(extent)) for extent in extents)
        elastic = [(s, term) for s, own in zip(self.states, self.terms, strict=True) for term in own if term.elastic]
        stored = sum(term.stored_energy(state, state.x) for state, term in elastic)
        mass = sum(float(state.model.node_mass.sum()) for state in self.states)
        believed = SLOW + LONG_FALL * float(np.linalg.norm(self.settings.gravity))
        believed += RELEASED * float(np.sqrt(max(2.0 * stored / mass, 0.0)))
        self._most_speed = max(MOST_SIZES * size * max(self.settings.fps, 60.0), believed)
        self._flushed: wp.array = wp.zeros(problem.threads, dtype=wp.int32, device=self._device)

    def recordings(self) -> Mapping[str, Callable[[], None]]:
        """Everything that is replayed, by name; each only launches."""
        raise NotImplementedError

    def rehearse(self) -> None:
        """Launch every kernel of every recording once, so that all of them are loaded (host)."""
        raise NotImplementedError

    def advance(self, start: float, end: float, steps: int, replay: Replay) -> list[StepRecord]:
        """Carry the bodies over an interval.

        Args:
            start: Its begin [s].
            end: Its end [s].
            steps: Equal steps to take unless the stepper needs more.
            replay: Runs a recording.

        Returns:
            What was tried, in order. An attempt that is not completed has left the bodies as they were before it; if
            the last one is not, the stepper has given up there.
        """
        raise NotImplementedError

    def worst_node(self) -> tuple[int, tuple[int, ...]]:
        """Index of the body, and node of it, that show why the last attempt was not completed (host).

        The first node that is not finite, before or after the attempt, or else the one with the largest residual.
        """
        for name in ("x", "z"):
            for index, state in enumerate(self.states):
                bad = np.argwhere(~np.isfinite(state.model.download(getattr(state, name))).all(axis=-1))
                if len(bad):
                    return index, tuple(int(k) for k in bad[0])
        worst: tuple[float, int, tuple[int, ...]] = (-1.0, 0, ())
        for index, state in enumerate(self.states):
            model = state.model
            with np.errstate(over="ignore", invalid="ignore"):
                force = np.linalg.norm(model.download(state.gradient) * model.download(state.free), axis=-1)
            residual = np.nan_to_num(force / model.node_mass, nan=np.inf)
            node = np.unravel_index(int(residual.argmax()), residual.shape)
            if residual[node] > worst[0]:
                worst = (float(residual[node]), index, tuple(int(k) for k in node))
        return worst[1:]

    def mistakes(self, replay: Replay) -> list[Mistake]:
        """What of the settings does not suit the method, seen from the state at the start."""
        return []

    def restart(self) -> None:
        """Forget what earlier steps have left: the state has been changed from outside."""

    def reset(self) -> None:
        """Forget all that was learnt, and write parameters as they are at the start of a run (host)."""
        self.restart()
        dt = self.settings.dt
        for state, own in zip(self.states, self.terms, strict=True):
            state.model.place_targets(0.0)
            for term in own:
                term.prepare(0.0, dt, dt)
        for coupling in self._couplings:
            coupling.prepare(0.0, dt, dt)

    def bytes(self) -> int:
        """Device memory beside that of states and terms [bytes]."""
        return 0

    def _stage(self, state: State, name: str, *inputs: Any) -> None:
        """Launch a kernel of :mod:`warpdeform.kernels.stage` over a body."""
        kernel = getattr(stage(state.lane_width, state.real), name)
        launch_lanes(kernel, state.layout, *inputs, device=self._device)

    def _lanes(self, state: State, name: str, *inputs: Any) -> None:
        """Launch a kernel of :mod:`warpdeform.kernels.krylov` over a body."""
        kernel = getattr(krylov(state.lane_width, state.real), name)
        launch_lanes(kernel, state.layout, *inputs, device=self._device)

    def _decide(self, name: str, *inputs: Any) -> None:
        """Launch a decision of :mod:`warpdeform.kernels.newton`."""
        launch_alone(getattr(decisions(), name), 1, *inputs, device=self._device)

    def _place_targets(self, time: float) -> None:
        """Pins to where they are in the step that ends at `time`; others held than before are a disturbance."""
        changed = [state.model.place_targets(time) for state in self.states]
        if any(changed):
            self.restart()

    def _couple(self, vector: str) -> None:
        """Add the gradients of what acts between bodies, at the positions of that name."""
        for coupling in self._couplings:
            coupling.linearise(vector)
            coupling.add_gradient(vector, "gradient")

    def _flush(self, name: str, thread: int) -> None:
        """The floating-point mode is each thread's own."""
        flushed = self._flushed[thread : thread + 1]
        wp.launch(getattr(decisions(), name), dim=1, inputs=[flushed], device=self._device)
