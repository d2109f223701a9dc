"""What was measured of each setting, and which settings no other one beats."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

USABLE = 0.2
"""Block-averaged error over the size from which on a run counts for nothing: the body is somewhere else."""
BETTER = 0.9
"""Share of the error of a faster run below which a slower one is better, and not just otherwise rounded."""


@dataclass(frozen=True)
class Measured:
    """A setting and what came of it; energies, lowest point, stretch and period are of the whole scene.

    Attributes:
        name: The setting, as people read it.
        values: Its solver settings.
        grid: Cells along each axis over those of the scene.
        cpu_s_per_s: CPU seconds per simulated second up to the horizon; wall seconds on CUDA.
        block: Block-averaged error at the horizon over the size (c4).
        rms_m: Root mean square error of the node positions there [m]; NaN where grids do not nest.
        energy: Energy that appeared (or, below 0, was lost) until the end beyond the reference's, over the scale.
        lowest_m: Lowest point of any frame, over that of the reference [m].
        stretch: Largest stretch of any frame over the reference's.
        period: Swing period over the reference's; None where it does not swing.
        estimate_m: What the run itself estimates its error of the time step to be [m], until the end.
        steps: Time steps.
        retries: Attempts at steps that failed.
        newton_iterations: Newton iterations.
        cg_iterations: Conjugate gradient iterations.
        trouble: Why there is nothing to measure; empty if there is.
    """

    name: str
    values: dict[str, Any]
    grid: float = 1.0
    cpu_s_per_s: float = float("nan")
    block: float = float("inf")
    rms_m: float = float("inf")
    energy: float = float("nan")
    lowest_m: float = float("nan")
    stretch: float = float("nan")
    period: float | None = None
    estimate_m: float = float("nan")
    steps: int = 0
    retries: int = 0
    newton_iterations: int = 0
    cg_iterations: int = 0
    trouble: str = ""

    def row(self) -> dict[str, Any]:
        """As a row of the CSV."""
        every = dict(vars(self))
        values = every.pop("values")
        return {"name": every.pop("name"), **values, **every}


def front(runs: Sequence[Measured], least: float) -> list[Measured]:
    """The runs that no other one beats in both time and error, from the fastest to the most accurate.

    Args:
        runs: Runs.
        least: Error over the size below which errors are all the same: nothing tells them apart.
    """
    found: list[Measured] = []
    for run in sorted((r for r in runs if r.block < USABLE), key=lambda r: (r.cpu_s_per_s, r.block)):
        if not found or max(run.block, least) < BETTER * found[-1].block:
            found.append(run)
    return found


def cheapest(runs: Sequence[Measured], block: float) -> Measured | None:
    """The fastest run whose error over the size is no greater than that; None if there is none."""
    good = [run for run in runs if run.block <= block]
    return min(good, key=lambda run: run.cpu_s_per_s) if good else None
