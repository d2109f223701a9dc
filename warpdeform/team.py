"""The threads that replay a step together."""

import os
import threading
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any

import warp as wp

from warpdeform.kernels.meeting import GATE
from warpdeform.launching import as_thread, meet, wait_at

THREADS_FROM = 1 << 15
"""Nodes of a simulation from which on it takes more than one thread unless told otherwise."""
MOST_THREADS = 8
"""Threads that are taken at most unless told otherwise: memory feeds no more."""


class Team:
    """The threads that replay a step, the calling thread among them.

    Args:
        threads: How many.
        device: Warp device; more than one thread are of use on the CPU only.
    """

    def __init__(self, threads: int, device: Any) -> None:
        self.threads = threads
        self._gate: wp.array = wp.zeros(GATE, dtype=wp.int32, device=device)
        self._device = device
        self._graphs: dict[str, list[Any]] = {}
        self._calls: list[SimpleQueue[Any]] = []
        self._done: SimpleQueue[BaseException | None] = SimpleQueue()
        if threads > 1:
            wait_at(self._gate, 1)  # loads the kernel; a capture may not

    def record(self, step: Callable[[], None], name: str = "step") -> None:
        """Record a step, or a part of one, once for every thread."""
        self._graphs[name] = []
        for thread in range(self.threads):
            with as_thread(thread, self.threads, self._gate), wp.ScopedCapture(device=self._device) as capture:
                step()
                meet("shared")
            self._graphs[name].append(capture.graph)

    def replay(self, name: str = "step") -> None:
        """Run what was recorded under that name; it is over for all threads when this returns."""
        first, *others = self._graphs[name]
        while len(self._calls) < len(others):
            self._start_thread()
        for calls, graph in zip(self._calls, others, strict=False):
            calls.put(graph)
        wp.capture_launch(first)
        failures = [self._done.get() for _ in others]
        for failure in failures:
            if failure is not None:
                raise failure

    def _start_thread(self) -> None:
        calls: SimpleQueue[Any] = SimpleQueue()
        self._calls.append(calls)
        threading.Thread(target=_serve, args=(calls, self._done), daemon=True, name="warpdeform").start()

    def __del__(self) -> None:
        for calls in self._calls:
            calls.put(None)


def _serve(calls: "SimpleQueue[Any]", done: "SimpleQueue[BaseException | None]") -> None:
    """Replay what is asked for until nothing more is."""
    while (graph := calls.get()) is not None:
        try:
            wp.capture_launch(graph)
            done.put(None)
        except BaseException as error:
            done.put(error)
        graph = None


def choose_threads(asked: int, nodes: int, device: Any) -> int:
    """How many threads a simulation takes.

    Args:
        asked: What the settings say; 0 leaves it open.
        nodes: Nodes of all bodies.
        device: Warp device.
    """
    if device.is_cuda:
        return 1
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if asked:
        return asked
    return min(cores, MOST_THREADS) if nodes >= THREADS_FROM else 1
