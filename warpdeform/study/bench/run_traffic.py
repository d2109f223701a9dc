"""Bytes that a run moves, counted from its launches, and the bandwidth of the memory that they move them in."""

from typing import Any

import warp as wp

from warpdeform.scene.build import BuiltScene
from warpdeform.simulation import Simulation
from warpdeform.study.bench.counting import Tally, watched_launches
from warpdeform.study.bench.sampling import Sample

COPY_BYTES = 1 << 27
"""Bytes of each of the two arrays that are copied: more than caches hold."""
REAL = 4
"""Bytes of an entry of them."""
COPIES = 4
"""Copies of a sample, so that a GPU's launch does not count."""
ROUNDS = 3


def run_traffic(scene: BuiltScene, steps: int) -> float | None:
    """What a run moves [bytes]: compulsory traffic of its launches, those of every iteration that it makes.

    The steps are made without a graph, whose launches nobody could watch.

    Args:
        scene: The scene.
        steps: Time steps from its start.

    Returns:
        None if it has kernels that cannot be counted (those of obstacles).
    """
    simulation = Simulation(
        scene.bodies, obstacles=scene.obstacles, wind=scene.wind, settings=scene.settings, captured=False
    )
    tally = Tally()
    with watched_launches(tally.add, run=True):
        for _ in range(steps):
            simulation.step()
            if not tally.complete:
                return None
    return tally.bytes


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
