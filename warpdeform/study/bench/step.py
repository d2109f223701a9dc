"""`bench step`: what a simulated second of a scene costs, on one core."""

import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from warpdeform.device import find_device
from warpdeform.scene import Override
from warpdeform.scene.play import simulation_of
from warpdeform.study.bench.machine import core_for, describe
from warpdeform.study.bench.run_traffic import copy_bandwidth, run_traffic
from warpdeform.study.bench.runs import Runs, scene_of, time_runs
from warpdeform.study.bench.table import Target, table, targets_lines, three_digits

SCENE = "hanging"
REAL_TIME_NODES = 64
"""Nodes along each side of the sheet that should run in real time with one Newton iteration per step."""
MOST_BYTES = 1000.0
"""Device memory that a node may take [bytes], in sheets of at least LIMITS_FROM nodes along each side."""
LIMITS_FROM = 32
SIZES = {"cpu": (32, 64, 128), "cuda": (64, 128, 256, 512, 1024, 2048)}
"""Nodes along each side, where none are asked for."""
_HEADER = (
    "grid", "Newton per step", "s per s, min", "s per s, median", "wall s per s", "ms per step",
    "Newton", "CG", "CG capped", "ns/node/CG", "bytes/node", "GB/s", "share of copy",
)  # fmt: skip


@dataclass(frozen=True)
class StepTime:
    """What a scene costs on one grid.

    Attributes:
        nodes: Nodes along each side.
        grid: Nodes along each axis of the first body, the last of curves counting strands.
        newton: Newton iterations per step that the solver was asked for; 0 iterates to a tolerance.
        sim_s: Simulated time [s].
        steps: Time steps.
        fastest: CPU seconds per simulated second, minimum over the repeats; wall seconds on CUDA.
        median: The same, median.
        wall: Wall seconds per simulated second, median.
        ms_per_step: CPU time per step [ms], median; wall time on CUDA.
        newton_iterations: Newton iterations of a run.
        cg_iterations: Conjugate gradient iterations of a run.
        cg_capped: Linear solves of a run that reached their cap.
        ns_per_node_per_cg: Time of the whole run over nodes and conjugate gradient iterations [ns], median.
        bytes_per_node: Device memory [bytes].
        gb_per_s: Compulsory traffic of the launches over the median time; None where it cannot be counted.
        share_of_copy: The same over the bandwidth of copies in device memory; caches can lift it above 1.
    """

    nodes: int
    grid: str
    newton: int
    sim_s: float
    steps: int
    fastest: float
    median: float
    wall: float
    ms_per_step: float
    newton_iterations: int
    cg_iterations: int
    cg_capped: int
    ns_per_node_per_cg: float
    bytes_per_node: float
    gb_per_s: float | None
    share_of_copy: float | None


@dataclass(frozen=True)
class StepTimes:
    """The result of `bench step`; `copy_gb_per_s` is the bandwidth of copies in device memory."""

    machine: dict[str, Any]
    scene: str
    device: str
    precision: str
    core: int | None
    repeats: int
    copy_gb_per_s: float
    runs: tuple[StepTime, ...]
    targets: tuple[Target, ...]

    def as_dict(self) -> dict[str, Any]:
        """The result as plain numbers, strings, lists and dicts."""
        return asdict(self)

    def lines(self) -> list[str]:
        """The table as people read it."""
        where = f"{self.device}, one core" if self.core is not None else self.device
        rows = [_row(run) for run in self.runs]
        clock = "CPU" if self.device == "cpu" else "wall"
        head = f"{self.scene}, {self.precision}, {where}: {clock} seconds per simulated second, {self.repeats} runs"
        memory = f"copies in device memory: {self.copy_gb_per_s:.1f} GB/s"
        return [head, memory, "", *table(_HEADER, rows), "", *targets_lines(self.targets)]


def bench_step(
    sizes: Sequence[int] | None = None,
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
        sizes: Nodes along each side of the first body; None takes those of SIZES for the device.
        newton: Newton iterations per step, one table row each.
        scene: Name or path of the scene.
        precision: "float32" or "float64".
        device: Warp device.
        repeats: Runs that count, after one step that warms up.
        core: Core to stay on; None takes the first one allowed.
        overrides: Further values of the scene file.
        said: Told about progress.

    Raises:
        InputError: The scene, device or an override is not in order.
    """
    machine, overrides, found = describe(), list(overrides), find_device(device)
    sizes = sizes or SIZES["cuda" if found.is_cuda else "cpu"]
    values = {"solver.precision": precision, "solver.device": str(found)}
    scenes = [
        (nodes, iterations, scene_of(scene, nodes, {**values, "solver.newton_iterations": iterations}, overrides))
        for nodes in sizes
        for iterations in newton
    ]
    times: list[StepTime] = []
    with core_for(found, core) as chosen:
        said("copies in device memory")
        copies = copy_bandwidth(found)
        for nodes, iterations, built in scenes:
            grid = " x ".join(map(str, built.bodies[0].nodes))
            said(f"{grid}, {iterations} Newton iterations per step")
            steps = (built.frames - 1) * built.settings.substeps
            traffic = run_traffic(built, steps)
            runs = time_runs(simulation_of(built), steps, repeats=repeats)
            times.append(_summary(runs, nodes, grid, iterations, traffic, copies))
    targets = _targets(times, scene, str(found))
    return StepTimes(machine, scene, str(found), precision, chosen, repeats, copies, tuple(times), targets)


def _summary(runs: Runs, nodes: int, grid: str, newton: int, traffic: float | None, copies: float) -> StepTime:
    median = statistics.median(runs.seconds)
    gb_per_s = 1e-9 * traffic / median if traffic is not None else None
    return StepTime(
        nodes=nodes,
        grid=grid,
        newton=newton,
        sim_s=runs.sim_s,
        steps=runs.steps,
        fastest=min(runs.seconds) / runs.sim_s,
        median=median / runs.sim_s,
        wall=statistics.median(runs.wall) / runs.sim_s,
        ms_per_step=1e3 * median / runs.steps,
        newton_iterations=runs.newton_iterations,
        cg_iterations=runs.cg_iterations,
        cg_capped=runs.cg_capped,
        ns_per_node_per_cg=1e9 * median / runs.nodes / max(runs.cg_iterations, 1),
        bytes_per_node=runs.bytes_per_node,
        gb_per_s=gb_per_s,
        share_of_copy=gb_per_s / copies if gb_per_s is not None else None,
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
    numbers = (run.fastest, run.median, run.wall, run.ms_per_step)
    return [
        run.grid,
        str(run.newton) if run.newton else "to tolerance",
        *map(three_digits, numbers),
        str(run.newton_iterations),
        str(run.cg_iterations),
        str(run.cg_capped),
        f"{run.ns_per_node_per_cg:.1f}",
        f"{run.bytes_per_node:.0f}",
        f"{run.gb_per_s:.1f}" if run.gb_per_s is not None else "-",
        f"{run.share_of_copy:.0%}" if run.share_of_copy is not None else "-",
    ]
