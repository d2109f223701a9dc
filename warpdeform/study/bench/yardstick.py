"""The yardstick: a plain membrane flux pass over lanes, whose time tells what this machine can do.

A membrane without material law and without warped cells, in the kernel shape of the surface kernels (design 2.3): per
cell two edges and one mean shear, a Hessian product by fluxes. Benchmarks divide by its time, so that figures from
different or busy machines can be compared.
"""

# mypy: ignore-errors
# Device code is typed for Warp, whose annotations are values.

import functools
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes

WEIGHTS = 5
"""Stiffness of u-edge, v-edge and shear; tension of u-edge and v-edge."""
FLUXES = 6
"""Flux through the edge and through the cell, along one axis."""


@functools.cache
def yardstick(width: int, real: Any) -> wp.Kernel:
    """The flux pass for one lane width and precision."""
    words = lanes(width, real)
    load1, load3, store3 = words.load1, words.load3, words.store3
    dot3, scale, mul = words.dot3, words.scale, words.mul
    half = real(0.5)
    module = kernel_module("yardstick", width, real)

    @wp.kernel(module=module)
    def yardstick_flux(
        r: wp.array3d(dtype=real),
        weights: wp.array3d(dtype=real),
        per_spacing: real,
        p: wp.array3d(dtype=real),
        flux_u_out: wp.array3d(dtype=real),
        flux_v_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        r00, r10, r01, r11 = load3(r, 0, i, j), load3(r, 0, i + 1, j), load3(r, 0, i, j + 1), load3(r, 0, i + 1, j + 1)
        p00, p10, p01, p11 = load3(p, 0, i, j), load3(p, 0, i + 1, j), load3(p, 0, i, j + 1), load3(p, 0, i + 1, j + 1)
        edge_u, edge_v = per_spacing * (r10 - r00), per_spacing * (r01 - r00)
        change_u, change_v = per_spacing * (p10 - p00), per_spacing * (p01 - p00)
        pull_u = mul(load1(weights, 0, i, j), dot3(edge_u, change_u))
        pull_v = mul(load1(weights, 1, i, j), dot3(edge_v, change_v))
        store3(flux_u_out, 0, i, j, scale(pull_u, edge_u) + scale(load1(weights, 3, i, j), change_u))
        store3(flux_v_out, 0, i, j, scale(pull_v, edge_v) + scale(load1(weights, 4, i, j), change_v))
        mean_u, mean_v = half * per_spacing * (r10 + r11 - r00 - r01), half * per_spacing * (r01 + r11 - r00 - r10)
        turn_u, turn_v = half * per_spacing * (p10 + p11 - p00 - p01), half * per_spacing * (p01 + p11 - p00 - p10)
        shear = mul(load1(weights, 2, i, j), dot3(mean_v, turn_u) + dot3(mean_u, turn_v))
        store3(flux_u_out, 3, i, j, scale(shear, mean_v))
        store3(flux_v_out, 3, i, j, scale(shear, mean_u))

    return yardstick_flux
