"""The machine under a benchmark: what it is, one core of it, and clocks that a busy neighbour disturbs least."""

import os
import platform
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any


def describe() -> dict[str, Any]:
    """Processor, cores, load of the last minute, and the versions that matter."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {
        "cpu": _cpu_name(),
        "cores": os.cpu_count(),
        "load": load,
        "system": platform.system(),
        "python": platform.python_version(),
        "warp": version("warp-lang"),
    }


def sentence(machine: dict[str, Any]) -> str:
    """The description as one line."""
    load = f", load {machine['load']:.1f}" if machine["load"] is not None else ""
    return f"{machine['cpu']}, {machine['cores']} cores{load}; Python {machine['python']}, Warp {machine['warp']}"


def _cpu_name() -> str:
    """The processor's name, with its clock where the system tells."""
    facts = {}
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        pairs = (line.split(":", 1) for line in cpuinfo.read_text().splitlines() if ":" in line)
        facts = {key.strip(): value.strip() for key, value in pairs}
    name = facts.get("model name") or platform.processor() or platform.machine()
    return f"{name}, {float(facts['cpu MHz']) / 1000:.2f} GHz" if "cpu MHz" in facts else name


@contextmanager
def one_core(core: int | None = None) -> Iterator[int | None]:
    """Keep the process on one core while the body runs.

    Args:
        core: Which one; None takes the first that the process may use.

    Yields:
        The core, or None where the system does not let a process choose.
    """
    if not hasattr(os, "sched_setaffinity"):
        yield None
        return
    allowed = os.sched_getaffinity(0)
    chosen = min(allowed) if core is None or core not in allowed else core
    os.sched_setaffinity(0, {chosen})
    try:
        yield chosen
    finally:
        os.sched_setaffinity(0, allowed)


@contextmanager
def core_for(device: Any, core: int | None = None) -> Iterator[int | None]:
    """`one_core` where kernels run on the CPU; a GPU's driver keeps all its cores.

    Yields:
        The core, or None where the process keeps them all.
    """
    if device.is_cuda:
        yield None
        return
    with one_core(core) as chosen:
        yield chosen


def clock_of(device: Any) -> Callable[[], float]:
    """The clock [s] to time work on a device by: CPU time of this thread on the CPU, wall time elsewhere.

    CPU kernels run on the thread that launches them, and its CPU time leaves out when other processes held the core.
    """
    return time.perf_counter if device.is_cuda else time.thread_time
