"""Workers: fresh processes with one thread each, and references that are computed once and kept."""

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from warpdeform.errors import WarpdeformError
from warpdeform.study.errors import block_averaged, rms
from warpdeform.study.peers.engine import Engine, Setting
from warpdeform.study.peers.sheet import CHECKED, FRAMES, Array, Sheet
from warpdeform.study.peers.worker import Answer, Job

SINGLE_THREADED = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMEXPR_NUM_THREADS": "1",
    "CUDA_VISIBLE_DEVICES": "",
}
"""Environment of a worker."""


@dataclass(frozen=True)
class Reference:
    """What a law does, converged.

    Attributes:
        positions: Positions at the checked frames [m], shape (2, n, n, 3).
        rms_m: Its uncertainty, the distance to a second one with twice its step: root mean square [m], each frame.
        block_m: The same, block-averaged [m].
    """

    positions: Array
    rms_m: tuple[float, ...]
    block_m: tuple[float, ...]

    def far(self, measure: Callable[[Array, Array], float], positions: Array) -> tuple[float, ...]:
        """The error of positions at each checked frame [m]."""
        return tuple(measure(x, reference) for x, reference in zip(positions, self.positions, strict=True))


def run_worker(job: Job, environment: Mapping[str, str] | None = None) -> Answer:
    """Run a job in a fresh process.

    Args:
        job: The job.
        environment: Further variables.

    Raises:
        WarpdeformError: The process failed.
    """
    return Answer(**last_json(run_module("warpdeform.study.peers.worker", json.dumps(asdict(job)), environment)))


def run_module(
    module: str, argument: str, environment: Mapping[str, str] | None = None, folder: str | None = None
) -> str:
    """What a module prints that is run in a fresh process with one thread.

    Args:
        module: The module.
        argument: Its argument.
        environment: Further variables.
        folder: Where it works; here by default.

    Raises:
        WarpdeformError: The process failed.
    """
    variables = {**os.environ, **SINGLE_THREADED, **(environment or {})}
    command = [sys.executable, "-m", module, argument]
    done = subprocess.run(command, env=variables, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        problem = (done.stderr.strip() or done.stdout.strip()).splitlines()[-1:] or ["nothing said"]
        raise WarpdeformError(f"the worker of {argument} ended with code {done.returncode}: {problem[0][-300:]}")
    return done.stdout


def last_json(output: str) -> dict[str, Any]:
    """The last line of JSON in what a worker printed.

    Raises:
        WarpdeformError: It printed none.
    """
    lines = [line for line in output.splitlines() if line.startswith("{")]
    try:
        found: dict[str, Any] = json.loads(lines[-1])
    except (IndexError, json.JSONDecodeError):
        raise WarpdeformError(f"a worker gave no answer but: {output.strip()[-300:]}") from None
    return found


def start_seconds(engine: Engine, nodes: int, said: Callable[[str], None]) -> tuple[float, float]:
    """Wall time of a fresh process that computes one frame [s]: with empty caches of compiled kernels, and full ones.

    Args:
        engine: The engine, under its example's setting.
        nodes: Nodes along each side.
        said: Told about progress.
    """
    setting = next(setting for setting in engine.settings(nodes) if setting.example)
    job = Job(engine.name, nodes, setting.values, frames=1)
    seconds = []
    with tempfile.TemporaryDirectory(prefix="warpdeform-peers-") as folder:
        caches = {"WARP_CACHE_PATH": folder, "TI_OFFLINE_CACHE_FILE_PATH": folder}
        for kind in ("first-run", "warm"):
            said(f"{engine.name}: {kind} start")
            began = time.perf_counter()
            run_worker(job, caches)
            seconds.append(time.perf_counter() - began)
    return seconds[0], seconds[1]


def find_reference(
    engine: Engine, nodes: int, cache: Path, said: Callable[[str], None], limit_s: float
) -> Reference | None:
    """The converged reference of an engine's law, from the cache or computed into it.

    Args:
        engine: The engine.
        nodes: Nodes along each side.
        cache: Folder of references.
        said: Told about progress.
        limit_s: CPU seconds that each of the two runs may take [s].

    Returns:
        The reference, or None if it would take longer.
    """
    runs = []
    for setting in reversed(engine.references(nodes)):
        file = cache / f"{engine.name}-{nodes}-{reference_key(engine, nodes, setting)}.npy"
        if not file.exists():
            said(f"{engine.name}, {nodes} x {nodes}: reference, {setting.name}")
            cache.mkdir(parents=True, exist_ok=True)
            part = file.with_suffix(f".{os.getpid()}.npy")
            job = Job(engine.name, nodes, setting.values, FRAMES, limit_s=limit_s, file=str(part))
            answer = run_worker(job)
            if answer.trouble:
                said(f"{engine.name}, {nodes} x {nodes}: no reference: {answer.trouble}")
                part.unlink(missing_ok=True)
                return None
            part.replace(file)
        runs.append(np.load(file))
    coarse, fine = runs
    exact = Reference(fine, (), ())
    return Reference(fine, exact.far(rms, coarse), exact.far(block_averaged, coarse))


def reference_key(engine: Engine, nodes: int, setting: Setting) -> str:
    """A digest of everything that a reference depends on: scene, setting, version, and the sources of the law."""
    found = hashlib.sha256()
    facts = [asdict(Sheet(nodes)), setting.values, CHECKED, engine.name, version(engine.package)]
    found.update(json.dumps(facts, sort_keys=True).encode())
    for path in engine.sources():
        found.update(path.read_bytes())
    return found.hexdigest()[:16]


def default_cache() -> Path:
    """The platform's folder for what can be computed again."""
    if sys.platform == "win32":
        home = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        home = Path.home() / "Library" / "Caches"
    else:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return home / "warpdeform" / "peers"
