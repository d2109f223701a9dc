"""How a step launches kernels: whole, or shared by the threads of a team, each of which has some rows of every grid.

A kernel knows nothing of this. It works on rows 1, 2, ... of the component arrays it is given, and each thread is given
views of those arrays that begin where its rows begin (neighbouring rows belong to the views: they are read, not
written). So results do not depend on the number of threads, to the bit. Each thread records and replays a graph of its
own; where one launch has to be over before the next one begins, all of them wait in a kernel
(:mod:`warpdeform.kernels.meeting`). Nothing else may launch in a step: what is launched here in a recording is shared.
"""

import ctypes
import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache, cached_property
from queue import SimpleQueue
from typing import Any, Protocol

import warp as wp

from warpdeform.grid import Layout
from warpdeform.kernels.meeting import GATE, meeting

SHARED_FROM = 4096
"""Places of a grid from which on its launches are shared: below, waiting costs more than the other thread saves."""
THREADS_FROM = 1 << 15
"""Nodes of a simulation from which on it takes more than one thread unless told otherwise."""
MOST_THREADS = 8
"""Threads that are taken at most unless told otherwise: memory feeds no more."""


class ByRows(Protocol):
    """An argument that has an entry per row but is no component array."""

    def of_rows(self, low: int, high: int) -> Any:
        """The argument for a thread whose rows, counted from 0 and without the halo, are `low` to `high` - 1."""


@dataclass(frozen=True)
class RowStruct:
    """A struct of component arrays.

    Attributes:
        struct: The struct.
        arrays: Its members by name, each of shape (n, rows, columns), or (1, 1, 1) where it is not used.
    """

    struct: Any
    arrays: Mapping[str, wp.array]

    def of_rows(self, low: int, high: int) -> Any:
        """The struct with the rows of its members from `low` on."""
        if low == 0:
            return self._whole
        return self._filled({name: a[:, low:] if a.size > 1 else a for name, a in self.arrays.items()})

    @cached_property
    def _whole(self) -> Any:
        return self._filled(self.arrays)

    def _filled(self, arrays: Mapping[str, wp.array]) -> Any:
        instance = self.struct()
        for name, array in arrays.items():
            setattr(instance, name, array)
        return instance


@dataclass(frozen=True)
class Whole:
    """An array that every thread gets as it is, whatever its shape."""

    array: wp.array


@dataclass(frozen=True)
class PerRow:
    """A table (n, rows), halo not included."""

    array: wp.array

    def of_rows(self, low: int, high: int) -> wp.array:
        """Its part for some rows."""
        return self.array[:, low:high]


@dataclass
class _Recording:
    """What one thread of a team records.

    Attributes:
        thread: Which thread.
        threads: How many there are.
        gate: Where they meet.
        open: What was launched since they last met: "" nothing, "alone" by the first thread only, "shared" by all.
    """

    thread: int
    threads: int
    gate: wp.array
    open: str = ""

    def wait(self, for_: str) -> None:
        """Meet, if what comes next could otherwise overtake what was launched before."""
        if self.open and (self.open, for_) != ("alone", "alone"):
            _wait(self.gate, self.threads)
        self.open = ""


def _wait(gate: wp.array, threads: int) -> None:
    wp.launch(meeting().meet, dim=1, inputs=[gate, threads, _yielding()], device=gate.device)


@cache
def _yielding() -> int:
    """Address of the system's function that yields the core; 0 where it is not to be found."""
    try:
        windows = sys.platform == "win32"
        function = ctypes.CDLL("kernel32").SwitchToThread if windows else ctypes.CDLL(None).sched_yield
    except (AttributeError, OSError):
        return 0
    return ctypes.cast(function, ctypes.c_void_p).value or 0


_recording: ContextVar[_Recording | None] = ContextVar("recording", default=None)


def launch_lanes(kernel: Any, layout: Layout, *inputs: Any, device: Any, inner: bool = False) -> None:
    """Launch a kernel over the lane groups of a grid.

    Args:
        kernel: The kernel; its thread indices are row and lane group.
        layout: Layout of the grid whose rows the kernel writes.
        inputs: Its arguments.
        device: Warp device.
        inner: From the first row of nodes to the last, for kernels that read neighbours: thread 0 is `first_row`.
    """
    rows, groups = layout.lane_dim
    _launch_by_rows(kernel, layout, (rows if not inner else layout.rows - 2 * layout.first_row, groups), inputs, device)


def launch_nodes(kernel: Any, layout: Layout, *inputs: Any, device: Any) -> None:
    """Launch a kernel over the places of a grid, one thread each; arguments as for `launch_lanes`."""
    _launch_by_rows(kernel, layout, layout.node_dim, inputs, device)


def launch_rows(kernel: Any, layout: Layout, *inputs: Any, device: Any) -> None:
    """Launch a kernel over the rows of a grid, one thread each; arguments as for `launch_lanes`."""
    _launch_by_rows(kernel, layout, layout.lane_dim[:1], inputs, device)


def launch_alone(kernel: Any, dim: int | Sequence[int], *inputs: Any, device: Any) -> None:
    """Launch a kernel that is too small to be shared."""
    do_alone(lambda: wp.launch(kernel, dim=dim, inputs=inputs, device=device))


def do_alone(operation: Callable[[], Any]) -> None:
    """Record an operation that one thread does for all, such as clearing a small array."""
    recording = _recording.get()
    if recording is None:
        operation()
        return
    recording.wait("alone")
    if recording.thread == 0:
        operation()
    recording.open = "alone"


def do_each(operation: Callable[[int], Any]) -> None:
    """Record an operation that every thread does for itself; it is told which thread it is."""
    recording = _recording.get()
    operation(recording.thread if recording else 0)


def repeat_while(condition: wp.array, body: Callable[..., None], **arguments: Any) -> None:
    """`wp.capture_while` for all threads."""
    _meet("shared")
    wp.capture_while(condition, _closed, body=body, arguments=arguments)


def choose(condition: wp.array, on_true: Callable[..., None] | None, on_false: Callable[..., None] | None) -> None:
    """`wp.capture_if` for all threads; either branch may be None."""
    _meet("shared")

    def branch(body: Callable[..., None] | None) -> Callable[[], None] | None:
        return None if body is None else lambda: _closed(body, {})

    wp.capture_if(condition, branch(on_true), branch(on_false))
    _leave_open()


def _closed(body: Callable[..., None], arguments: dict[str, Any]) -> None:
    """The body of a loop or branch: its condition stays until all have read it, and it leaves nothing open."""
    _leave_open()
    body(**arguments)
    _meet("shared")


def _meet(for_: str) -> None:
    recording = _recording.get()
    if recording is not None:
        recording.wait(for_)


def _leave_open() -> None:
    recording = _recording.get()
    if recording is not None:
        recording.open = "shared"


def _launch_by_rows(kernel: Any, layout: Layout, dim: Sequence[int], inputs: Sequence[Any], device: Any) -> None:
    recording = _recording.get()
    if recording is None or layout.rows * layout.columns < SHARED_FROM:
        launch_alone(kernel, dim, *(_part(each, layout, 0, dim[0]) for each in inputs), device=device)
        return
    recording.wait("shared")
    low, high = (dim[0] * (recording.thread + k) // recording.threads for k in (0, 1))
    parts = [_part(each, layout, low, high) for each in inputs]
    wp.launch(kernel, dim=(high - low, *dim[1:]), inputs=parts, device=device)
    recording.open = "shared"


def _part(argument: Any, layout: Layout, low: int, high: int) -> Any:
    """What a thread is given of an argument: the rows of component arrays, all of everything else."""
    if isinstance(argument, Whole):
        return argument.array
    if hasattr(argument, "of_rows"):
        return argument.of_rows(low, high)
    if not isinstance(argument, wp.array) or low == 0 or argument.size == 0:
        return argument
    shape = argument.shape
    if len(shape) == 3 and shape[1] == layout.rows and shape[2] in (1, layout.columns):
        return argument[:, low:]
    if shape == (layout.rows, layout.columns):
        return argument[low:]
    return argument


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
        self._graphs: list[Any] = []
        self._calls: list[SimpleQueue[Any]] = []
        self._done: SimpleQueue[BaseException | None] = SimpleQueue()
        if threads > 1:
            _wait(self._gate, 1)  # loads the kernel; a capture may not

    def record(self, step: Callable[[], None]) -> None:
        """Record a step once for every thread."""
        self._graphs = []
        for thread in range(self.threads):
            with _as_thread(thread, self.threads, self._gate), wp.ScopedCapture(device=self._device) as capture:
                step()
                _meet("shared")
            self._graphs.append(capture.graph)

    @property
    def recorded(self) -> bool:
        """Whether there is something to replay."""
        return bool(self._graphs)

    def replay(self) -> None:
        """Run the step; it is over for all threads when this returns."""
        others = self._graphs[1:]
        while len(self._calls) < len(others):
            self._start_thread()
        for calls, graph in zip(self._calls, others, strict=False):
            calls.put(graph)
        wp.capture_launch(self._graphs[0])
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


@contextmanager
def _as_thread(thread: int, threads: int, gate: wp.array) -> Iterator[None]:
    token = _recording.set(_Recording(thread, threads, gate) if threads > 1 else None)
    try:
        yield
    finally:
        _recording.reset(token)


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
