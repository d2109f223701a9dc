"""How a step launches kernels: whole, or shared by the threads of a team, each of which has some rows of every grid.

A kernel knows nothing of this. It works on rows 1, 2, ... of the component arrays it is given, and each thread is given
views of those arrays that begin where its rows begin (neighbouring rows belong to the views: they are read, not
written). So results do not depend on the number of threads, to the bit. Each thread records and replays a graph of its
own; where one launch has to be over before the next one begins, all of them wait in a kernel
(:mod:`warpdeform.kernels.meeting`). Nothing else may launch in a step: what is launched here in a recording is shared.
"""

import ctypes
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Protocol

import warp as wp

from warpdeform.grid import Layout
from warpdeform.kernels.meeting import meeting

SHARED_FROM = 4096
"""Places of a grid from which on its launches are shared: below, waiting costs more than the other thread saves."""
BAND_BYTES = 300_000
"""Size of the buffers of a band of rows: what a core's own cache keeps beside what streams through it."""
LEAST_BAND = 8
"""Rows of a band at least: one or two more of them are computed twice."""


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
        buffers: Names of those that are buffers of bands.
    """

    struct: Any
    arrays: Mapping[str, wp.array]
    buffers: frozenset[str] = frozenset()

    def of_rows(self, low: int, high: int) -> Any:
        """The struct with the rows of its members from `low` on."""
        return self._whole if low == 0 else self.of_band(low, low)

    def of_band(self, low: int, base: int) -> Any:
        """The struct with the rows of its members from `low` on, of buffers from `base` on."""
        starts = {name: base if name in self.buffers else low for name in self.arrays}
        return self._filled({n: a[:, starts[n] :] if starts[n] and a.size > 1 else a for n, a in self.arrays.items()})

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
class Buffer:
    """A component array that holds the rows of a band only while bands are launched (`launch_in_bands`)."""

    array: wp.array


@dataclass(frozen=True)
class _Band:
    """Rows that are launched now, counted from 0 and without the halo, and the row of buffers where they begin."""

    low: int
    high: int
    base: int


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
            wait_at(self.gate, self.threads)
        self.open = ""


def wait_at(gate: wp.array, threads: int) -> None:
    """Launch the kernel in which threads wait for each other."""
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
_band: ContextVar[_Band | None] = ContextVar("band", default=None)


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
    meet("shared")
    wp.capture_while(condition, _closed, body=body, arguments=arguments)


def choose(condition: wp.array, on_true: Callable[..., None] | None, on_false: Callable[..., None] | None) -> None:
    """`wp.capture_if` for all threads; either branch may be None."""
    meet("shared")

    def branch(body: Callable[..., None] | None) -> Callable[[], None] | None:
        return None if body is None else lambda: _closed(body, {})

    wp.capture_if(condition, branch(on_true), branch(on_false))
    _leave_open()


def _closed(body: Callable[..., None], arguments: dict[str, Any]) -> None:
    """The body of a loop or branch: its condition stays until all have read it, and it leaves nothing open."""
    _leave_open()
    body(**arguments)
    meet("shared")


def meet(for_: str) -> None:
    """Let all threads wait, if what comes next ("alone" or "shared") could overtake what was launched before."""
    recording = _recording.get()
    if recording is not None:
        recording.wait(for_)


def _leave_open() -> None:
    recording = _recording.get()
    if recording is not None:
        recording.open = "shared"


def launch_in_bands(
    layout: Layout, buffers: Sequence[wp.array], write: Callable[[], None], finish: Callable[[], None], device: Any
) -> None:
    """Launch `write`, which leaves something in buffers, and `finish`, which reads it, over bands of rows in turn.

    So what is written is read from the cache, and the buffers take no bandwidth of the memory: a product with A on a
    large sheet takes three quarters of the time. Only neighbours may be read across rows, and `finish` must write
    nothing that `write` reads. Without buffers, on CUDA, on periodic and small grids there are no bands.

    Args:
        layout: Layout of the grid.
        buffers: Component arrays that `write` and `finish` pass as `Buffer` or as buffers of a `RowStruct`.
        write: Launches kernels over lanes.
        finish: The same.
        device: Warp device.
    """
    low, high = _own_rows(layout, layout.lane_dim[0])
    reach = layout.first_row
    bytes_per_row = sum(a.shape[0] * a.strides[1] for a in buffers if a.size > 1)
    rows = max(LEAST_BAND, BAND_BYTES // max(bytes_per_row, 1), 2 * reach)
    if not bytes_per_row or device.is_cuda or any(layout.periodic) or high - low < 2 * (rows + 2 * reach):
        write()
        finish()
        return
    meet("shared")
    for start in range(low, high, rows):
        end = min(start + rows, high)
        first, last = max(start - reach, 0), min(end + reach, layout.lane_dim[0])
        # The first and the last band lie in their own places, so that beyond them there is the halo; others where
        # kernels that begin at the first row of nodes find as many rows before theirs.
        base = first if end == layout.lane_dim[0] or first == 0 else low + reach - 1
        with _rows(_Band(first, last, base)):
            write()
        with _rows(_Band(start, end, base + start - first)):
            finish()
    _leave_open()


@contextmanager
def _rows(band: _Band) -> Iterator[None]:
    token = _band.set(band)
    try:
        yield
    finally:
        _band.reset(token)


def _own_rows(layout: Layout, rows: int) -> tuple[int, int]:
    """The rows that this thread launches, of as many."""
    recording = _recording.get()
    if recording is None or _is_small(layout):
        return 0, rows
    return rows * recording.thread // recording.threads, rows * (recording.thread + 1) // recording.threads


def _is_small(layout: Layout) -> bool:
    return layout.rows * layout.columns < SHARED_FROM


def _launch_by_rows(kernel: Any, layout: Layout, dim: Sequence[int], inputs: Sequence[Any], device: Any) -> None:
    band, recording = _band.get(), _recording.get()
    if band is not None:
        # A kernel that begins at the first row of nodes counts its rows from there.
        skipped = (layout.lane_dim[0] - dim[0]) // 2
        low, high = max(band.low - skipped, 0), min(band.high - skipped, dim[0])
        if low >= high:
            return
        base = band.base + low + skipped - band.low
        parts = [_part(each, layout, low, high, base - skipped) for each in inputs]
        wp.launch(kernel, dim=(high - low, *dim[1:]), inputs=parts, device=device)
        return
    low, high = _own_rows(layout, dim[0])
    if recording is None or _is_small(layout):
        launch_alone(kernel, dim, *(_part(each, layout, 0, dim[0], 0) for each in inputs), device=device)
        return
    recording.wait("shared")
    parts = [_part(each, layout, low, high, low) for each in inputs]
    wp.launch(kernel, dim=(high - low, *dim[1:]), inputs=parts, device=device)
    recording.open = "shared"


def _part(argument: Any, layout: Layout, low: int, high: int, base: int) -> Any:
    """What a thread is given of an argument: the rows of component arrays, all of everything else."""
    if isinstance(argument, Whole):
        return argument.array
    if isinstance(argument, RowStruct) and base != low:
        return argument.of_band(low, base)
    if isinstance(argument, Buffer):
        argument, low = argument.array, base
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


@contextmanager
def as_thread(thread: int, threads: int, gate: wp.array) -> Iterator[None]:
    """Record for one thread of a team."""
    token = _recording.set(_Recording(thread, threads, gate) if threads > 1 else None)
    try:
        yield
    finally:
        _recording.reset(token)
