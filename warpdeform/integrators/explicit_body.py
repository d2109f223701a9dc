"""One body in explicit steps: which kicks it gets, and the launches of its step."""

from collections.abc import Mapping, Sequence
from typing import Any

import warp as wp

from warpdeform.forces.coupling import Coupling
from warpdeform.forces.force import Force
from warpdeform.forces.parameters import Parameters
from warpdeform.kernels.explicit import Kick, bursts, kicks, no_gathering
from warpdeform.kernels.krylov import krylov
from warpdeform.kernels.stage import stage
from warpdeform.launching import RowStruct, launch_in_bands, launch_lanes
from warpdeform.state import State

Paces = Mapping[Any, Parameters]
"""The pace of a burst, for each precision."""


class ExplicitBody:
    """A body and the launches of its explicit steps.

    The force of the elastic term that has a `force_gathering` is gathered in the kick itself, and gravity is a number
    there unless the work of moving pins is wanted; all others add their gradients to an array first.

    Where a term has a say in every step (`takes_part`), a step goes through a displacement. Else it goes from one array
    of positions to another, because the force of the next band of rows is still to be taken at the first.

    Args:
        state: The body.
        terms: Its terms.
        displacing: A term of any body takes part in every step.
        coupled: Something couples it to other bodies.

    Attributes:
        kick: What a kick is made of.
    """

    def __init__(self, state: State, terms: Sequence[Force], displacing: bool, coupled: bool = False) -> None:
        self.state, self.terms = state, tuple(terms)
        moving = state.model.pins_move
        gathered = [term for term in terms if term.force_gathering is not None][:1]
        pushing = [term for term in terms if term.uniform is not None and not moving][:1]
        self._loads = [term for term in terms if not term.energy_kind]
        self._others = [term for term in terms if term not in (*gathered, *pushing, *self._loads)]
        self.kick = Kick(
            gathering=gathered[0].force_gathering if gathered else None,
            loaded=bool(self._loads or self._others or coupled),
            pushed=bool(pushing),
            trailing=bool(self._loads),
            displacing=displacing,
            working=bool(self._loads or moving),
        )
        width, real, device = state.lane_width, state.real, state.device
        self._none: wp.array = wp.zeros((1, 1, 1), dtype=real, device=device)
        self._gathered = gathered[0] if gathered else None
        self._fluxes = RowStruct(no_gathering(width, real).Fluxes, {"none": self._none})
        if gathered:
            self._fluxes = gathered[0].force_fluxes
        self._push = pushing[0].uniform if pushing else wp.zeros(3, dtype=real, device=device)
        self._per_mass = state.model.upload(1.0 / state.model.node_mass)
        self._blocks = state.model.zeros(6)
        self._kicks = kicks(width, real, self.kick)

    def bytes(self) -> int:
        """Device memory beside that of state and terms [bytes]."""
        return sum(int(array.capacity) for array in (self._none, self._per_mass, self._blocks))

    def begin(self, paces: Paces) -> None:
        """Keep the state, send pins on their way, drift ahead."""
        state, pace = self.state, paces[self.state.real].array
        self._launch("begin", state.free, state.model.target, pace, state.x, state.v, state.x_before, state.v_before)
        launch_lanes(self._stage.clear_partials, state.layout, state.dots, device=state.device)
        for term in self.terms:
            term.keep(state)
        if self.kick.displacing:
            self._launch("drift_ahead", pace, state.v, state.direction)
            for term in self.terms:
                term.guard(state, state.x, state.direction)
            self._launch("add", state.direction, state.x)
        else:
            self._launch("drift", pace, state.real(1.0), state.v, state.x)
        if self.kick.trailing:
            self._launch("trail", pace, state.x, state.v, state.w)

    def begin_step(self) -> None:
        """Before the forces of a step in place: z, which may not be x where obstacles move."""
        state = self.state
        for term in self.terms:
            term.begin(state)
        self.copy(state.x, state.z)
        for term in self.terms:
            term.carry(state, state.z)

    def end_step(self, paces: Paces) -> None:
        """Clip the displacement of a step in place and move by it."""
        state = self.state
        for term in self.terms:
            term.guard(state, state.z, state.direction)
        inputs = [paces[state.real].array, state.direction, state.z, state.x, state.v, self._trailing]
        launch_lanes(self._kicks.move, state.layout, *inputs, device=state.device)
        for term in self.terms:
            term.finish(state)

    def end(self, paces: Paces) -> None:
        """Drift back, pins to their targets; the greatest speed of each lane group into `State.dots`."""
        state = self.state
        if self.kick.trailing:
            # Between bursts w keeps the velocity itself.
            launch_lanes(self._stage.difference, state.layout, state.x, state.w, state.w, device=state.device)
        self._launch("drift", paces[state.real].array, state.real(-1.0), state.v, state.x)
        launch_lanes(self._stage.place_pins, state.layout, state.free, state.model.target, state.x, device=state.device)
        self._launch("greatest_speed", state.v, state.dots)

    def restore(self) -> None:
        """Back to the state that `begin` has kept."""
        self.copy(self.state.x_before, self.state.x)
        self.copy(self.state.v_before, self.state.v)
        for term in self.terms:
            term.restore(self.state)

    def bound(self, damping: bool, couplings: Sequence[Coupling]) -> None:
        """A bound on the largest squared frequency [1/s2], or rate of damping [1/s], into `State.dots`.

        Terms that name their own `most_rate` are left out.
        """
        state = self.state
        self._launch("clear_blocks", self._blocks)
        for term in self.terms:
            if bool(term.energy_kind) is damping or term.most_rate:
                continue
            term.linearise(state, state.x)
            if term.elastic:
                term.add_majorant(state, self._blocks)
            else:
                term.add_node_blocks(state, self._blocks)
        for coupling in couplings if not damping else ():
            coupling.linearise("x")
            for _ in range(coupling.sample_nodes):
                coupling.add_node_blocks(state, self._blocks)
        self._launch("bound_rates", self._blocks, self._per_mass, state.free, state.dots)

    def copy(self, a: wp.array, b: wp.array) -> None:
        """b = a."""
        state = self.state
        launch_lanes(krylov(state.lane_width, state.real).copy, state.layout, a, b, device=state.device)

    def add_gradients(self, position: wp.array) -> None:
        """The gradient of all that is not gathered, loads first, so that their work can be told from the rest."""
        if not self.kick.loaded:
            return
        state = self.state
        launch_lanes(krylov(state.lane_width, state.real).clear, state.layout, state.gradient, device=state.device)
        for terms in (self._loads, self._others):
            for term in terms:
                term.linearise(state, position)
                term.add_gradient(state, position, state.gradient)
            if terms is self._loads and terms:
                self.copy(state.gradient, state.loads)

    def advance(self, paces: Paces, x: wp.array, next_out: wp.array) -> None:
        """The kick, from forces at `x`; what it moves by or to into `next_out`."""
        state, none = self.state, self._none
        loaded = state.gradient if self.kick.loaded else none
        loads = state.loads if self._loads else none
        inputs = [self._fluxes, loaded, loads, self._per_mass, state.free, self._push, paces[state.real].array]
        outputs = [x, state.v, next_out, self._trailing, state.dots]
        gathered = self._gathered
        launch_in_bands(
            state.layout,
            [self._fluxes.arrays[name] for name in self._fluxes.buffers],
            lambda: gathered.write_force(state, x) if gathered else None,
            lambda: launch_lanes(self._kicks.advance, state.layout, *inputs, *outputs, device=state.device),
            state.device,
        )

    @property
    def _trailing(self) -> wp.array:
        return self.state.w if self.kick.trailing else self._none

    @property
    def _stage(self) -> Any:
        return stage(self.state.lane_width, self.state.real)

    def _launch(self, name: str, *inputs: Any) -> None:
        state = self.state
        kernel = getattr(bursts(state.lane_width, state.real), name)
        launch_lanes(kernel, state.layout, *inputs, device=state.device)


def takes_part(term: Force) -> bool:
    """Whether a term does more in a step than give a force."""
    return any(getattr(type(term), word) is not getattr(Force, word) for word in ("begin", "carry", "guard", "finish"))
