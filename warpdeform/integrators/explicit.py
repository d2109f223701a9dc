"""Explicit steps: many in a row, none of which asks the host, and as many as stay stable.

A burst of steps, in the order in which it is recorded:

    keep the state; pinned nodes get the velocity that takes them to their targets; positions drift ahead
    steps: forces at the positions as they are, kick, drift (:mod:`warpdeform.kernels.explicit`)
    positions drift back; pins to their targets; greatest speed, work of loads and pins

A burst is a whole frame, or as many steps as all terms can share one `prepare`: eight where pins, springs or wind
change with time, one where obstacles move. Forces of wind and drag take the velocity that the last two steps lead on
to; what is lagged in implicit steps (friction) is taken as the step finds it, and is of first order.

The largest frequency is bounded before each frame, and again after so many steps, at the positions as they are; with
fields of obstacles their steepest slope counts always, because nodes come into them within a burst.
"""

import math
from collections.abc import Callable, Mapping

import numpy as np
import warp as wp

from warpdeform.errors import InputError, Mistake
from warpdeform.forces.obstacle_field import ObstacleField
from warpdeform.forces.parameters import Parameters
from warpdeform.integrators.explicit_body import ExplicitBody, takes_part
from warpdeform.integrators.stepper import Problem, Replay, Stepper
from warpdeform.kernels import explicit as entries
from warpdeform.kernels.explicit import counting
from warpdeform.launching import choose, do_each, launch_alone, repeat_while
from warpdeform.linear.sums import Sums
from warpdeform.result import Outcome, StepRecord

SAFETY = 0.95
"""Share of the stable step that is taken: the state changes before the next look at the largest frequency."""
PINNED_STEPS = 8
"""Steps of a burst where pins move: their path is straight within it."""
MOST_UNSEEN = 128
"""Steps from one look at the largest frequency to the next, which takes as long as five of them."""
MOST_DOUBLINGS = 6
"""How often a burst that has failed is repeated with twice as many steps: down to a 64th of the step."""
TAU = 1.0
"""Velocities reach the terms as (z - w) / TAU [s]; no step could keep as many digits of them."""

SPEED = 0
RATE, DAMPING = 1, 2
WORK = 3
SCALARS = 5


class ExplicitStepper(Stepper):
    """Symplectic Euler and its kin: v' = v + dt a, x' = x + dt v'.

    Args:
        problem: What is to be carried.
        ahead: How far positions are ahead of velocities while steps are taken, in steps: 0 or 1/2.
        extrapolated: How far the velocity that loads take is extrapolated beyond the last one, in steps.
    """

    takes_frames = True

    def __init__(self, problem: Problem, ahead: float, extrapolated: float) -> None:
        super().__init__(problem)
        if problem.rigid:
            problem_ = "moves every node by itself, and rigid attachments make some follow others"
            remedy = "Give the attachment a stiffness, or use bdf2."
            raise InputError(Mistake("integrator", self.settings.integrator, problem_, remedy))
        self._ahead, self._extrapolated = ahead, extrapolated
        device = self._device
        self.sums = Sums(self.states)
        self._displacing = any(takes_part(term) for own in self.terms for term in own)
        pairs = zip(self.states, self.terms, strict=True)
        coupled = [state for coupling in self._couplings for state in coupling.states]
        self._bodies = [ExplicitBody(state, own, self._displacing, state in coupled) for state, own in pairs]
        self._working = any(body.kick.working for body in self._bodies)
        self._counts: wp.array = wp.zeros(entries.COUNTS, dtype=wp.int32, device=device)
        self._left = self._counts[entries.LEFT : entries.LEFT + 1]
        self._odd = self._counts[entries.ODD : entries.ODD + 1]
        self._count = Parameters([0], wp.int32, device)
        self._scalars: wp.array = wp.zeros(SCALARS, dtype=wp.float64, device=device)
        self._pace = {state.real: Parameters(np.zeros(entries.PACE), state.real, device) for state in self.states}
        moving = [MOST_UNSEEN, *(PINNED_STEPS for state in self.states if state.model.pins_move)]
        self._most_steps = min([*moving, *(term.most_steps for own in self.terms for term in own)])
        self._most_rate = max(term.most_rate for own in self.terms for term in own)
        self._worst_node: tuple[int, tuple[int, ...]] = (0, ())
        self._fresh = True

    def recordings(self) -> Mapping[str, Callable[[], None]]:
        return {"burst": self._burst, "limit": self._bound, "restore": self._restore}

    def rehearse(self) -> None:
        self._prepare(0.0, 3.0e-6, 1.0e-6, 3)
        for record in self.recordings().values():
            record()

    def advance(self, start: float, end: float, steps: int, replay: Replay) -> list[StepRecord]:
        attempts: list[StepRecord] = []
        count, done, doublings, unseen, length = steps, 0, 0, MOST_UNSEEN, steps * self.settings.dt
        while done < count:
            now = start + length * done / count
            if unseen >= MOST_UNSEEN:
                needed, unseen = math.ceil((end - now) / self.stable_step(replay)) * 2**doublings, 0
                if needed > count - done and self.settings.time_step == "fixed":
                    return [*attempts, _failed(Outcome.TOO_LONG, now, (end - now) / (count - done))]
                if needed > count - done:
                    length -= length * done / count
                    start, count, done = now, needed, 0
            group = min(self._most_steps, count - done)
            then = end if done + group == count else start + length * (done + group) / count
            attempts.append(self._attempt(now, then, length / count, group, replay))
            if attempts[-1].completed:
                done, unseen = done + group, unseen + group
            elif doublings < MOST_DOUBLINGS:
                count, done, doublings = 2 * count, 2 * done, doublings + 1
            else:
                break
        return attempts

    def mistakes(self, replay: Replay) -> list[Mistake]:
        settings = self.settings
        if settings.time_step == "adaptive":
            problem = "is for implicit methods: explicit ones follow what is stable"
            return [
                Mistake(
                    "time_step", "adaptive", problem, f"Use auto, or another integrator than {settings.integrator}."
                )
            ]
        thrown = self._thrown()
        if thrown:
            return thrown
        limit = self.stable_step(replay)
        needed = math.ceil(1.0 / (settings.fps * limit))
        if settings.dt > limit:
            self.notes = (f"{settings.integrator} takes {needed} steps a frame or more, to be stable.",)
        if settings.time_step == "fixed" and settings.dt > limit:
            problem = f"makes steps of {settings.dt:.3g} s, and {settings.integrator} is stable up to {limit:.3g} s"
            remedy = f'Use {needed} substeps or more, or time_step = "auto".'
            return [Mistake("substeps", settings.substeps, problem, remedy)]
        return []

    def _thrown(self) -> list[Mistake]:
        """Bodies that start inside obstacles, and would be shot out: their fields hold more than they are designed for.

        Implicit methods damp that; explicit ones would have to keep it all, through deformations that stiffen between
        two looks at the largest frequency.
        """
        found = []
        for state, own in zip(self.states, self.terms, strict=True):
            for term in own:
                if not isinstance(term, ObstacleField):
                    continue
                stored = term.stored_energy(state, state.x)
                speed = math.sqrt(2.0 * stored / float(state.model.node_mass.sum()))
                if speed > max(constants.design_speed for constants in term.constants):
                    problem = f'would shoot body "{state.model.body.name}" out of the obstacle that it starts in'
                    remedy = "Start it outside, or use bdf2, which lets it out gently."
                    found.append(
                        Mistake("integrator", self.settings.integrator, f"{problem} at {speed:.0f} m/s", remedy)
                    )
        return found

    def stable_step(self, replay: Replay) -> float:
        """The largest step that is taken now [s]: the stable one, by the bound, times `SAFETY`.

        With lambda the bound on squared frequencies and gamma that on rates of damping, both explicit,
        lambda dt^2 + 2 gamma dt = 4.
        """
        replay("limit")
        scalars = self._scalars.numpy()
        rate, damping = float(scalars[RATE]) + self._most_rate, float(scalars[DAMPING])
        damping *= 1.0 + 2.0 * self._extrapolated
        fastest = damping + math.sqrt(damping * damping + 4.0 * rate)
        return SAFETY * 4.0 / fastest if fastest > 0.0 else math.inf

    def restart(self) -> None:
        self._fresh = True

    def worst_node(self) -> tuple[int, tuple[int, ...]]:
        return self._worst_node

    def bytes(self) -> int:
        return sum(body.bytes() for body in self._bodies)

    def _attempt(self, start: float, end: float, dt: float, count: int, replay: Replay) -> StepRecord:
        """A burst; one that does not end finite leaves the state as it was."""
        self._prepare(start, end, dt, count)
        replay("burst")
        scalars = self._scalars.numpy()
        self._fresh = not scalars[SPEED] <= self._most_speed
        if not self._fresh:
            work = float(scalars[WORK]) if self._working else 0.0
            return StepRecord(Outcome.EXPLICIT, work=work, steps=count, start=start, dt=dt)
        self._worst_node = self._fastest_node()
        replay("restore")
        outcome = Outcome.RUNAWAY if math.isfinite(scalars[SPEED]) else Outcome.NOT_FINITE
        return _failed(outcome, start, dt)

    def _prepare(self, start: float, end: float, dt: float, count: int) -> None:
        """Write what changes from burst to burst into device arrays (host)."""
        self._count.write([count])
        for pace in self._pace.values():
            ahead = self._ahead * dt
            pace.write([dt, 1.0 / dt, ahead, self._extrapolated, 1.0 / (count * dt), float(self._fresh)])
        self._place_targets(end)
        for own in self.terms:
            for term in own:
                # What is kept for several steps is that of their middle.
                time = end if term.most_steps == 1 else 0.5 * (start + end)
                term.prepare(time, count * dt, TAU)
        for coupling in self._couplings:
            coupling.prepare(0.5 * (start + end), count * dt, TAU)

    def _fastest_node(self) -> tuple[int, tuple[int, ...]]:
        """Body and node, one that is not finite before all others."""
        with np.errstate(over="ignore", invalid="ignore"):
            speeds = [np.linalg.norm(state.model.download(state.v), axis=-1) for state in self.states]
        speeds = [np.nan_to_num(speed, nan=np.inf) for speed in speeds]
        index = int(np.argmax([speed.max() for speed in speeds]))
        node = np.unravel_index(int(speeds[index].argmax()), speeds[index].shape)
        return index, tuple(int(k) for k in node)

    def _burst(self) -> None:
        do_each(lambda thread: self._flush("enter_step", thread))
        together = 1 if self._displacing else 2
        inputs = [self._count.array, together, self._counts, self._iteration]
        launch_alone(counting().begin_burst, 1, *inputs, device=self._device)
        for body in self._bodies:
            body.begin(self._pace)
        repeat_while(self._left, self._steps, together=together)
        if not self._displacing:
            choose(self._odd, self._last_step, None)
        if self._working:
            self.sums.total_dots(WORK, self._scalars)
        for body in self._bodies:
            body.end(self._pace)
        self.sums.greatest_dots(SPEED, self._scalars)
        do_each(lambda thread: self._flush("leave_step", thread))

    def _steps(self, together: int) -> None:
        """One step in place, or two: to the other array of positions and back."""
        if together == 1:
            self._displacing_step()
        else:
            self._step("x", "z")
            self._step("z", "x")
        launch_alone(counting().count_down, 1, self._counts, device=self._device)

    def _last_step(self) -> None:
        self._step("x", "z")
        for body in self._bodies:
            body.copy(body.state.z, body.state.x)

    def _step(self, x: str, next_x: str) -> None:
        """From one array of positions to another."""
        for body in self._bodies:
            body.add_gradients(getattr(body.state, x))
        self._couple(x)
        for body in self._bodies:
            body.advance(self._pace, getattr(body.state, x), getattr(body.state, next_x))

    def _displacing_step(self) -> None:
        """In place, with all that terms do in a step."""
        for body in self._bodies:
            body.begin_step()
            body.add_gradients(body.state.z)
        self._couple("z")
        for body in self._bodies:
            body.advance(self._pace, body.state.z, body.state.direction)
            body.end_step(self._pace)

    def _bound(self) -> None:
        """Largest frequency and rate of damping into the scalars."""
        for entry, damping in ((RATE, False), (DAMPING, True)):
            for body in self._bodies:
                body.bound(damping, self._couplings)
            self.sums.greatest_dots(entry, self._scalars)

    def _restore(self) -> None:
        for body in self._bodies:
            body.restore()


def _failed(outcome: Outcome, start: float, dt: float) -> StepRecord:
    return StepRecord(outcome, completed=False, steps=0, retries=1, start=start, dt=dt)
