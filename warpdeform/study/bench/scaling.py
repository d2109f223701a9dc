"""`bench scaling`: how the cost of a scene grows with the number of its nodes."""

import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from warpdeform.device import find_device
from warpdeform.scene import Override
from warpdeform.scene.play import simulation_of
from warpdeform.study.bench.machine import core_for, describe
from warpdeform.study.bench.runs import Runs, scene_of, time_runs
from warpdeform.study.bench.table import Target, table, targets_lines, three_digits

REFERENCE = 64
"""Nodes along each side of the sheet whose cost per node the others are compared with."""
LARGEST, MOST_GROWTH = 1024, 1.5
"""The sheet that may cost at most so many times as much per node and step as the reference."""
LEAST_S = 2.0
"""Small sheets run again until they have been timed this long in all [s]."""
_HEADER = (
    "sheet", "runs", "steps", "s per s, min", "s per s, median", "Newton/step", "CG/step", "CG capped",
    "ns/node/step", "x 64 x 64", "ns/node/CG", "bytes/node",
)  # fmt: skip


@dataclass(frozen=True)
class SizeCost:
    """What a scene costs on one grid.

    Attributes:
        side: Nodes along each side of the first body.
        nodes: Nodes of all bodies.
        runs: Runs that were timed.
        steps: Time steps of a run.
        fastest: CPU seconds per simulated second, minimum over the runs; wall seconds on CUDA.
        median: The same, median.
        newton_per_step: Newton iterations per step.
        cg_per_step: Conjugate gradient iterations per step, all Newton iterations together.
        cg_capped: Linear solves of a run that reached their cap.
        ns_per_node_per_step: Median time over nodes and steps [ns].
        growth: Ratio of that to the reference; None where the reference was not run.
        ns_per_node_per_cg: Median time over nodes and conjugate gradient iterations [ns].
        bytes_per_node: Device memory [bytes].
    """

    side: int
    nodes: int
    runs: int
    steps: int
    fastest: float
    median: float
    newton_per_step: float
    cg_per_step: float
    cg_capped: int
    ns_per_node_per_step: float
    growth: float | None
    ns_per_node_per_cg: float
    bytes_per_node: float


@dataclass(frozen=True)
class Scaling:
    """The result of `bench scaling`; `duration` is the simulated time of a run [s]."""

    machine: dict[str, Any]
    scene: str
    device: str
    precision: str
    core: int | None
    duration: float
    sizes: tuple[SizeCost, ...]
    targets: tuple[Target, ...]

    def as_dict(self) -> dict[str, Any]:
        """The result as plain numbers, strings, lists and dicts."""
        return asdict(self)

    def heading(self) -> str:
        """What was run, in one line."""
        where = f"{self.device}, one core" if self.core is not None else self.device
        return f"{self.scene}, {self.precision}, {where}: the first {self.duration:g} s"

    def lines(self) -> list[str]:
        """The table as people read it."""
        return [
            self.heading(),
            "",
            *table(_HEADER, [_row(size) for size in self.sizes]),
            "",
            *targets_lines(self.targets),
        ]


def bench_scaling(
    sizes: Sequence[int],
    *,
    scene: str = "hanging",
    duration: float = 0.5,
    precision: str = "float32",
    device: str = "cpu",
    core: int | None = None,
    overrides: Iterable[Override] = (),
    said: Callable[[str], None] = lambda line: None,
) -> Scaling:
    """Run a scene on finer and finer grids, each for the same simulated time.

    Args:
        sizes: Nodes along each side of the first body.
        scene: Name or path of the scene.
        duration: Simulated time from the start [s].
        precision: "float32" or "float64".
        device: Warp device.
        core: Core to stay on; None takes the first one allowed.
        overrides: Further values of the scene file.
        said: Told about progress.

    Raises:
        InputError: The scene, device or an override is not in order.
    """
    machine, overrides, found = describe(), list(overrides), find_device(device)
    values = {"scene.duration": duration, "solver.precision": precision, "solver.device": str(found)}
    scenes = {side: scene_of(scene, side, values, overrides) for side in sizes}
    runs: dict[int, Runs] = {}
    with core_for(found, core) as chosen:
        for side, built in scenes.items():
            said(f"{side} x {side}")
            steps = (built.frames - 1) * built.settings.substeps
            runs[side] = time_runs(simulation_of(built), steps, repeats=1, least_s=LEAST_S)
    reference = _cost(runs[REFERENCE]) if REFERENCE in runs else None
    costs = tuple(_summary(side, own, reference) for side, own in runs.items())
    return Scaling(machine, scene, str(found), precision, chosen, duration, costs, _targets(costs, scene))


def _cost(runs: Runs) -> float:
    """Time per node and step [ns]."""
    return 1e9 * statistics.median(runs.seconds) / (runs.nodes * runs.steps)


def _summary(side: int, runs: Runs, reference: float | None) -> SizeCost:
    median = statistics.median(runs.seconds)
    return SizeCost(
        side=side,
        nodes=runs.nodes,
        runs=len(runs.seconds),
        steps=runs.steps,
        fastest=min(runs.seconds) / runs.sim_s,
        median=median / runs.sim_s,
        newton_per_step=runs.newton_iterations / runs.steps,
        cg_per_step=runs.cg_iterations / runs.steps,
        cg_capped=runs.cg_capped,
        ns_per_node_per_step=_cost(runs),
        growth=_cost(runs) / reference if reference else None,
        ns_per_node_per_cg=1e9 * median / runs.nodes / max(runs.cg_iterations, 1),
        bytes_per_node=runs.bytes_per_node,
    )


def _targets(costs: Sequence[SizeCost], scene: str) -> tuple[Target, ...]:
    where = f"{scene}, {LARGEST} x {LARGEST} over {REFERENCE} x {REFERENCE}"
    unit = "times the cost per node and step"
    return tuple(
        Target(where, unit, cost.growth, MOST_GROWTH)
        for cost in costs
        if cost.side == LARGEST and cost.growth is not None
    )


def _row(cost: SizeCost) -> list[str]:
    return [
        f"{cost.side} x {cost.side}",
        str(cost.runs),
        str(cost.steps),
        three_digits(cost.fastest),
        three_digits(cost.median),
        f"{cost.newton_per_step:.1f}",
        f"{cost.cg_per_step:.1f}",
        str(cost.cg_capped),
        f"{cost.ns_per_node_per_step:.0f}",
        f"{cost.growth:.2f}" if cost.growth is not None else "-",
        f"{cost.ns_per_node_per_cg:.1f}",
        f"{cost.bytes_per_node:.0f}",
    ]
