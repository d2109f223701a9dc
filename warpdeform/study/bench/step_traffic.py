"""Bytes that steps move, counted from their launches, and the bandwidth of the memory that they move them in."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import warp as wp

from warpdeform.integrators.newton import NewtonSolver
from warpdeform.linear import ConjugateGradient
from warpdeform.scene.build import BuiltScene
from warpdeform.simulation import Simulation
from warpdeform.study.bench.counting import Launch, count, recorded_launches
from warpdeform.study.bench.interpreter import UncountableError
from warpdeform.study.bench.sampling import Sample

COPY_BYTES = 1 << 27
"""Bytes of each of the two arrays that are copied: more than caches hold."""
REAL = 4
"""Bytes of an entry of them."""
COPIES = 4
"""Copies of a sample, so that a GPU's launch does not count."""
ROUNDS = 3


@dataclass(frozen=True)
class StepTraffic:
    """Compulsory traffic of the launches of a step [bytes].

    Attributes:
        per_step: Outside the Newton iteration.
        per_newton: Of a Newton iteration with one trial of its line search, outside conjugate gradient.
        per_cg: Of a conjugate gradient iteration.
    """

    per_step: float
    per_newton: float
    per_cg: float

    def total(self, steps: int, newton_iterations: int, cg_iterations: int) -> float:
        """Traffic of so many steps and iterations [bytes]."""
        return self.per_step * steps + self.per_newton * newton_iterations + self.per_cg * cg_iterations


def step_traffic(scene: BuiltScene) -> StepTraffic | None:
    """What a step of a scene moves; None if it has kernels that cannot be counted (obstacles that are meshes)."""
    simulation = Simulation(
        scene.bodies, obstacles=scene.obstacles, wind=scene.wind, settings=scene.settings, captured=False
    )
    with recorded_launches() as launches:
        simulation.step()
    by_loop: dict[type, list[Launch]] = {NewtonSolver: [], ConjugateGradient: [], Simulation: []}
    for launch in launches:
        by_loop[_innermost(launch.loops)].append(launch)
    try:
        moved = {loop: count(own).bytes for loop, own in by_loop.items()}
    except UncountableError:
        return None
    return StepTraffic(moved[Simulation], moved[NewtonSolver], moved[ConjugateGradient])


def _innermost(loops: Sequence[Any]) -> type:
    """The loop whose iterations a run reports; others inside it count once."""
    for kind in (ConjugateGradient, NewtonSolver):
        if any(isinstance(owner, kind) for owner in loops):
            return kind
    return Simulation


def copy_bandwidth(device: Any) -> float:
    """Bandwidth of copies from device memory to device memory [GB/s], reading and writing both counted."""
    a, b = (wp.zeros(COPY_BYTES // REAL, dtype=wp.float32, device=device) for _ in range(2))

    def copy() -> None:
        for _ in range(COPIES // 2):
            wp.copy(b, a)
            wp.copy(a, b)

    sample = Sample(copy, a.size, device)
    for _ in range(ROUNDS):
        sample.time()
    return 1e-9 * COPIES * 2 * REAL / min(sample.seconds)
