"""Bytes and operations of the kernels that something launches, counted without running them."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import prod
from typing import Any

import warp as wp

from warpdeform.study.bench.interpreter import Thread, run_thread

LINE = 64
"""Bytes of a cache line: what a single entry far from the next one costs."""


@dataclass(frozen=True)
class Launch:
    """A launch that was asked for.

    Attributes:
        kernel: The kernel.
        threads: Threads along each axis.
        arguments: The arguments in the order of the kernel's parameters.
        loops: Owners of the device loops around it, the outermost first.
    """

    kernel: wp.Kernel
    threads: tuple[int, ...]
    arguments: tuple[Any, ...]
    loops: tuple[Any, ...] = ()


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
def recorded_launches() -> Iterator[list[Launch]]:
    """Note kernel launches instead of making them; the bodies of device loops run once.

    Yields:
        The launches so far. Fills and copies of arrays are no launches: they happen, and are not in the list.
    """
    launches: list[Launch] = []
    loops: list[Any] = []
    module: Any = wp  # the one place where every launch goes by
    originals = module.launch, module.capture_while

    def launch(
        kernel: wp.Kernel, dim: int | Sequence[int], inputs: Iterable[Any] = (), outputs: Iterable[Any] = (), **_: Any
    ) -> None:
        threads = (dim,) if isinstance(dim, int) else tuple(dim)
        launches.append(Launch(kernel, threads, (*inputs, *outputs), tuple(loops)))

    def capture_while(condition: wp.array, while_body: Callable[..., None], **arguments: Any) -> None:
        loops.append(getattr(while_body, "__self__", while_body))
        while_body(**arguments)
        loops.pop()

    module.launch, module.capture_while = launch, capture_while
    try:
        yield launches
    finally:
        module.launch, module.capture_while = originals


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
        for part in (_components(launch, thread), _cells(launch, thread)):
            for (position, component), size, accesses in part:
                moved += size * accesses
                key = (launch.arguments[position].ptr, component)
                kept[key] = max(kept.get(key, 0.0), size)
    return Work(moved, flops, sum(kept.values()))


Touched = Iterator[tuple[tuple[int, int | None], float, int]]
"""Argument and component (None: the whole array), its bytes, and whether it is read or written (1) or both (2)."""


def _components(launch: Launch, thread: Thread) -> Touched:
    """Components that go by lane groups: as many entries as the launch has lanes."""
    for position, component in sorted(thread.read | thread.written):
        array = launch.arguments[position]
        entries = min(prod(launch.threads) * thread.width, prod(array.shape[1:]))
        accesses = ((position, component) in thread.read) + ((position, component) in thread.written)
        yield (position, component), entries * _item_size(array), accesses


def _cells(launch: Launch, thread: Thread) -> Touched:
    """Arrays that threads touch entry by entry: cache lines; of narrow lane groups, as much as lies between two."""
    for position in sorted({where for where, _ in thread.read_cells | thread.written_cells}):
        array = launch.arguments[position]
        for cells in (thread.read_cells, thread.written_cells):
            own = [index for where, index in cells if where == position]
            lines = len({index * _item_size(array) // LINE for index in own})
            size = lines * LINE
            if len(launch.threads) > 1:  # a thread per lane group, not per row
                size = min(size, len(own) * thread.width * _item_size(array))
            if own:
                yield (position, None), min(prod(launch.threads) * size, array.size * _item_size(array)), 1


def _item_size(array: wp.array) -> int:
    return int(wp.types.type_size_in_bytes(array.dtype))
