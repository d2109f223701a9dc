"""Runs one thread of a kernel in Python on numbers that count: what it computes and which array components it touches.

A kernel's source is the only statement of its work, so the counts cannot rot. The functions are those that Warp
compiles, with other things behind their names: arrays note their accesses, numbers note the operations on them. The
words that touch memory or join lanes are counted here; every other word counts by its scalar body.
"""

import inspect
import types
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import warp as wp

from warpdeform.errors import WarpdeformError
from warpdeform.kernels.lanes import lanes

MOST_FLOPS = 1_000_000
"""Operations after which a thread is taken to loop on what only a device knows."""
SCALARS = (wp.float16, wp.float32, wp.float64, wp.int32, wp.int64)


class UncountableError(WarpdeformError):
    """A kernel does something that only a device can do, such as asking a mesh."""


@dataclass
class Thread:
    """What one thread of a kernel did.

    Attributes:
        width: Lanes of the kernel.
        flops: Floating-point operations of all its lanes: additions, products, quotients, roots, maxima, one each.
        arrays: The arrays that it met, those in structs included.
        read: Components read over whole lane groups, as (place in `arrays`, component).
        written: The same, written.
        picked: Components of which lanes picked entries here and there.
        read_cells: Single entries read, as (place in `arrays`, index in memory order).
        written_cells: The same, written.
    """

    width: int
    flops: int = 0
    arrays: list[wp.array] = field(default_factory=list)
    picked: set[tuple[int, int]] = field(default_factory=set)
    read: set[tuple[int, int]] = field(default_factory=set)
    written: set[tuple[int, int]] = field(default_factory=set)
    read_cells: set[tuple[int, int]] = field(default_factory=set)
    written_cells: set[tuple[int, int]] = field(default_factory=set)

    def number(self, *operands: Any) -> Any:
        """The result of one operation."""
        width = max((n.lanes for n in operands if isinstance(n, _Number)), default=1)
        self.flops += width
        if self.flops > MOST_FLOPS * self.width:
            raise UncountableError("it does not come to an end")
        return _Number(self, width)


def run_thread(kernel: wp.Kernel, threads: Sequence[int], arguments: Sequence[Any]) -> Thread:
    """Run the first thread of a launch.

    Args:
        kernel: The kernel.
        threads: Threads along each axis of the launch.
        arguments: The arguments of the launch; arrays are looked at for their shape alone.

    Raises:
        UncountableError: The kernel cannot be run this way.
    """
    width = inspect.getclosurevars(kernel.func).nonlocals.get("width", 1)
    thread = Thread(width)
    world = _World(thread, 0 if len(threads) == 1 else (0,) * len(threads))
    try:
        world.stand_in(kernel.func)(*(_argument(thread, a) for a in arguments))
    except (TypeError, AttributeError, LookupError, ValueError, UncountableError) as error:
        raise UncountableError(f"the work of {kernel.key} cannot be counted: {error}") from error
    return thread


class _Number:
    """A real number, or one for each lane; every operation on it counts, every comparison holds."""

    def __init__(self, thread: Thread, width: int) -> None:
        self._thread, self.lanes = thread, width

    def _operation(self, other: Any) -> Any:
        return NotImplemented if isinstance(other, np.ndarray) else self._thread.number(self, other)

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _operation

    def __neg__(self) -> "_Number":
        return self

    def _holds(self, other: Any) -> bool:
        return True

    __lt__ = __le__ = __gt__ = __ge__ = _holds


class _Array:
    """An array argument: its shape, and a note of every access."""

    def __init__(self, thread: Thread, array: wp.array) -> None:
        self._thread, self._place, self.shape = thread, len(thread.arrays), array.shape
        thread.arrays.append(array)

    def load(self, component: int) -> _Number:
        self._thread.read.add((self._place, component))
        return _Number(self._thread, self._thread.width)

    def pick(self, component: int) -> _Number:
        self._thread.picked.add((self._place, component))
        return _Number(self._thread, self._thread.width)

    def store(self, component: int) -> None:
        self._thread.written.add((self._place, component))

    def _cell(self, index: Any) -> tuple[int, int]:
        """An entry; where a number of the device is the index, the first stands for all."""
        known = (0 if isinstance(k, _Number) else k for k in (index if isinstance(index, tuple) else (index,)))
        return self._place, int(np.ravel_multi_index(tuple(known), self.shape))

    def __getitem__(self, index: Any) -> _Number:
        self._thread.read_cells.add(self._cell(index))
        return _Number(self._thread, 1)

    def __setitem__(self, index: Any, value: Any) -> None:
        self._thread.written_cells.add(self._cell(index))


class _Struct:
    """A struct argument: its members as arguments of their own."""

    def __init__(self, thread: Thread, struct: Any) -> None:
        self._thread, self._struct = thread, struct

    def __getattr__(self, name: str) -> Any:
        member = _argument(self._thread, getattr(self._struct, name))
        setattr(self, name, member)  # the same array at every access
        return member


class _World:
    """What the names in a kernel's source stand for."""

    def __init__(self, thread: Thread, index: int | tuple[int, ...]) -> None:
        self._thread = thread
        self._scalar_words = vars(lanes(1, wp.float32))
        self._words: dict[str, Callable[..., Any]] = {
            "splat": lambda x: _Number(thread, thread.width),
            "sum_lanes": self._join,
            "max_lanes": self._join,
        }
        for name, components in (("1", 1), ("3", 3), ("6", 6)):
            self._words[f"load{name}"] = self._load(components)
            self._words[f"pick{name}"] = self._pick(components)
            self._words[f"store{name}"] = self._store(components)
        self._warp = _Warp(self, thread, index)

    def stand_in(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function with everything behind its names replaced."""
        closed = [types.CellType(self.value(cell.cell_contents)) for cell in function.__closure__ or ()]
        names = {
            name: function.__globals__[name] for name in function.__code__.co_names if name in function.__globals__
        }
        known = {name: self._warp if value is wp else self.value(value) for name, value in names.items()}
        return types.FunctionType(function.__code__, known, function.__name__, function.__defaults__, tuple(closed))

    def value(self, value: Any) -> Any:
        """What stands for a value: functions, types and constants of Warp are replaced, all else stays."""
        if isinstance(value, wp.Function):
            return self._function(value)
        if isinstance(value, types.SimpleNamespace):
            return types.SimpleNamespace(**{name: self.value(part) for name, part in vars(value).items()})
        if isinstance(value, type) and hasattr(value, "_shape_"):
            return _vector(value._shape_[0]) if value._shape_[0] in (3, 6) else _plain
        return _plain if value in SCALARS else _plain(value)

    def _function(self, function: Any) -> Callable[..., Any]:
        name = function.func.__name__
        if name in self._words:
            return self._words[name]
        if function.native_snippet is not None:
            return self.stand_in(self._scalar_words[name].func)
        return lambda *arguments: self.stand_in(function.func)(*arguments)

    def _join(self, a: _Number) -> _Number:
        """One number of all lanes."""
        self._thread.flops += a.lanes - 1
        return _Number(self._thread, 1)

    def _load(self, components: int) -> Callable[..., Any]:
        def load(a: _Array, first: int, i: int, j: int) -> Any:
            return _together([a.load(first + k) for k in range(components)])

        return load

    def _pick(self, components: int) -> Callable[..., Any]:
        def pick(a: _Array, first: int, i: int, columns: _Array, tap: int, j: int) -> Any:
            columns.load(tap)
            return _together([a.pick(first + k) for k in range(components)])

        return pick

    def _store(self, components: int) -> Callable[..., None]:
        def store(a: _Array, first: int, i: int, j: int, value: Any) -> None:
            for k in range(components):
                a.store(first + k)

        return store


class _Warp:
    """The name `wp` inside a kernel."""

    def __init__(self, world: _World, thread: Thread, index: int | tuple[int, ...]) -> None:
        self._world, self._thread, self._index = world, thread, index

    def tid(self) -> int | tuple[int, ...]:
        return self._index

    def static(self, value: Any) -> Any:
        return value

    def __getattr__(self, name: str) -> Any:
        """A type converts; a function counts as one operation."""
        return _plain if getattr(wp, name) in SCALARS else self._thread.number


def _plain(value: Any = 0.0) -> Any:
    """A constant of Warp as a number of Python; anything else as it is."""
    return value.value if isinstance(value, SCALARS) else value


def _argument(thread: Thread, argument: Any) -> Any:
    """What stands for an argument of a kernel, or a member of a struct."""
    if isinstance(argument, wp.array):
        return _Array(thread, argument)
    return _plain(argument) if isinstance(argument, (bool, int, float, *SCALARS)) else _Struct(thread, argument)


def _together(components: list[_Number]) -> Any:
    return components[0] if len(components) == 1 else np.array(components, dtype=object)


def _vector(length: int) -> Callable[..., Any]:
    def vector(*components: Any) -> Any:
        return np.array(components or [0.0] * length, dtype=object)

    return vector
