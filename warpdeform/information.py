"""What a simulation launches and allocates, for `warpdeform info`."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class TermInfo:
    """A term: its name, kernels and memory [bytes]."""

    name: str
    kernels: tuple[str, ...]
    bytes: int


@dataclass(frozen=True)
class BodyInfo:
    """A body: its name, kind, nodes, terms, and the memory of its state and step vectors [bytes]."""

    name: str
    kind: str
    nodes: tuple[int, ...]
    terms: tuple[TermInfo, ...]
    bytes: int


@dataclass(frozen=True)
class SimulationInfo:
    """What a simulation launches and allocates.

    Attributes:
        bodies: One entry per body.
        couplings: What acts between bodies.
        preconditioner: Name of the preconditioner; empty where nothing is solved.
        solver_bytes: Memory of operator and preconditioner, and of what acts between bodies [bytes].
    """

    bodies: tuple[BodyInfo, ...]
    couplings: tuple[TermInfo, ...]
    preconditioner: str
    solver_bytes: int

    @property
    def bytes_total(self) -> int:
        """Device memory in all [bytes]."""
        return self.solver_bytes + sum(b.bytes + sum(t.bytes for t in b.terms) for b in self.bodies)

    def lines(self) -> list[str]:
        """The table as people read it."""
        nodes = sum(math.prod(body.nodes) for body in self.bodies)
        lines = []
        for body in self.bodies:
            count, grid = math.prod(body.nodes), " x ".join(map(str, body.nodes))
            lines.append(f"{body.name}: {body.kind} {grid}, state {body.bytes / count:.0f} B/node")
            for term in body.terms:
                lines.append(f"  {term.name}: {term.bytes / count:.0f} B/node; kernels {', '.join(term.kernels)}")
        for coupling in self.couplings:
            lines.append(f"{coupling.name}: {coupling.bytes / nodes:.0f} B/node; kernels {', '.join(coupling.kernels)}")
        solver = f"conjugate gradient, {self.preconditioner}" if self.preconditioner else "explicit"
        lines.append(f"solver: {solver}, {self.solver_bytes / nodes:.0f} B/node")
        lines.append(f"total: {self.bytes_total} bytes, {self.bytes_total / nodes:.0f} B/node")
        return lines
