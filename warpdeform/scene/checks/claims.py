"""What can be claimed of any run: a claim, the frames it is about, and claims that many scenes share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpdeform.crossings import crossing_pairs
from warpdeform.scene.measure import depth, samples
from warpdeform.selectors import select_nodes
from warpdeform.simplices import Simplices

if TYPE_CHECKING:
    from warpdeform.simulation import Simulation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Claim:
    """Something that must be true of a run.

    Attributes:
        text: What, as a sentence.
        value: What was measured.
        low: The smallest value allowed.
        high: The largest value allowed.
    """

    text: str
    value: float
    low: float = -np.inf
    high: float = np.inf

    @property
    def holds(self) -> bool:
        """Whether it is true; never of a value that is not a number."""
        return bool(self.low <= self.value <= self.high)

    def __str__(self) -> str:
        return f"{self.text}: {self.value:.4g}, allowed {self.low:.4g} to {self.high:.4g}"


@dataclass
class History:
    """The frames of a run; `observe` is called at each of them.

    Attributes:
        times: Time of each frame [s].
        positions: Node positions at each frame [m], by body, each of shape (*nodes, 3).
        energies: Kinetic, elastic, gravitational and field energy together [J].
        work: Work of pins, wind, drag and friction since the start [J].
    """

    times: list[float] = field(default_factory=list)
    positions: dict[str, list[Array]] = field(default_factory=dict)
    energies: list[float] = field(default_factory=list)
    work: list[float] = field(default_factory=list)

    def observe(self, simulation: Simulation) -> None:
        """Keep the present frame."""
        self.times.append(simulation.time)
        for body in simulation.bodies:
            self.positions.setdefault(body.name, []).append(np.asarray(body.positions(), dtype=np.float64))
        energy = simulation.record().energy
        self.energies.append(energy.kinetic + energy.elastic + energy.gravity + energy.field)
        self.work.append(energy.work_in)

    def after(self, time: float) -> int:
        """The first frame at or after `time` [s]."""
        return int(np.searchsorted(self.times, time - 1e-9))


Check = Callable[["Simulation", History], list[Claim]]


def pins_still(history: History, simulation: Simulation) -> Claim:
    """Nodes that are held without a path stay where they are, to the last bit."""
    moved = 0.0
    for handle in simulation.bodies:
        frames = np.array(history.positions[handle.name])
        for pin in handle.body.pins:
            if pin.track is None:
                nodes = select_nodes(pin.nodes, handle.nodes, handle.body.kind)
                held = frames[:, *nodes.T]
                moved = max(moved, float(np.abs(held - held[0]).max()))
    return Claim("pinned nodes move [m]", moved, 0.0, 0.0)


def stretch(simulation: Simulation, high: float) -> Claim:
    """No edge is ever longer than `high` times what it is at rest, when it has grown."""
    return Claim("longest edge over its rest length", simulation.record().max_stretch, 1.0 - 1e-6, high)


def nothing_inside(history: History, simulation: Simulation, name: str, deepest: float, every: int = 1) -> Claim:
    """Nodes, edges and cells stay outside all obstacles, at the last frame and every so many before it."""
    worst, grid = 0.0, simulation[name].model.grid
    for time, positions in list(zip(history.times, history.positions[name], strict=True))[::-every]:
        points = samples(grid.closed(positions))
        worst = max([worst, *(depth(obstacle, points, time) for obstacle in simulation.obstacles)])
    return Claim(f"depth of {name} inside an obstacle [m]", worst, 0.0, deepest)


def nothing_crosses(history: History, simulation: Simulation) -> Claim:
    """No edge goes through a triangle, of its own body or another, in any frame."""
    simplices = Simplices.joined([Simplices.of_grid(handle.model.grid) for handle in simulation.bodies])
    frames = zip(*(history.positions[handle.name] for handle in simulation.bodies), strict=True)
    points = (np.concatenate([x.reshape(-1, 3) for x in frame]) for frame in frames)
    return Claim("edges through triangles", max(len(crossing_pairs(x, simplices)) for x in points), 0, 0)
