"""Where the threads of a step wait for each other (CPU only)."""

import functools
from types import SimpleNamespace

import warp as wp

from warpdeform.kernels.lanes import kernel_module

# The last one to come opens the gate for all. The others spin: a wait takes a microsecond, less than falling asleep
# does; after some time they offer their core to whoever wants it, maybe the one they wait for.
_MEET = """
#if !defined(__CUDA_ARCH__)
    typedef int function();
    int* waiting = (int*)&wp::index(gate, 0);
    const int round = __atomic_load_n(waiting + 1, __ATOMIC_ACQUIRE);
    if (__atomic_add_fetch(waiting, 1, __ATOMIC_ACQ_REL) == threads) {
        __atomic_store_n(waiting, 0, __ATOMIC_RELAXED);
        __atomic_store_n(waiting + 1, round + 1, __ATOMIC_RELEASE);
    } else {
        for (int spins = 0; __atomic_load_n(waiting + 1, __ATOMIC_ACQUIRE) == round; ++spins) {
            if (spins > 500 && give_way) ((function*)give_way)();
#if defined(__x86_64__)
            __builtin_ia32_pause();
#endif
        }
    }
#endif
"""

GATE = 32
"""Entries of a gate: those that wait, the round; the rest keeps other data out of their cache line."""


@functools.cache
def meeting() -> SimpleNamespace:
    """The kernel ``meet``: every thread launches it once, and none goes on before all have come."""
    module = kernel_module("meeting", 1, wp.float32)

    @wp.func_native(_MEET)
    def wait(gate: wp.array(dtype=wp.int32), threads: int, give_way: wp.uint64): ...

    @wp.kernel(module=module)
    def meet(gate: wp.array(dtype=wp.int32), threads: int, give_way: wp.uint64):
        """`give_way` is the address of the function by which the system lets a thread yield its core, or 0."""
        wait(gate, threads, give_way)

    return SimpleNamespace(meet=meet)
