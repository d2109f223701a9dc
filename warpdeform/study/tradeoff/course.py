"""Runs of a scene under a setting: where its nodes go, what can be said of that at any time, and what it costs."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.body import Body
from warpdeform.errors import SimulationFailure
from warpdeform.result import RunRecord
from warpdeform.scene import BuiltScene, Override, load_scene
from warpdeform.scene.play import simulation_of
from warpdeform.selectors import select_nodes
from warpdeform.simulation import Simulation
from warpdeform.study.errors import block_averages
from warpdeform.study.tradeoff.ladder import Setting

Array = NDArray[np.float64]

ENOUGH_S = 3.0
"""Repeats end when they took this long in all [s]."""
RIPPLE = 0.2
"""Turning back by less than this share of the whole way is no swing."""
FEW_NODES = 3
"""Axes of no more nodes keep them on coarser grids."""


@dataclass(frozen=True)
class Asked:
    """A scene, and what is changed of it whatever the setting.

    Attributes:
        scene: Name or path.
        overrides: Values of its file.
        device: Warp device.
    """

    scene: str
    overrides: tuple[Override, ...] = ()
    device: str = "cpu"

    def under(self, setting: Setting) -> BuiltScene:
        """The scene under a setting.

        Raises:
            InputError: The setting does not suit the scene.
        """
        fixed = [Override("solver.device", self.device, "--device"), Override("solver.threads", 1, "the study")]
        values = [Override(f"solver.{key}", value, "the study") for key, value in setting.values.items()]
        built = load_scene(self.scene, [*self.overrides, *fixed, *values])
        if setting.grid == 1.0:
            return built
        grids = [Override(f"body.{k}.nodes", _grid(b, setting.grid), "the study") for k, b in enumerate(built.bodies)]
        return load_scene(self.scene, [*self.overrides, *fixed, *values, *grids])


def _grid(body: Body, factor: float) -> list[int]:
    """Nodes along each connected axis of a body with so many times the cells."""
    dimension, periodic = body.shape.grid.dimension, body.shape.grid.periodic
    counts = []
    for count, wraps in list(zip(body.nodes, periodic, strict=True))[:dimension]:
        cells = count if wraps else count - 1
        finer = max(2 * round(0.5 * factor * cells) if wraps else round(factor * cells), 1)
        counts.append(count if count <= FEW_NODES else finer if wraps else finer + 1)
    return counts


@dataclass
class Course:
    """How a run went, frame by frame.

    Attributes:
        positions: Node positions of each body at each frame [m].
        energies: Kinetic and potential energy less the work done on the bodies since the start [J].
        lowest: Lowest point of any frame [m].
        record: Statistics of the whole run.
        trouble: Why it ended early; empty if it did not.
    """

    positions: list[list[Array]] = field(default_factory=list)
    energies: list[float] = field(default_factory=list)
    lowest: float = np.inf
    record: RunRecord = field(default_factory=RunRecord)
    trouble: str = ""

    def period(self) -> float | None:
        """Frames that the swing of the centre of the nodes takes, there and back; None if it turns less than twice.

        Turning points are the extrema of its way along its principal direction, by parabolas through three frames; the
        start is none, for bodies may be thrown.
        """
        ways = np.array(
            [np.mean(np.concatenate([x.reshape(-1, 3) for x in frame]), axis=0) for frame in self.positions]
        )
        ways = ways - ways.mean(axis=0)
        way = ways @ np.linalg.svd(ways, full_matrices=False)[2][0]
        turns = _turns(way)
        before, now, after = way[turns - 1], way[turns], way[turns + 1]
        times = turns + 0.5 * (before - after) / (before - 2.0 * now + after)
        return float(2.0 * np.mean(np.diff(times))) if len(times) > 1 else None


def _turns(way: Array) -> NDArray[np.int64]:
    """Where a way turns back by more than `RIPPLE` of its range, ends left out."""
    least, kept, ahead = RIPPLE * np.ptp(way), [0], 0
    for k in range(1, len(way)):
        outward = np.sign(way[ahead] - way[kept[-1]])
        if outward * (way[k] - way[ahead]) >= 0.0:
            ahead = k
        elif abs(way[k] - way[ahead]) > least:
            kept.append(ahead)
            ahead = k
    return np.array(kept[1:], dtype=np.int64)


def observe(scene: BuiltScene, frames: int, noise: float = 0.0) -> Course:
    """Run a scene and keep its frames.

    Args:
        scene: The scene.
        frames: Frames after the first.
        noise: Root mean square distance that nodes which are not held start off by [m].

    Raises:
        InputError: The method cannot run the scene.
    """
    if noise:
        bodies = tuple(_disturbed(body, noise, seed) for seed, body in enumerate(scene.bodies))
        scene = replace(scene, bodies=bodies)
    simulation, course = simulation_of(scene), Course()
    up = -np.asarray(simulation.gravity) if any(simulation.gravity) else np.array([0.0, 0.0, 1.0])
    up /= np.linalg.norm(up)
    for frame in range(frames + 1):
        try:
            if frame:
                simulation.advance_frame()
        except SimulationFailure as failure:
            course.trouble = str(failure)
            break
        course.positions.append([body.positions() for body in simulation.bodies])
        course.lowest = min(course.lowest, *(float((x @ up).min()) for x in course.positions[-1]))
        energy = simulation.record().energy
        course.energies.append(energy.kinetic + energy.elastic + energy.gravity + energy.field - energy.work_in)
    course.record = simulation.record()
    return course


def _disturbed(body: Body, noise: float, seed: int) -> Body:
    start = body.placed_positions()
    apart = np.random.default_rng(seed).normal(size=start.shape) * noise / np.sqrt(3.0)
    for pin in body.pins:
        apart[tuple(select_nodes(pin.nodes, body.nodes, body.kind).T)] = 0.0
    return replace(body, initial_positions=start + apart)


def seconds_per_second(scene: BuiltScene, frames: int, repeats: int) -> float:
    """CPU seconds per simulated second, the least of some runs after one frame that warms up; wall seconds on CUDA."""
    simulation = simulation_of(scene)
    device = simulation.device
    clock = time.perf_counter if device.is_cuda else time.process_time
    simulation.advance_frame()
    taken: list[float] = []
    while not taken or (len(taken) < repeats and sum(taken) < ENOUGH_S):
        simulation.reset()
        wp.synchronize_device(device)
        start = clock()
        _advance(simulation, frames)
        wp.synchronize_device(device)
        taken.append(clock() - start)
    return min(taken) * scene.settings.fps / frames


def _advance(simulation: Simulation, frames: int) -> None:
    for _ in range(frames):
        simulation.advance_frame()


@dataclass(frozen=True)
class Apart:
    """How far the bodies of two runs are apart at a frame [m].

    Attributes:
        block: Block-averaged (c4).
        rms: Root mean square of the node distances; NaN where neither grid is part of the other.
    """

    block: float
    rms: float


def apart(found: Sequence[Array], expected: Sequence[Array], bodies: Sequence[Body]) -> Apart:
    """How far bodies are from where they should be; bodies of one frame each, whose grids may differ."""
    blocks, nodes = [], []
    for x, y, body in zip(found, expected, bodies, strict=True):
        axes = body.shape.grid.dimension
        fine, coarse = (x, y) if x.size > y.size else (y, x)
        blocks.append((block_averages(fine, axes) - block_averages(_on_grid_of(coarse, fine), axes)).reshape(-1, 3))
        nodes.append((_at_nodes_of(fine, coarse) - coarse).reshape(-1, 3))
    return Apart(*(float(np.sqrt(np.mean(np.sum(np.concatenate(d) ** 2, axis=-1)))) for d in (blocks, nodes)))


def _on_grid_of(coarse: Array, fine: Array) -> Array:
    """Positions interpolated to the nodes of a finer grid, linearly along each axis."""
    for axis, count in enumerate(fine.shape[:-1]):
        had = coarse.shape[axis]
        if count != had:
            place = np.linspace(0.0, had - 1.0, count)
            lower = np.minimum(place.astype(int), had - 2)
            share = np.expand_dims(place - lower, tuple(range(1, coarse.ndim)))
            along = np.moveaxis(coarse, axis, 0)
            coarse = np.moveaxis((1.0 - share) * along[lower] + share * along[lower + 1], 0, axis)
    return coarse


def _at_nodes_of(fine: Array, coarse: Array) -> Array:
    """Positions at the nodes of a coarser grid, or NaN where it is not part of the fine one."""
    steps = [(n - 1) / (m - 1) if m > 1 else 1.0 for n, m in zip(fine.shape[:-1], coarse.shape[:-1], strict=True)]
    if any(step != round(step) for step in steps):
        return np.full_like(coarse, np.nan)
    return fine[tuple(slice(None, None, round(step)) for step in steps)]
