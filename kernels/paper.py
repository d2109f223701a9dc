"""The simplified elastic force of the paper, as published (Terzopoulos et al. 1987, section 6.2).

With forward differences D1, D2, second differences D11, D22 and the forward cross difference D12 of the positions r,

    alpha_ij = eta_ij (D_i r . D_j r - G0_ij)         beta_ij = xi_ij (n . D_ij r - B0_ij)
    e = K(r) r,    K(r) u = sum over i, j of -D-_i (alpha_ij D_j u) + D-_ij (beta_ij D_ij u)

D- being the backward differences, which are the adjoints of the forward ones. Samples that reach beyond a border are
zero, by their weights (the paper's natural boundary conditions). Differences are undivided: eta and xi carry spacings
and the area of the sample. n, which the paper leaves open, is along central differences, at a border one-sided ones.

What is wrong with it is told in design 1.2: the metric part is the gradient of the paper's energy, the curvature part
is not; where a flat sheet is at rest it has no stiffness, and pushes away from flat for one sign of beta.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.products import Gathering
from warpdeform.kernels.surface_geometry import geometry

MEASURED = 6
"""G11, G22, G12 and, on bending surfaces, B11, B22, B12 of a node; likewise eta and xi, alpha and beta."""
FLUX_COMPONENTS = 15
"""alpha_1j D_j u, alpha_2j D_j u; beta_11 D11 u, beta_22 D22 u, beta_12 D12 u."""


@functools.cache
def paper(width: int, real: Any, bending: bool) -> SimpleNamespace:
    """Kernels for one lane width and precision, with or without curvature.

    Returns:
        Kernels ``measure``, ``freeze`` and ``product``, and ``gathering``.
    """
    words, shape = lanes(width, real), geometry(width, real, True)
    load1, load3, store1, store3 = words.load1, words.load3, words.store1, words.store3
    dot3, scale, mul = words.dot3, words.scale, words.mul
    unit_normal, tangent_u, tangent_v = shape.unit_normal, shape.tangent_u, shape.tangent_v
    second_u, second_v = shape.second_u, shape.second_v
    two = real(2.0)
    module = kernel_module(f"paper{'_bending' * bending}", width, real)

    @wp.func
    def forward(r: wp.array3d(dtype=real), i: int, j: int):
        """D1, D2 and D12."""
        r00, r10 = load3(r, 0, i, j), load3(r, 0, i + 1, j)
        r01, r11 = load3(r, 0, i, j + 1), load3(r, 0, i + 1, j + 1)
        return r10 - r00, r01 - r00, (r11 - r10) - (r01 - r00)

    @wp.kernel(module=module)
    def measure(
        r: wp.array3d(dtype=real),
        alpha_u: wp.array3d(dtype=real),
        alpha_v: wp.array3d(dtype=real),
        floor: real,
        measured_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d1, d2, d12 = forward(r, i, j)
        store1(measured_out, 0, i, j, dot3(d1, d1))
        store1(measured_out, 1, i, j, dot3(d2, d2))
        store1(measured_out, 2, i, j, dot3(d1, d2))
        if wp.static(bending):
            n = unit_normal(tangent_u(r, alpha_u, i, j), tangent_v(r, alpha_v, i, j), floor)
            store1(measured_out, 3, i, j, dot3(n, second_u(r, i, j)))
            store1(measured_out, 4, i, j, dot3(n, second_v(r, i, j)))
            store1(measured_out, 5, i, j, dot3(n, d12))

    @wp.kernel(module=module)
    def freeze(
        measured: wp.array3d(dtype=real),
        rest: wp.array3d(dtype=real),
        weights: wp.array3d(dtype=real),
        frozen_out: wp.array3d(dtype=real),
    ):
        """alpha and beta."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        for c in range(wp.static(MEASURED if bending else MEASURED // 2)):
            change = load1(measured, c, i, j) - load1(rest, c, i, j)
            store1(frozen_out, c, i, j, mul(load1(weights, c, i, j), change))

    @wp.kernel(module=module)
    def product(frozen: wp.array3d(dtype=real), u: wp.array3d(dtype=real), flux_out: wp.array3d(dtype=real)):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d1, d2, d12 = forward(u, i, j)
        a11, a22, a12 = load1(frozen, 0, i, j), load1(frozen, 1, i, j), load1(frozen, 2, i, j)
        store3(flux_out, 0, i, j, scale(a11, d1) + scale(a12, d2))
        store3(flux_out, 3, i, j, scale(a12, d1) + scale(a22, d2))
        if wp.static(bending):
            store3(flux_out, 6, i, j, scale(load1(frozen, 3, i, j), second_u(u, i, j)))
            store3(flux_out, 9, i, j, scale(load1(frozen, 4, i, j), second_v(u, i, j)))
            store3(flux_out, 12, i, j, scale(load1(frozen, 5, i, j), d12))

    @wp.struct
    class Fluxes:
        flux: wp.array3d(dtype=real)

    @wp.func
    def gathered(fluxes: Fluxes, i: int, j: int):
        p = fluxes.flux
        f = (load3(p, 0, i - 1, j) - load3(p, 0, i, j)) + (load3(p, 3, i, j - 1) - load3(p, 3, i, j))
        if wp.static(bending):
            f = f + ((load3(p, 6, i + 1, j) - load3(p, 6, i, j)) - (load3(p, 6, i, j) - load3(p, 6, i - 1, j)))
            f = f + ((load3(p, 9, i, j + 1) - load3(p, 9, i, j)) - (load3(p, 9, i, j) - load3(p, 9, i, j - 1)))
            cross = (load3(p, 12, i, j) - load3(p, 12, i - 1, j)) - (
                load3(p, 12, i, j - 1) - load3(p, 12, i - 1, j - 1)
            )
            f = f + two * cross
        return f

    @wp.kernel(module=module)
    def gather(fluxes: Fluxes, force_out: wp.array3d(dtype=real)):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store3(force_out, 0, i, j, load3(force_out, 0, i, j) + gathered(fluxes, i, j))

    return SimpleNamespace(
        module=module,
        measure=measure,
        freeze=freeze,
        product=product,
        gather=gather,
        gathering=Gathering(f"paper{'_bending' * bending}", gathered, Fluxes),
    )
