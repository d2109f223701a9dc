"""`bench threads`: what further threads make of a step, and whether the results stay the same to the bit."""

import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from warpdeform.scene import Override
from warpdeform.scene.play import simulation_of
from warpdeform.simulation import Simulation
from warpdeform.study.bench.machine import describe
from warpdeform.study.bench.runs import scene_of
from warpdeform.study.bench.table import Target, table, targets_lines, three_digits

LIMIT_AT, LEAST_GAIN = 512, 1.5
"""Nodes along a side at which two threads have to be so many times as fast as one."""
_HEADER = ("sheet", "threads", "ms per step, min", "median", "times as fast, median", "same bits")


@dataclass(frozen=True)
class ThreadTime:
    """Steps of a scene on some threads.

    Attributes:
        nodes: Nodes along each side.
        threads: Threads.
        fastest_ms: Wall time of a step [ms], minimum over the rounds.
        median_ms: The same, median.
        gain: Time of one thread over this, median over the rounds, which are taken in turn.
        same: Whether positions and velocities at the end are those of one thread, to the bit.
    """

    nodes: int
    threads: int
    fastest_ms: float
    median_ms: float
    gain: float
    same: bool


@dataclass(frozen=True)
class ThreadTimes:
    """The result of `bench threads`."""

    machine: dict[str, Any]
    scene: str
    runs: tuple[ThreadTime, ...]
    targets: tuple[Target, ...]

    def as_dict(self) -> dict[str, Any]:
        """The result as plain numbers, strings, lists and dicts."""
        return asdict(self)

    def lines(self) -> list[str]:
        """The table as people read it."""
        return [f"{self.scene}, float32, wall time", "", *table(_HEADER, [_row(run) for run in self.runs]), "",
                *targets_lines(self.targets)]  # fmt: skip


def bench_threads(
    sizes: Sequence[int],
    threads: Sequence[int],
    *,
    scene: str = "hanging",
    steps: int = 4,
    repeats: int = 5,
    overrides: Iterable[Override] = (),
    said: Callable[[str], None] = lambda line: None,
) -> ThreadTimes:
    """Time the first steps of a scene, on one thread and on more, round after round.

    Args:
        sizes: Nodes along each side of the first body.
        threads: Numbers of threads beside one.
        scene: Name or path of the scene.
        steps: Steps of a round.
        repeats: Rounds.
        overrides: Further values of the scene file.
        said: Told about progress.

    Raises:
        InputError: The scene or an override is not in order.
    """
    overrides = list(overrides)
    found: list[ThreadTime] = []
    for nodes in sizes:
        said(f"{nodes} x {nodes}")
        counts = sorted({1, *threads})
        built = [scene_of(scene, nodes, {"solver.threads": n, "solver.device": "cpu"}, overrides) for n in counts]
        simulations = [simulation_of(each) for each in built]
        rounds = [[_seconds(each, steps) / steps for each in simulations] for _ in range(repeats + 1)][1:]
        states = [_state(each) for each in simulations]
        for index, count in enumerate(counts):
            own = [1e3 * times[index] for times in rounds]
            gain = statistics.median(times[0] / times[index] for times in rounds)
            same = bool(np.array_equal(states[0], states[index]))
            found.append(ThreadTime(nodes, count, min(own), statistics.median(own), gain, same))
    targets = [
        Target(f"{run.nodes} x {run.nodes}, {run.threads} threads", "of the time of one", 1 / run.gain, 1 / LEAST_GAIN)
        for run in found
        if run.nodes == LIMIT_AT and run.threads == 2
    ]
    return ThreadTimes(describe(), scene, tuple(found), tuple(targets))


def _seconds(simulation: Simulation, steps: int) -> float:
    simulation.reset()
    start = time.perf_counter()
    for _ in range(steps):
        simulation.step()
    return time.perf_counter() - start


def _state(simulation: Simulation) -> Any:
    return np.concatenate([np.ravel((body.positions(), body.velocities())) for body in simulation.bodies])


def _row(run: ThreadTime) -> list[str]:
    numbers = (three_digits(run.fastest_ms), three_digits(run.median_ms), f"{run.gain:.2f}")
    return [f"{run.nodes} x {run.nodes}", str(run.threads), *numbers, "yes" if run.same else "NO"]
