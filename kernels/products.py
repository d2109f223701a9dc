"""The end of a product with A: mass or node blocks, the gathered elastic forces, and what is made of the sum at once.

An elastic term writes fluxes and names a word that gathers them at a node (`Gathering`); these kernels put the rest
around it, so that the product itself need not go through memory. S is M / tau^2, or the node blocks B that hold it:

    product   q = S p + gathered
    smooth    r = r - A d;  d = keep d + rate D^-1 r;  z = z + d    a step of the smoother (linear/smoother.py)
    retire    r = r - A d, and with blocks d = F' r, which goes to the coarse grid (F = D^-1 E, kernels/multigrid.py)

They begin at `first`, the first row of nodes, because gathering reads neighbours. A is masked: r does not change at
pins. The new d is not written over the old one, of which fluxes of other rows are still to be made.
"""

import functools
from types import SimpleNamespace
from typing import Any, NamedTuple

import warp as wp

from warpdeform.kernels.choice import BOUNDED, LONG
from warpdeform.kernels.lanes import kernel_module, lanes

# Columns of the rates of a smoother.
KEEP = wp.constant(0)
RATE = wp.constant(1)


class Gathering(NamedTuple):
    """How an elastic term gathers its fluxes.

    Attributes:
        name: Name of the variant, part of the modules' names.
        gathered: Word (fluxes, i, j) that gives the force on the nodes of a lane group.
        Fluxes: Struct of the arrays that it reads.
    """

    name: str
    gathered: Any
    Fluxes: Any


@functools.cache
def products(width: int, real: Any, gathering: Gathering, with_blocks: bool) -> SimpleNamespace:
    """Kernels for one lane width, precision and elastic term.

    Args:
        width: Lane width.
        real: ``wp.float32`` or ``wp.float64``.
        gathering: How the term gathers.
        with_blocks: S is an array of node blocks, (6, rows, columns), instead of masses, (1, rows, columns).
    """
    words, gathered, Fluxes = lanes(width, real), gathering.gathered, gathering.Fluxes
    load1, load3, load6, store3 = words.load1, words.load3, words.load6, words.store3
    scale, apply6, splat = words.scale, words.apply6, words.splat
    module = kernel_module(f"products_{gathering.name}{'_blocks' * with_blocks}", width, real)

    @wp.func
    def product_at(
        fluxes: Fluxes, S: wp.array3d(dtype=real), inertia: wp.array(dtype=real), p: wp.array3d(dtype=real),
        i: int, j: int,
    ):  # fmt: skip
        if wp.static(with_blocks):
            return gathered(fluxes, i, j) + apply6(load6(S, 0, i, j), load3(p, 0, i, j))
        else:
            return gathered(fluxes, i, j) + scale(inertia[0] * load1(S, 0, i, j), load3(p, 0, i, j))

    @wp.kernel(module=module)
    def product(
        first: int,
        fluxes: Fluxes,
        S: wp.array3d(dtype=real),
        inertia: wp.array(dtype=real),
        p: wp.array3d(dtype=real),
        q_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        store3(q_out, 0, i, j, product_at(fluxes, S, inertia, p, i, j))

    @wp.kernel(module=module)
    def smooth(
        first: int,
        fluxes: Fluxes,
        S: wp.array3d(dtype=real),
        inertia: wp.array(dtype=real),
        free: wp.array3d(dtype=real),
        inverse: wp.array3d(dtype=real),
        rates: wp.array3d(dtype=real),
        caution: wp.array(dtype=wp.int32),
        step: int,
        d: wp.array3d(dtype=real),
        r_out: wp.array3d(dtype=real),
        d_out: wp.array3d(dtype=real),
        z_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        f, which = load1(free, 0, i, j), caution[BOUNDED] + 2 * caution[LONG]
        residual = load3(r_out, 0, i, j) - scale(f, product_at(fluxes, S, inertia, d, i, j))
        change = scale(rates[which, step, RATE] * f, apply6(load6(inverse, 0, i, j), residual))
        change = change + scale(splat(rates[which, step, KEEP]), load3(d, 0, i, j))
        store3(r_out, 0, i, j, residual)
        store3(d_out, 0, i, j, change)
        store3(z_out, 0, i, j, load3(z_out, 0, i, j) + change)

    @wp.kernel(module=module)
    def retire(
        first: int,
        fluxes: Fluxes,
        S: wp.array3d(dtype=real),
        inertia: wp.array(dtype=real),
        free: wp.array3d(dtype=real),
        elastic: wp.array3d(dtype=real),
        inverse: wp.array3d(dtype=real),
        d: wp.array3d(dtype=real),
        r_out: wp.array3d(dtype=real),
        d_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + first, (group + 1) * width
        q = scale(load1(free, 0, i, j), product_at(fluxes, S, inertia, d, i, j))
        r = load3(r_out, 0, i, j) - q
        store3(r_out, 0, i, j, r)
        if wp.static(with_blocks):
            store3(d_out, 0, i, j, apply6(load6(elastic, 0, i, j), apply6(load6(inverse, 0, i, j), r)))

    return SimpleNamespace(module=module, product=product, smooth=smooth, retire=retire)
