"""`bench block`: a block of rubber dropped on the ground, here and in other engines, on one core."""

import json
import math
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import Any

from warpdeform.errors import WarpdeformError
from warpdeform.study.bench.machine import describe, one_core
from warpdeform.study.bench.table import Target, table, targets_lines, three_digits
from warpdeform.study.peers.block import Block
from warpdeform.study.peers.block_engines import BLOCK_ENGINES
from warpdeform.study.peers.block_worker import BlockAnswer, BlockJob
from warpdeform.study.peers.processes import last_json, run_module
from warpdeform.study.peers.records import OURS

RIVAL, SHARE = "mujoco", 1 / 5
"""This engine may take so much of that one's time, each at its example's setting."""
_HEADER = ("engine, setting", "CPU s per s", "lowest mm", "at rest, mm", "height mm", "smallest J", "times ours")


@dataclass(frozen=True)
class BlockRun:
    """An engine at one setting, the fastest of its runs.

    Attributes:
        engine: Its name.
        version: Its version.
        setting: The setting, as people read it.
        example: Whether it stands for the engine in the comparison.
        answer: What was measured.
    """

    engine: str
    version: str
    setting: str
    example: bool
    answer: BlockAnswer


@dataclass(frozen=True)
class BlockTimes:
    """The result of `bench block`; `missing` are the commands that install engines that are not there."""

    machine: dict[str, Any]
    core: int | None
    block: Block
    runs: tuple[BlockRun, ...]
    missing: dict[str, str]
    targets: tuple[Target, ...]

    def as_dict(self) -> dict[str, Any]:
        """The result as plain numbers, strings, lists and dicts."""
        return asdict(self)

    def lines(self) -> list[str]:
        """The table as people read it."""
        b = self.block
        head = (
            f"{b.nodes} x {b.nodes} x {b.nodes} nodes, {b.side:g} m, {b.density:g} kg/m3, E {b.youngs_modulus:g} Pa, "
            f"nu {b.poisson_ratio:g}, dropped from {b.height:g} m; {b.seconds:g} s, one core, * compared"
        )
        ours = _compared(self.runs, OURS)
        rows = [_row(run, ours.answer.cpu_s_per_s if ours else math.nan) for run in self.runs]
        lines = [head, "", *table(_HEADER, rows), ""]
        lines += [f"{run.engine}, {run.setting}: {run.answer.trouble}" for run in self.runs if run.answer.trouble]
        lines += [f"{name} is missing: {command}" for name, command in self.missing.items()]
        return lines + targets_lines(self.targets)


def bench_block(
    nodes: int = 10,
    *,
    seconds: float = 2.0,
    repeats: int = 3,
    core: int | None = None,
    said: Callable[[str], None] = lambda line: None,
) -> BlockTimes:
    """Drop the block in every engine that is there, at each of its settings, each in a fresh process.

    Args:
        nodes: Nodes along each side.
        seconds: Simulated time [s].
        repeats: Runs, taken in turn; the fastest counts.
        core: Core to stay on; None takes the first one allowed.
        said: Told about progress.
    """
    machine, block = describe(), Block(nodes=nodes, seconds=seconds)
    there = [engine for engine in BLOCK_ENGINES.values() if not engine.missing]
    missing = {e.name: f"pip install {e.package}" for e in BLOCK_ENGINES.values() if e.missing}
    best: dict[tuple[str, str], BlockRun] = {}
    with one_core(core) as kept:
        for _ in range(repeats):
            for engine in there:
                for setting in engine.settings:
                    answer = _answer(BlockJob(engine.name, setting.values, nodes, seconds))
                    said(f"{engine.name}, {setting.name}: {answer.cpu_s_per_s:.3g} s per s {answer.trouble}")
                    run = BlockRun(engine.name, version(engine.package), setting.name, setting.example, answer)
                    known = best.get((engine.name, setting.name))
                    if known is None or answer.cpu_s_per_s < known.answer.cpu_s_per_s:
                        best[engine.name, setting.name] = run
    runs = tuple(best.values())
    return BlockTimes(machine, kept, block, runs, missing, _targets(runs))


def _answer(job: BlockJob) -> BlockAnswer:
    with tempfile.TemporaryDirectory(prefix="warpdeform-peers-") as folder:  # MuJoCo writes its warnings where it is
        try:
            output = run_module("warpdeform.study.peers.block_worker", json.dumps(asdict(job)), folder=folder)
            return BlockAnswer(**last_json(output))
        except WarpdeformError as error:
            return BlockAnswer(math.nan, trouble=str(error))


def _compared(runs: tuple[BlockRun, ...], engine: str) -> BlockRun | None:
    return next((run for run in runs if run.engine == engine and run.example), None)


def _targets(runs: tuple[BlockRun, ...]) -> tuple[Target, ...]:
    ours, rival = _compared(runs, OURS), _compared(runs, RIVAL)
    if ours is None:
        return ()
    depth = Target("how deep a node of ours goes below the ground", "mm", max(0.0, -1e3 * ours.answer.lowest_m), 0.0)
    if rival is None:
        return (depth,)
    share = ours.answer.cpu_s_per_s / rival.answer.cpu_s_per_s
    return Target(f"ours, of the CPU time of {RIVAL}, {rival.setting}", "of it", share, SHARE), depth


def _row(run: BlockRun, ours: float) -> list[str]:
    a = run.answer
    lengths = [f"{1e3 * value:.2f}" for value in (a.lowest_m, a.rest_m)]
    name = f"{run.engine}, {run.setting}{' *' * run.example}"
    gain = "" if run.engine == OURS else three_digits(a.cpu_s_per_s / ours)
    return [name, three_digits(a.cpu_s_per_s), *lengths, f"{1e3 * a.height_m:.1f}", f"{a.least_volume:.3f}", gain]
