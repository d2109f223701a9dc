"""The face of what acts between bodies, or between distant nodes of one."""

from collections.abc import Sequence
from typing import Any, ClassVar

import warp as wp

from warpdeform.result import ContactStep


class Coupling:
    """A potential of several bodies, with its gradient and a positive semi-definite Hessian.

    As for a :class:`~warpdeform.forces.force.Force`, every method but `prepare` and `bytes` only launches kernels.
    Vectors are named by the attribute of :class:`~warpdeform.state.State` that holds them. The part of the Hessian that
    couples nodes is found by conjugate gradient alone; preconditioners see its diagonal blocks.

    Attributes:
        states: The bodies that it acts on.
    """

    name: ClassVar[str] = "coupling"
    energy_kind: ClassVar[str] = "field"
    sample_nodes: int = 5
    """Most nodes that one sample of the energy couples, as of a :class:`~warpdeform.forces.force.Force`."""
    guarded: bool = False
    """It forbids crossing: for methods that ask `carry` and `guard` before anything moves."""
    states: Sequence[Any]

    @property
    def kernels(self) -> tuple[str, ...]:
        """Names of the kernels that it launches, for `warpdeform info`."""
        return ()

    def bytes(self) -> int:
        """Device memory that it keeps [bytes]."""
        return 0

    def prepare(self, time: float, dt: float, tau: float) -> None:
        """Write the parameters of the stage that ends at `time` [s] into device arrays (host, between steps)."""

    def begin(self) -> None:
        """Start of a step: "x" holds the accepted positions."""

    def carry(self, origin: str, start: str) -> None:
        """Change `start` so that nothing crosses on the way there from `origin`, where nothing does."""

    def linearise(self, vector: str) -> None:
        """Store at positions what gradient, Hessian product and blocks need."""

    def add_energy(self, vector: str) -> None:
        """Add the energy [J] at positions to the bodies' `partials`."""

    def stored_energy(self) -> float:
        """Energy [J] of the present state (host)."""
        arrays = {state.partials.ptr: state.partials for state in self.states}.values()
        for partials in arrays:
            partials.zero_()
        self.add_energy("x")
        return float(sum(partials.numpy().sum() for partials in arrays))

    def add_gradient(self, vector: str, gradient: str) -> None:
        """Add the derivative of the energy [N]; valid after `linearise` at the same positions."""

    def add_hessian_product(self, direction: str, product: str) -> None:
        """Add the Hessian without its diagonal blocks, which are among the node blocks, times a vector [N]."""

    def add_node_blocks(self, state: Any, blocks: wp.array) -> None:
        """Add the diagonal blocks of the Hessian on one of the bodies [N/m], shape (6, rows, columns)."""

    def guard(self, position: str, direction: str) -> None:
        """Change displacements so that nothing crosses on the way."""

    def judge(self, vector: str, state: wp.array) -> None:
        """Veto a step that ends at positions of that name: write an outcome of :mod:`warpdeform.kernels.newton`."""

    def finish(self) -> None:
        """The step is accepted: store what the next one starts from."""

    def report(self) -> ContactStep | None:
        """What it reports of the last attempt at a step (host)."""
        return None

    def reset(self) -> None:
        """Forget what earlier steps have stored, as at the start of a run."""
