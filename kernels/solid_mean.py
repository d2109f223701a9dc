"""Mean strains of solids over a step, for steps that conserve energy, as those of surfaces (surface_mean.py)."""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes


@functools.cache
def solid_mean(width: int, real: Any) -> SimpleNamespace:
    """Kernel ``shift_rest`` for one lane width and precision."""
    words = lanes(width, real)
    V = words.V
    load1, load3, store1, dot3 = words.load1, words.load3, words.store1, words.dot3
    half = real(0.5)
    module = kernel_module("solid_mean", width, real)

    @wp.func
    def moved(r: wp.array3d(dtype=real), start: wp.array3d(dtype=real), i: int, j: int, k: int, m: int):
        """How far the way of (k, m) since the start differs from that of (i, j)."""
        return (load3(r, 0, k, m) - load3(r, 0, i, j)) - (load3(start, 0, k, m) - load3(start, 0, i, j))

    @wp.func
    def face(d: V, a: V, b: V):
        e = a - b
        return half * (dot3(d, d) - dot3(e, e))

    @wp.kernel(module=module)
    def shift_rest(
        first: int,
        u: int,
        r: wp.array3d(dtype=real),
        start: wp.array3d(dtype=real),
        q0: wp.array3d(dtype=real),
        q_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        a, b, c = moved(r, start, i, j, i + u, j), moved(r, start, i, j, i + 1, j), moved(r, start, i, j, i, j + 1)
        store1(q_out, 0, i, j, load1(q0, 0, i, j) - half * dot3(a, a))
        store1(q_out, 1, i, j, load1(q0, 1, i, j) - half * dot3(b, b))
        store1(q_out, 2, i, j, load1(q0, 2, i, j) - half * dot3(c, c))
        store1(q_out, 3, i, j, load1(q0, 3, i, j) - face(moved(r, start, i, j, i + u + 1, j), a, b))
        store1(q_out, 4, i, j, load1(q0, 4, i, j) - face(moved(r, start, i, j, i + u, j + 1), a, c))
        store1(q_out, 5, i, j, load1(q0, 5, i, j) - face(moved(r, start, i, j, i + 1, j + 1), b, c))

    return SimpleNamespace(module=module, shift_rest=shift_rest)
