"""`bench step`: what a simulated second of a scene costs, on one core."""

import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from warpdeform.scene import Override, load_scene
from warpdeform.scene.play import simulation_of
from warpdeform.simulation import Simulation
from warpdeform.study.bench.machine import describe, one_core
from warpdeform.study.bench.table import Target, table, targets_lines

SCENE = "hanging"
REAL_TIME_NODES = 64
"""Nodes along each side of the sheet that should run in real time with one Newton iteration per step."""
MOST_BYTES = 1000.0
"""Device memory that a node may take [bytes], in sheets of at least LIMITS_FROM nodes along each side."""
LIMITS_FROM = 32
_HEADER = (
    "sheet", "Newton per step", "s per s, min", "s per s, median", "ms per frame", "wall s per s",
    "Newton", "CG", "CG capped", "ns/node/CG", "bytes/node",
)  # fmt: skip


@dataclass(frozen=True)
class StepTime:
    """What a scene costs on one grid.

    Attributes:
        nodes: Nodes along each side.
        newton: Newton iterations per step that the solver was asked for; 0 iterates to a tolerance.
        sim_s: Simulated time [s].
        steps: Time steps.
        fastest: CPU seconds per simulated second, minimum over the repeats; wall seconds on CUDA.
        median: The same, median.
        wall: Wall seconds per simulated second, median.
        ms_per_frame: CPU time per frame [ms], median.
        newton_iterations: Newton iterations of a run.
        cg_iterations: Conjugate gradient iterations of a run.
        cg_capped: Linear solves of a run that reached their cap.
        ns_per_node_per_cg: Time of the whole run over nodes and conjugate gradient iterations [ns], median.
        bytes_per_node: Device memory [bytes].
    """

    nodes: int
    newton: int
    sim_s: float
    steps: int
    fastest: float
    median: float
    wall: float
    ms_per_frame: float
    newton_iterations: int
    cg_iterations: int
    cg_capped: int
    ns_per_node_per_cg: float
    bytes_per_node: float


@dataclass(frozen=True)
class StepTimes:
    """The result of `bench step`."""

    machine: dict[str, Any]
    scene: str
    device: str
    precision: str
    core: int | None
    repeats: int
    runs: tuple[StepTime, ...]
    targets: tuple[Target, ...]

    def as_dict(self) -> dict[str, Any]:
        """The result as plain numbers, strings, lists and dicts."""
        return asdict(self)

    def lines(self) -> list[str]:
        """The table as people read it."""
        where = f"{self.device}, one core" if self.core is not None else self.device
        rows = [_row(run) for run in self.runs]
        head = f"{self.scene}, {self.precision}, {where}: CPU seconds per simulated second, {self.repeats} runs"
        return [head, "", *table(_HEADER, rows), "", *targets_lines(self.targets)]


def bench_step(
    sizes: Sequence[int],
    *,
    newton: Sequence[int] = (1, 2),
    scene: str = SCENE,
    precision: str = "float32",
    device: str = "cpu",
    repeats: int = 5,
    core: int | None = None,
    overrides: Iterable[Override] = (),
    said: Callable[[str], None] = lambda line: None,
) -> StepTimes:
    """Run a scene over and over.

    Args:
        sizes: Nodes along each side of the first body.
        newton: Newton iterations per step, one table row each.
        scene: Name or path of the scene.
        precision: "float32" or "float64".
        device: Warp device.
        repeats: Runs that count, after one that warms up.
        core: Core to stay on; None takes the first one allowed.
        overrides: Further values of the scene file.
        said: Told about progress.

    Raises:
        InputError: The scene, device or an override is not in order.
    """
    machine, overrides = describe(), list(overrides)
    runs: list[StepTime] = []
    found = ""
    with one_core(core) as chosen:
        for nodes in sizes:
            for iterations in newton:
                said(f"{nodes} x {nodes}, {iterations} Newton iterations per step")
                values = {
                    "body.0.nodes": [nodes, nodes],
                    "solver.newton_iterations": iterations,
                    "solver.precision": precision,
                    "solver.device": device,
                }
                built = load_scene(scene, [Override(key, value) for key, value in values.items()] + overrides)
                simulation = simulation_of(built)
                found = str(simulation.device)
                runs.append(_run(simulation, built.frames - 1, nodes, iterations, repeats))
    return StepTimes(machine, scene, found, precision, chosen, repeats, tuple(runs), _targets(runs, scene, found))


def _run(simulation: Simulation, frames: int, nodes: int, newton: int, repeats: int) -> StepTime:
    clock = time.perf_counter if simulation.device.is_cuda else time.process_time
    spent, wall = [], []
    for repeat in range(repeats + 1):
        simulation.reset()
        start, start_wall = clock(), time.perf_counter()
        for _ in range(frames):
            simulation.advance_frame()
        if repeat:  # the first run warms up
            spent.append(clock() - start)
            wall.append(time.perf_counter() - start_wall)
    record, info = simulation.record(), simulation.info()
    median = statistics.median(spent)
    return StepTime(
        nodes=nodes,
        newton=newton,
        sim_s=record.sim_s,
        steps=frames * simulation.settings.substeps,
        fastest=min(spent) / record.sim_s,
        median=median / record.sim_s,
        wall=statistics.median(wall) / record.sim_s,
        ms_per_frame=1e3 * median / frames,
        newton_iterations=record.newton_iterations,
        cg_iterations=record.cg_iterations,
        cg_capped=record.cg_capped,
        ns_per_node_per_cg=1e9 * median / record.nodes / max(record.cg_iterations, 1),
        bytes_per_node=info.bytes_total / record.nodes,
    )


def _targets(runs: Sequence[StepTime], scene: str, device: str) -> tuple[Target, ...]:
    if scene != SCENE or device != "cpu":
        return ()
    targets = []
    for run in runs:
        where = f"{scene}, {run.nodes} x {run.nodes}, {run.newton} Newton"
        if run.nodes == REAL_TIME_NODES and run.newton == 1:
            targets.append(Target(where, "CPU s per simulated s, median", run.median, 1.0))
        if run.nodes >= LIMITS_FROM:
            targets.append(Target(where, "bytes per node", run.bytes_per_node, MOST_BYTES))
    return tuple(targets)


def _row(run: StepTime) -> list[str]:
    numbers = (run.fastest, run.median, run.ms_per_frame, run.wall)
    return [
        f"{run.nodes} x {run.nodes}",
        str(run.newton) if run.newton else "to tolerance",
        *(f"{number:.3g}" for number in numbers),
        str(run.newton_iterations),
        str(run.cg_iterations),
        str(run.cg_capped),
        f"{run.ns_per_node_per_cg:.1f}",
        f"{run.bytes_per_node:.0f}",
    ]
