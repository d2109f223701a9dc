"""What was measured, and how runs compare: the front of time against error, and this engine's gain."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from warpdeform.study.bench.table import Target

OURS = "ours"
"""This engine."""
TARGETS = {64: 1 / 10, 128: 1 / 20}
"""Most that this engine's time may be of the fastest peer's at no greater error, by nodes along each side."""
USABLE_M = 0.05
"""Block-averaged error from which on no run counts, 5 % of the side: the sheet is somewhere else [m]."""


@dataclass(frozen=True)
class PeerRun:
    """An engine at one setting and size.

    Attributes:
        engine: Its name.
        version: Its version.
        nodes: Nodes along each side.
        setting: The setting, as people read it.
        values: The setting's values.
        example: Whether it is the setting of the engine's own cloth example.
        cpu_s_per_s: CPU seconds per simulated second, median of the repeats.
        repeats: Runs that the median is of.
        max_stretch: Longest edge along the grid over its rest length, in any frame.
        lowest_m: Lowest point of any frame [m].
        rms_own_m: Root mean square distance to the converged reference of its own law at each checked time [m].
        block_own_m: The same, block-averaged [m].
        rms_ours_m: Root mean square distance to this engine's converged reference [m].
        block_ours_m: The same, block-averaged [m].
        trouble: Why it ended early; empty if it did not.
        gain: Its time over that of this engine's cheapest run with no greater error; None if there is none.
    """

    engine: str
    version: str
    nodes: int
    setting: str
    values: dict[str, Any]
    example: bool
    cpu_s_per_s: float
    repeats: int = 1
    max_stretch: float = 1.0
    lowest_m: float = 0.0
    rms_own_m: tuple[float, ...] = ()
    block_own_m: tuple[float, ...] = ()
    rms_ours_m: tuple[float, ...] = ()
    block_ours_m: tuple[float, ...] = ()
    trouble: str = ""
    gain: float | None = None

    @property
    def error_m(self) -> float:
        """Block-averaged error against its own law at the last checked time [m]; infinite if it has none."""
        return self.block_own_m[-1] if self.block_own_m and not self.trouble else float("inf")


@dataclass(frozen=True)
class EngineFacts:
    """What is said of an engine once.

    Attributes:
        name: Its name.
        law: What it takes the material for.
        version: Its version; empty if it is missing.
        install: The command that installs it.
        first_run_s: Wall time of a fresh process up to its first frame, with empty kernel caches [s].
        warm_s: The same with full ones [s].
        rms_uncertainty_m: By size, the uncertainty of its reference at each checked time [m].
        block_uncertainty_m: The same, block-averaged [m].
    """

    name: str
    law: str
    version: str
    install: str
    first_run_s: float | None = None
    warm_s: float | None = None
    rms_uncertainty_m: dict[int, tuple[float, ...]] = field(default_factory=dict)
    block_uncertainty_m: dict[int, tuple[float, ...]] = field(default_factory=dict)


def front(runs: Sequence[PeerRun], largest_m: float = USABLE_M) -> list[PeerRun]:
    """The runs that no other one beats in both time and error, from the fastest to the most accurate.

    Args:
        runs: Runs at one size.
        largest_m: Error from which on a run does not count [m].
    """
    found: list[PeerRun] = []
    for run in sorted((r for r in runs if r.error_m < largest_m), key=lambda r: (r.cpu_s_per_s, r.error_m)):
        if not found or run.error_m < found[-1].error_m:
            found.append(run)
    return found


def fastest(runs: Sequence[PeerRun], error_m: float) -> PeerRun | None:
    """The fastest run whose error is no greater than a bound [m], if there is one."""
    good = [run for run in runs if run.error_m <= error_m]
    return min(good, key=lambda run: run.cpu_s_per_s) if good else None


def with_gains(runs: Sequence[PeerRun]) -> list[PeerRun]:
    """The runs, each peer's with this engine's gain over it."""
    return [run if run.engine == OURS else replace(run, gain=_gain(run, runs)) for run in runs]


def targets(runs: Sequence[PeerRun]) -> Iterator[Target]:
    """This engine's time over that of each run on the peers' front, where there is a target for it."""
    for nodes, limit in TARGETS.items():
        for run in front([r for r in runs if r.nodes == nodes and r.engine != OURS]):
            name = f"{nodes} x {nodes}, at the error of {run.engine}, {run.setting}"
            yield Target(name, "of its CPU time", 1.0 / run.gain if run.gain else float("inf"), limit)


def _gain(run: PeerRun, runs: Sequence[PeerRun]) -> float | None:
    """How many times the CPU time of this engine's cheapest run with no greater error a run took."""
    if run.error_m == float("inf"):
        return None
    best = fastest([r for r in runs if r.engine == OURS and r.nodes == run.nodes], run.error_m)
    return run.cpu_s_per_s / best.cpu_s_per_s if best else None
