"""`bench start`: how long a user waits for the first frame, with and without kernels in the cache, and for `--help`."""

import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from warpdeform.errors import WarpdeformError
from warpdeform.scene import load_scene
from warpdeform.study.bench.machine import describe
from warpdeform.study.bench.table import Target, table, targets_lines

LIMITS = {"help": 0.5, "cold": 30.0, "warm": 2.0}
"""Seconds of wall time that each kind of start may take."""
_COMPILED = re.compile(r"^Module (\S+) \S+ load on device \S+ took ([\d.]+) ms +\(compiled\)$", re.MULTILINE)


@dataclass(frozen=True)
class Start:
    """One process from its start to its end.

    Attributes:
        wall_s: Wall time [s].
        cpu_s: CPU time, of all its threads [s].
        phases: Wall and CPU time of each phase [s].
        compiled: Modules that were compiled, and the wall time each took [s].
    """

    wall_s: float
    cpu_s: float
    phases: dict[str, dict[str, float]] = field(default_factory=dict)
    compiled: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class StartTimes:
    """The result of `bench start`.

    Attributes:
        machine: What it ran on.
        scene: The scene.
        help: Runs of `warpdeform --help`.
        cold: Starts with an empty kernel cache, each with its own.
        warm: Starts with a full one, after a first that fills it.
        targets: The limits.
    """

    machine: dict[str, Any]
    scene: str
    help: tuple[Start, ...]
    cold: tuple[Start, ...]
    warm: tuple[Start, ...]
    targets: tuple[Target, ...]

    def as_dict(self) -> dict[str, Any]:
        """The result as plain numbers, strings, lists and dicts."""
        return asdict(self)

    def lines(self) -> list[str]:
        """The tables as people read them."""
        rows = [_row(kind, starts) for kind, starts in self._kinds()]
        header = ("start", "wall s, min", "wall s, median", "CPU s, min", "CPU s, median")
        phases = [_phase_row(name, self.cold, self.warm) for name in self.warm[0].phases]
        modules = sorted(self.cold[0].compiled.items(), key=lambda item: -item[1])
        lines = [f"{self.scene}: a fresh process up to the first computed frame, written", "", *table(header, rows), ""]
        lines += [*table(("phase", "cold, CPU s", "warm, CPU s", "warm, wall s"), phases), ""]
        lines += table(("module compiled", "wall s"), [(name, f"{seconds:.2f}") for name, seconds in modules])
        again = sorted({name for start in self.warm for name in start.compiled})
        lines += ["", f"compiled again in a warm start: {', '.join(again) or 'none'}", ""]
        return lines + targets_lines(self.targets)

    def _kinds(self) -> list[tuple[str, Sequence[Start]]]:
        return [("warpdeform --help", self.help), ("cold", self.cold), ("warm", self.warm)]


def bench_start(
    scene: str = "hanging", *, repeats: int = 5, said: Callable[[str], None] = lambda line: None
) -> StartTimes:
    """Start processes and time them.

    Args:
        scene: Name or path of the scene.
        repeats: Starts that count, with a full cache and for `--help`; one in three of them also with an empty cache.
        said: Told about progress.

    Raises:
        InputError: The scene is not in order.
        WarpdeformError: A started process failed.
    """
    load_scene(scene)
    machine = describe()
    said("--help")
    help_ = tuple(_start([sys.executable, "-m", "warpdeform.cli", "--help"]) for _ in range(repeats))
    cold, warm = [], []
    with tempfile.TemporaryDirectory(prefix="warpdeform-bench-") as folder:
        for k in range(-(-repeats // 3)):
            said(f"cold start {k + 1}")
            cold.append(first_frame(scene, Path(folder), f"cache{k}"))
        for k in range(repeats):
            said(f"warm start {k + 1}")
            warm.append(first_frame(scene, Path(folder), "cache0"))
    fastest = {"help": min(s.wall_s for s in help_), "cold": min(s.wall_s for s in cold)}
    fastest["warm"] = min(s.wall_s for s in warm)
    names = {"help": "warpdeform --help", "cold": f"cold start of {scene}", "warm": f"warm start of {scene}"}
    targets = tuple(Target(names[kind], "s, min", fastest[kind], limit) for kind, limit in LIMITS.items())
    return StartTimes(machine, scene, help_, tuple(cold), tuple(warm), targets)


def first_frame(scene: str, folder: Path, cache: str, values: str = "{}") -> Start:
    """Start a process that computes and writes one frame.

    Args:
        scene: Name or path of the scene.
        folder: Where it may write.
        cache: Name of the folder in there that is its kernel cache.
        values: Values that replace some of the scene's, as JSON.

    Raises:
        WarpdeformError: It failed.
    """
    command = [sys.executable, "-m", "warpdeform.study.bench.first_frame", scene, str(folder / "frames.usdc"), values]
    return _start(command, {"WARP_CACHE_PATH": str(folder / cache)})


def _start(command: Sequence[str], environment: dict[str, str] | None = None) -> Start:
    before, began = os.times(), time.perf_counter()
    done = subprocess.run(
        command, env={**os.environ, **(environment or {})}, capture_output=True, text=True, check=False
    )
    wall, after = time.perf_counter() - began, os.times()
    if done.returncode:
        raise WarpdeformError(f"{' '.join(command)} ended with code {done.returncode}: {done.stderr.strip()[-500:]}")
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    if environment is None:
        return Start(wall, cpu)
    phases = json.loads(done.stdout.splitlines()[-1])
    compiled = {name: float(ms) / 1e3 for name, ms in _COMPILED.findall(done.stdout)}
    return Start(wall, cpu, phases, compiled)


def _row(kind: str, starts: Sequence[Start]) -> list[str]:
    wall, cpu = [s.wall_s for s in starts], [s.cpu_s for s in starts]
    return [kind, *(f"{value:.2f}" for value in (min(wall), statistics.median(wall), min(cpu), statistics.median(cpu)))]


def _phase_row(name: str, cold: Sequence[Start], warm: Sequence[Start]) -> list[str]:
    values = (
        min(s.phases[name]["cpu_s"] for s in cold),
        min(s.phases[name]["cpu_s"] for s in warm),
        min(s.phases[name]["wall_s"] for s in warm),
    )
    return [name, *(f"{value:.3f}" for value in values)]
