"""`bench contact`: what contact costs, phase by phase, and how much longer steps take with it."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import warp as wp

from warpdeform.body import Body, Pin
from warpdeform.crossings import crossing_pairs
from warpdeform.settings import Settings
from warpdeform.shape import sheet
from warpdeform.simplices import Simplices
from warpdeform.simulation import Simulation
from warpdeform.study.accordion import CLOTH, SUBSTEPS, accordion
from warpdeform.study.bench.machine import describe, one_core
from warpdeform.study.bench.table import Target, table, targets_lines, three_digits

SETTLED = 18
"""Frames in which the accordion falls together before it is measured."""
MEASURED = 6
"""Frames that are measured."""
LIMITS = {"apart": 1.15, "accordion": 3.0}
"""Step time with contact over that without, at most."""
STATED = 257
"""Nodes along each side for which the limits are stated."""


@dataclass(frozen=True)
class PhaseTime:
    """What a phase of contact takes once: CPU time per node and per pair [ns], the least of the repeats."""

    name: str
    ns_per_node: float
    ns_per_pair: float


@dataclass(frozen=True)
class SceneTime:
    """Frames of a scene, with and without contact.

    Attributes:
        scene: Which.
        engine: Who steps it.
        nodes: Nodes along each side.
        ms_with: CPU time per frame with contact [ms], median.
        ms_without: The same without.
        crossings: In the last frame with contact.
        pairs: Most pairs.
        guard_active: Share of nodes that the guard pushed, mean.
    """

    scene: str
    engine: str
    nodes: int
    ms_with: float
    ms_without: float
    crossings: int
    pairs: int = 0
    guard_active: float = 0.0

    @property
    def ratio(self) -> float:
        """Time with over without."""
        return self.ms_with / self.ms_without


@dataclass(frozen=True)
class ContactTimes:
    """The result of `bench contact`."""

    machine: dict[str, Any]
    nodes: int
    layers: int
    pairs: int
    phases: tuple[PhaseTime, ...]
    scenes: tuple[SceneTime, ...]
    targets: tuple[Target, ...]

    def as_dict(self) -> dict[str, Any]:
        """The result as plain numbers, strings, lists and dicts."""
        return asdict(self)

    def lines(self) -> list[str]:
        """The tables as people read them."""
        head = f"accordion, {self.nodes} x {self.nodes} in {self.layers} layers, {self.pairs} pairs, one core, float32"
        phases = [(p.name, three_digits(p.ns_per_node), three_digits(p.ns_per_pair)) for p in self.phases]
        scenes = [
            (
                f"{s.scene}, {s.engine}", three_digits(s.ms_with), three_digits(s.ms_without), three_digits(s.ratio),
                str(s.crossings), str(s.pairs), f"{100 * s.guard_active:.1f} %",
            )
            for s in self.scenes
        ]  # fmt: skip
        header = ("scene, engine", "ms a frame with", "without", "ratio", "crossings", "pairs", "guard")
        parts = [table(("phase", "ns/node", "ns/pair"), phases), table(header, scenes), targets_lines(self.targets)]
        return [head, "", *parts[0], "", *parts[1], "", *parts[2]]


def bench_contact(
    nodes: int = STATED,
    layers: int = 16,
    *,
    repeats: int = 5,
    core: int | None = None,
    peers: bool = True,
    said: Callable[[str], None] = lambda line: None,
) -> ContactTimes:
    """Measure contact on one core of the CPU.

    Args:
        nodes: Nodes along each side.
        layers: Layers of the accordion.
        repeats: How often a phase is timed.
        core: Core to stay on; None takes the first one allowed.
        peers: Run the same scenes with Newton's VBD, if it is installed.
        said: Told about progress.
    """
    with one_core(core):
        said("accordion")
        with_contact = accordion(nodes, layers, device="cpu", threads=1)
        scenes = [_scene("accordion", nodes, with_contact, accordion(nodes, layers, False, device="cpu", threads=1))]
        said("phases")
        pairs, phases = _phases(with_contact, repeats)
        said("apart")
        scenes.append(_scene("apart", nodes, apart(nodes, True), apart(nodes, False)))
        if peers and importlib.util.find_spec("newton"):
            from warpdeform.study.peers.contact import newton_accordion, newton_apart

            for name, build in (("accordion", newton_accordion(nodes, layers)), ("apart", newton_apart(nodes))):
                said(f"{name}, Newton's VBD")
                scenes.append(_peer(name, nodes, build))
    targets = tuple(
        Target(f"{s.scene}, {s.nodes} x {s.nodes}", "of the step without", s.ratio, LIMITS[s.scene])
        for s in scenes
        if s.engine == "ours"
    )
    return ContactTimes(describe(), nodes, layers, pairs, phases, tuple(scenes), targets)


def apart(nodes: int, self_contact: bool) -> Simulation:
    """A sheet that hangs by two corners and touches nothing."""
    pins = (Pin("corner:0,0"), Pin("corner:0,1"))
    body = Body("sheet", sheet((nodes, nodes), (1.0, 1.0)), CLOTH, pins=pins, self_contact=self_contact)
    return Simulation([body], settings=Settings(substeps=SUBSTEPS, device="cpu", threads=1))


def _scene(name: str, nodes: int, with_contact: Simulation, without: Simulation) -> SceneTime:
    """Both run the same frames, in turns, so that what else the machine does falls on both; the last ones count."""
    frames = [[_seconds(each.advance_frame) for each in (with_contact, without)] for _ in range(SETTLED + MEASURED)]
    ms_with, ms_without = (1e3 * float(each) for each in np.median(frames[SETTLED:], axis=0))
    body, record = with_contact.bodies[0], with_contact.record().contact
    assert record is not None
    crossings = len(crossing_pairs(body.positions().reshape(-1, 3), Simplices.of_grid(body.model.grid)))
    return SceneTime(name, "ours", nodes, ms_with, ms_without, crossings, record.pairs, record.guard_active)


def _peer(name: str, nodes: int, build: Callable[[bool], Any]) -> SceneTime:
    """The same with another engine; frames until it has settled are not timed."""
    times, last = [], np.zeros((0, 3))
    for self_contact in (True, False):
        session = build(self_contact)
        for _ in range(SETTLED):
            session.advance_frame()
        times.append(1e3 * float(np.median([_seconds(session.advance_frame) for _ in range(MEASURED)])))
        last = session.positions().reshape(-1, 3) if self_contact else last
    simplices = Simplices.of_grid(sheet((nodes, nodes)).grid)
    return SceneTime(name, "newton-vbd", nodes, times[0], times[1], len(crossing_pairs(last, simplices)))


def _phases(simulation: Simulation, repeats: int) -> tuple[int, tuple[PhaseTime, ...]]:
    """Each phase as a recording of its own, at the state of the simulation."""
    system = simulation.contact
    assert system is not None
    slots = system.slots
    for state in system.states:
        state.z.assign(state.x)
        state.direction.assign(state.v)
        state.direction.assign(state.direction.numpy() * simulation.dt)
        state.search.assign(state.v)
    system.begin()
    system.reset()
    system.linearise("z")
    pairs, nodes = int(system.list.counts.numpy()[0]), simulation.record().nodes

    def refit() -> None:
        slots.gather("z", slots.points)
        slots.fit()

    def energy() -> None:
        system.add_energy("z")

    phases: Sequence[tuple[str, Callable[[], None]]] = (
        ("refit", refit),
        ("search", system.search),
        ("narrow phase", system.narrow),
        ("energy", energy),
        ("gradient", lambda: system.add_gradient("z", "gradient")),
        ("Hessian product", lambda: system.add_hessian_product("search", "product")),
        ("guard", lambda: system.guard("z", "direction")),
    )
    kept = [state.direction.numpy() for state in system.states]
    found = []
    for name, launch in phases:
        with wp.ScopedCapture(device=slots.device) as capture:
            launch()
        least = np.inf
        for _ in range(repeats):
            for state, direction in zip(system.states, kept, strict=True):
                state.direction.assign(direction)
            least = min(least, _seconds(lambda graph=capture.graph: wp.capture_launch(graph)))  # type: ignore[misc]
        found.append(PhaseTime(name, 1e9 * least / nodes, 1e9 * least / max(pairs, 1)))
    return pairs, tuple(found)


def _seconds(run: Callable[[], Any]) -> float:
    """CPU time."""
    started = time.process_time()
    run()
    return time.process_time() - started
