"""The streaming bandwidth that passes are compared with: plain copies and triads over arrays of their size."""

# mypy: ignore-errors
# Device code is typed for Warp, whose annotations are values.

import functools
from functools import partial
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.study.bench.sampling import Sample


@functools.cache
def streams(width: int, real: Any) -> SimpleNamespace:
    """Streaming kernels in the words of the lane kernels, for one lane width and precision.

    They go through one vector after another, row by row, with as many threads per row as the launch has: what a memory
    likes best.
    """
    words = lanes(width, real)
    load3, store3, scale, splat = words.load3, words.store3, words.scale, words.splat
    half = real(0.5)
    module = kernel_module("stream", width, real)

    @wp.kernel(module=module)
    def copy(a: wp.array3d(dtype=real), threads: int, b_out: wp.array3d(dtype=real)):
        k, ii, thread = wp.tid()
        i = ii + 1
        for group in range(thread, a.shape[2] // width - 2, threads):
            j = (group + 1) * width
            store3(b_out, 3 * k, i, j, load3(a, 3 * k, i, j))

    @wp.kernel(module=module)
    def triad(a: wp.array3d(dtype=real), b: wp.array3d(dtype=real), threads: int, c_out: wp.array3d(dtype=real)):
        k, ii, thread = wp.tid()
        i, share = ii + 1, splat(half)
        for group in range(thread, a.shape[2] // width - 2, threads):
            j = (group + 1) * width
            store3(c_out, 3 * k, i, j, load3(a, 3 * k, i, j) + scale(share, load3(b, 3 * k, i, j)))

    return SimpleNamespace(copy=copy, triad=triad)


class Stream:
    """Samples of a copy and a triad over arrays of some size on the grid of a sheet.

    Args:
        sheet: The sheet or block: its grid, lane width, precision and device.
        vectors: Vectors per node in all arrays together; each array gets the nearest whole share.
    """

    def __init__(self, sheet: Any, vectors: int) -> None:
        kernels = streams(sheet.width, sheet.real)
        self._kinds = (_Kind(sheet, kernels.copy, 2, vectors), _Kind(sheet, kernels.triad, 3, vectors))

    def time(self) -> None:
        """Take one more time of each."""
        for kind in self._kinds:
            kind.time()

    def gb_per_s(self) -> float:
        """What the faster one reached, by the minima [GB/s]; each array counts once, as in STREAM."""
        return max(kind.gb_per_s() for kind in self._kinds)


class _Kind(Sample):
    """Samples of one streaming kernel over arrays of its own."""

    def __init__(self, sheet: Any, kernel: Any, arrays: int, vectors: int) -> None:
        each = max(1, round(vectors / arrays))
        *given, out = (sheet.numbers(3 * each) for _ in range(arrays))
        rows, groups = sheet.dim
        threads = groups if sheet.device.is_cuda else 1
        self._bytes_per_node = arrays * each * sheet.vector_size
        inputs, dim = [*given, threads], (each, rows, threads)
        launch = partial(wp.launch, kernel, dim=dim, inputs=inputs, outputs=[out], device=sheet.device)
        super().__init__(launch, sheet.node_count, sheet.device)

    def gb_per_s(self) -> float:
        return 1e-9 * self._bytes_per_node / min(self.seconds)
