"""Bytes and operations of the kernels that something launches, counted without running them."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import prod
from typing import Any

import warp as wp

from warpdeform.study.bench.interpreter import SCALARS, Thread, UncountableError, run_thread

LINE = 64
"""Bytes of a cache line: what a single entry far from the next one costs."""


@dataclass(frozen=True)
class Launch:
    """A launch that was asked for.

    Attributes:
        kernel: The kernel.
        threads: Threads along each axis.
        arguments: The arguments in the order of the kernel's parameters.
    """

    kernel: wp.Kernel
    threads: tuple[int, ...]
    arguments: tuple[Any, ...]


@dataclass(frozen=True)
class Work:
    """Compulsory work of some launches.

    Each component of an array that a launch touches counts once for reading and once for writing, whatever its
    neighbours read again; a component that stays in the cache between two launches counts in both.

    Attributes:
        bytes: Bytes read and written, launch by launch.
        flops: Floating-point operations.
        working_set: Bytes of all components that any of the launches touches.
    """

    bytes: float
    flops: float
    working_set: float


@contextmanager
def watched_launches(seen: Callable[[Launch], None], *, run: bool) -> Iterator[None]:
    """Hear of every kernel launch in the body; fills and copies of arrays are none.

    Args:
        seen: Told about each launch.
        run: Make the launches too.
    """
    module: Any = wp  # the one place where every launch goes by
    original = module.launch

    def launch(
        kernel: wp.Kernel, dim: int | Sequence[int], inputs: Sequence[Any] = (), outputs: Sequence[Any] = (), **how: Any
    ) -> None:
        seen(Launch(kernel, (dim,) if isinstance(dim, int) else tuple(dim), (*inputs, *outputs)))
        if run:
            original(kernel, dim, inputs=inputs, outputs=outputs, **how)

    module.launch = launch
    try:
        yield
    finally:
        module.launch = original


@contextmanager
def recorded_launches() -> Iterator[list[Launch]]:
    """Note kernel launches instead of making them.

    Yields:
        The launches so far.
    """
    launches: list[Launch] = []
    with watched_launches(launches.append, run=False):
        yield launches


def count(launches: Sequence[Launch]) -> Work:
    """The work of launches.

    Launches of a single thread decide and do not count.

    Raises:
        UncountableError: A kernel cannot be counted.
    """
    moved, flops = 0.0, 0.0
    kept: dict[tuple[int, int | None], float] = {}
    for launch in launches:
        if prod(launch.threads) == 1:
            continue
        thread = run_thread(launch.kernel, launch.threads, launch.arguments)
        flops += thread.flops * prod(launch.threads)
        for touched in (*_components(launch, thread), *_cells(launch, thread)):
            moved += touched.bytes * touched.accesses
            key = (touched.array.ptr, touched.component)
            kept[key] = max(kept.get(key, 0.0), touched.bytes)
    return Work(moved, flops, sum(kept.values()))


@dataclass(frozen=True)
class _Touched:
    """A component of an array, or all of it (None): its bytes, and once if it is read or written, twice if both."""

    array: wp.array
    component: int | None
    bytes: float
    accesses: int


def _components(launch: Launch, thread: Thread) -> Iterator[_Touched]:
    """Components that go by lane groups, as many entries as the launch has lanes; all entries of picked ones."""
    for key in sorted(thread.read | thread.written | thread.picked):
        array = thread.arrays[key[0]]
        entries = min(prod(array.shape[1:]), prod(launch.threads) * thread.width)
        if key in thread.picked:
            entries = (array.shape[1] - 2) * (array.shape[2] - 2 * thread.width)  # all but the halo
        accesses = (key in thread.read | thread.picked) + (key in thread.written)
        yield _Touched(array, key[1], entries * _item_size(array), accesses)


def _cells(launch: Launch, thread: Thread) -> Iterator[_Touched]:
    """Arrays that threads touch entry by entry: cache lines; of narrow lane groups, as much as lies between two."""
    for place in sorted({place for place, _ in thread.read_cells | thread.written_cells}):
        array = thread.arrays[place]
        for cells in (thread.read_cells, thread.written_cells):
            own = [index for where, index in cells if where == place]
            lines = len({index * _item_size(array) // LINE for index in own})
            size = lines * LINE
            if len(launch.threads) > 1:  # a thread per lane group, not per row
                size = min(size, len(own) * thread.width * _item_size(array))
            if own:
                yield _Touched(array, None, min(prod(launch.threads) * size, array.size * _item_size(array)), 1)


def _item_size(array: wp.array) -> int:
    return int(wp.types.type_size_in_bytes(array.dtype))


class Tally:
    """Bytes of many launches, of which most are alike.

    Attributes:
        bytes: Compulsory traffic so far.
        complete: Whether every kernel could be counted.
    """

    def __init__(self) -> None:
        self.bytes, self.complete = 0.0, True
        self._known: dict[Any, tuple[float, Launch]] = {}  # the launch keeps alive what its key names by identity

    def add(self, launch: Launch) -> None:
        """Count a launch."""
        key = launch.kernel, launch.threads, tuple(map(_look, launch.arguments))
        if key not in self._known:
            try:
                self._known[key] = count([launch]).bytes, launch
            except UncountableError:
                self._known[key], self.complete = (0.0, launch), False
        self.bytes += self._known[key][0]


def _look(argument: Any) -> Any:
    """What of an argument matters for the work of a launch."""
    if isinstance(argument, wp.array):
        return argument.shape, argument.dtype
    if isinstance(argument, int):
        return argument
    return None if isinstance(argument, (float, *SCALARS)) else id(argument)
