"""Runs of a scene under the clock: what stepping costs, without the record's stretch, pictures or files."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import warp as wp

from warpdeform.errors import InputError, Mistake
from warpdeform.scene import Override, load_scene
from warpdeform.scene.build import BuiltScene
from warpdeform.simulation import Simulation
from warpdeform.study.bench.machine import clock_of


@dataclass(frozen=True)
class Runs:
    """Equal runs of one simulation.

    Attributes:
        seconds: CPU time of each run [s], of all threads; wall time on CUDA.
        wall: Wall time of each run [s].
        sim_s: Simulated time of a run [s].
        steps: Time steps of a run.
        nodes: Nodes of all bodies.
        newton_iterations: Newton iterations of a run.
        cg_iterations: Conjugate gradient iterations of a run.
        cg_capped: Linear solves of a run that reached their cap.
        bytes_per_node: Device memory [bytes].
    """

    seconds: tuple[float, ...]
    wall: tuple[float, ...]
    sim_s: float
    steps: int
    nodes: int
    newton_iterations: int
    cg_iterations: int
    cg_capped: int
    bytes_per_node: float


def scene_of(
    scene: str, nodes: int, values: dict[str, object], overrides: Sequence[Override], *, keep_aspect: bool = False
) -> BuiltScene:
    """A scene with so many nodes along each side of its first body.

    Args:
        scene: Name or path.
        nodes: Nodes along each side.
        keep_aspect: They are those of the longer side; the other has as many fewer as in the scene.
        values: Values that the benchmark sets by options of its own.
        overrides: Further ones.

    Raises:
        InputError: The scene is not in order, or an override is not, or sets what the benchmark sets.
    """
    first = load_scene(scene).bodies[0]
    own = first.nodes[: first.shape.dimension]
    counts = [nodes] * len(own)
    if keep_aspect:
        counts = [max(2, 1 + round((nodes - 1) * (n - 1) / (max(own) - 1))) for n in own]
    values = {"body.0.nodes": counts, **values}
    twice = [override for override in overrides if override.key in values]
    if twice:
        remedy = "Use --sizes, or the option of that name."
        raise InputError([Mistake(f"--set {o.key}", o.value, "is set by the benchmark", remedy) for o in twice])
    return load_scene(scene, [*(Override(key, value) for key, value in values.items()), *overrides])


def time_runs(simulation: Simulation, steps: int, *, repeats: int, least_s: float = 0.0) -> Runs:
    """Run a simulation over and over, after one step that warms up.

    The clock is read only when the device has finished.

    Args:
        simulation: The simulation.
        steps: Time steps of a run.
        repeats: Runs.
        least_s: Run on until the runs took this long in all [s].
    """
    simulation.step()
    seconds: list[float] = []
    wall: list[float] = []
    while len(seconds) < repeats or sum(seconds) < least_s:
        took, took_wall = time_steps(simulation, steps)
        seconds.append(took)
        wall.append(took_wall)
    record, info = simulation.record(), simulation.info()
    return Runs(
        seconds=tuple(seconds),
        wall=tuple(wall),
        sim_s=record.sim_s,
        steps=steps,
        nodes=record.nodes,
        newton_iterations=record.newton_iterations,
        cg_iterations=record.cg_iterations,
        cg_capped=record.cg_capped,
        bytes_per_node=info.bytes_total / record.nodes,
    )


def time_steps(simulation: Simulation, steps: int) -> tuple[float, float]:
    """Time so many steps from the start: CPU time [s], of all threads (wall time on CUDA), and wall time [s]."""
    device = simulation.device
    clock = clock_of(device)
    simulation.reset()
    wp.synchronize_device(device)
    start, start_wall = clock(), time.perf_counter()
    for _ in range(steps):
        simulation.step()
    wp.synchronize_device(device)
    return clock() - start, time.perf_counter() - start_wall
