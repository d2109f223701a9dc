"""`bench peers`: every engine on the hanging sheet, on one core, CPU time against error."""

import json
import statistics
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from warpdeform.errors import WarpdeformError
from warpdeform.study.bench.machine import describe, one_core
from warpdeform.study.bench.table import Target, targets_lines
from warpdeform.study.errors import block_averaged, rms
from warpdeform.study.peers.engine import Engine, Setting
from warpdeform.study.peers.engines import ENGINES, find_engines
from warpdeform.study.peers.ours import TIMED_FROM
from warpdeform.study.peers.processes import Reference, default_cache, find_reference, run_worker, start_seconds
from warpdeform.study.peers.records import OURS, EngineFacts, PeerRun, targets, with_gains
from warpdeform.study.peers.report import peers_lines
from warpdeform.study.peers.sheet import CHECKED, FPS, FRAMES
from warpdeform.study.peers.worker import Job

REFERENCE_LIMIT = 4.0
"""CPU time that each of the two runs of a reference may take, over the limit of a timed run."""


@dataclass(frozen=True)
class Effort:
    """How long things may take.

    Attributes:
        repeats: Runs that a median is of, at most.
        enough_s: CPU seconds of runs of one setting after which no repeat is begun [s].
        limit_s: CPU seconds at which a run that will take longer is given up [s].
        frames: Frames to simulate; errors are measured if it is FRAMES.
    """

    repeats: int = 5
    enough_s: float = 20.0
    limit_s: float = 200.0
    frames: int = FRAMES


@dataclass(frozen=True)
class PeerTimes:
    """The result of `bench peers`."""

    machine: dict[str, Any]
    core: int | None
    times_s: tuple[float, ...]
    effort: Effort
    engines: tuple[EngineFacts, ...]
    runs: tuple[PeerRun, ...]
    targets: tuple[Target, ...]

    def as_dict(self) -> dict[str, Any]:
        """The result as plain numbers, strings, lists and dicts."""
        return asdict(self)

    def lines(self) -> list[str]:
        """The tables as people read them."""
        return [*peers_lines(self.engines, self.runs), "", *targets_lines(self.targets)]


def bench_peers(
    sizes: Sequence[int],
    *,
    engines: Sequence[str] = (),
    effort: Effort | None = None,
    core: int | None = None,
    cache: Path | None = None,
    starts: bool = True,
    said: Callable[[str], None] = lambda line: None,
) -> PeerTimes:
    """Run every engine at every size and setting, each in a fresh process.

    Every run is added as a line of JSON to `runs.jsonl` in the cache when it ends.

    Args:
        sizes: Nodes along each side; from TIMED_FROM on this engine alone runs, for its time.
        engines: Names of engines; none for all. This engine is the measure of the others and runs in any case.
        effort: How long things may take.
        core: Core to stay on; None takes the first one allowed.
        cache: Folder of references; None takes the platform's.
        starts: Whether to time starts.
        said: Told about progress.

    Raises:
        InputError: There is no such engine.
    """
    chosen = find_engines(list(engines))
    if engines and OURS not in engines:
        chosen.insert(0, ENGINES[OURS])
    there = [engine for engine in chosen if not engine.missing]
    for engine in chosen:
        if engine.missing:
            said(f"{engine.name} is missing: {engine.install}")
    machine, bench = describe(), _Bench(effort or Effort(), cache or default_cache(), said)
    with one_core(core) as kept:
        timed = {e.name: start_seconds(e, min(sizes), said) if starts else (None, None) for e in there}
        for nodes in sizes:
            bench.size(nodes, there if nodes < TIMED_FROM else [ENGINES[OURS]])
    runs = with_gains(bench.runs)
    facts = tuple(bench.facts(engine, timed.get(engine.name, (None, None))) for engine in chosen)
    times = tuple(frame / FPS for frame in CHECKED)
    return PeerTimes(machine, kept, times, bench.effort, facts, tuple(runs), tuple(targets(runs)))


@dataclass
class _Bench:
    effort: Effort
    folder: Path
    said: Callable[[str], None]
    runs: list[PeerRun] = field(default_factory=list)
    references: dict[tuple[str, int], Reference] = field(default_factory=dict)

    def size(self, nodes: int, engines: Sequence[Engine]) -> None:
        """Every engine and setting at one size."""
        self.folder.mkdir(parents=True, exist_ok=True)
        if nodes < TIMED_FROM and self.effort.frames == FRAMES:
            for engine in engines:
                self._refer(engine, nodes)
        for engine in engines:
            for setting in engine.settings(nodes):
                run = self._run(engine, setting, nodes)
                self.said(
                    f"{run.engine}, {nodes} x {nodes}, {run.setting}: {run.cpu_s_per_s:.3g} s per s {run.trouble}"
                )
                self.runs.append(run)
                with (self.folder / "runs.jsonl").open("a") as log:
                    log.write(json.dumps(asdict(run)) + "\n")

    def facts(self, engine: Engine, seconds: tuple[float | None, float | None]) -> EngineFacts:
        """What is said of an engine once."""
        sizes = {nodes: found for (name, nodes), found in self.references.items() if name == engine.name}
        return EngineFacts(
            name=engine.name,
            law=engine.law,
            version="" if engine.missing else version(engine.package),
            install=engine.install,
            first_run_s=seconds[0],
            warm_s=seconds[1],
            rms_uncertainty_m={nodes: found.rms_m for nodes, found in sizes.items()},
            block_uncertainty_m={nodes: found.block_m for nodes, found in sizes.items()},
        )

    def _refer(self, engine: Engine, nodes: int) -> None:
        found = find_reference(engine, nodes, self.folder, self.said, REFERENCE_LIMIT * self.effort.limit_s)
        if found is not None:
            self.references[engine.name, nodes] = found

    def _run(self, engine: Engine, setting: Setting, nodes: int) -> PeerRun:
        run = PeerRun(
            engine.name, version(engine.package), nodes, setting.name, setting.values, setting.example, float("nan")
        )
        file, effort = self.folder / f"last-{engine.name}.npy", self.effort
        job = Job(
            engine.name,
            nodes,
            setting.values,
            effort.frames,
            effort.repeats,
            effort.enough_s,
            effort.limit_s,
            str(file),
        )
        try:
            answer = run_worker(job)
        except WarpdeformError as error:
            return replace(run, trouble=str(error))
        run = replace(
            run,
            cpu_s_per_s=statistics.median(answer.cpu_s_per_s),
            repeats=len(answer.cpu_s_per_s),
            max_stretch=answer.max_stretch,
            lowest_m=answer.lowest,
            trouble=answer.trouble,
        )
        positions, own, ours = (
            np.load(file),
            self.references.get((engine.name, nodes)),
            self.references.get((OURS, nodes)),
        )
        if len(positions) == len(CHECKED) and own is not None:
            run = replace(run, rms_own_m=own.far(rms, positions), block_own_m=own.far(block_averaged, positions))
        if len(positions) == len(CHECKED) and ours is not None:
            run = replace(run, rms_ours_m=ours.far(rms, positions), block_ours_m=ours.far(block_averaged, positions))
        return run
