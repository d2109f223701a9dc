"""Elastic curves: stretch and bending energy, gradient and Hessian product (design 1.3).

Every energy is half a sum of squares q^2 of weighted strains, and the Hessian is Gauss-Newton's, the sum of w w' with
w = dq/dr; weights are roots of stiffnesses over rest lengths (:mod:`warpdeform.forces.curve_coefficients`).

Stretch, per segment with edge b of rest length l0 (design: (EA l0/8) ((|b|^2 - l0^2)/l0^2)^2):

    q = (1/2) R (|b|^2 - l0^2),   w = R b,   R^2 = EA / l0^3,   tension R q, clipped, on top of w w'

Bending, per node with edges a, b and l the mean of their rest lengths: the curvature binormal

    kb = 2 a x b / (|a||b| + a.b),   |kb| = 2 tan(phi/2),   energy (EI/2l)|kb|^2

of a section that bends alike in every direction and of a curve that is straight at rest. Gauss-Newton on all of kb
would count as strain that kb turns. The exact Hessian has of this, but for a negative part, the derivatives of kb along
the two directions n normal to a/|a| + b/|b|: two strains, w = R d(kb.n)/dr, R^2 = EI / l. Sections that do not bend
alike, and curves that are not straight at rest, need a material frame (:mod:`warpdeform.kernels.curve_frame`): three
strains, two curvatures and the twist, with the same products.

Neglected: the rotational inertia of the section, which matters where waves are as short as the section is thick.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.curve_geometry import curve_geometry
from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.products import Gathering

STRETCH_COMPONENTS = 4
"""Linearised stretch of a segment: w, clipped tension."""
SLOPE_COMPONENTS = 6
"""Linearised strain of a node: w by its edge a, then by its edge b."""
SPIN_COMPONENTS = 3
"""Derivatives of a node's three strains by the angle of edge b; by that of edge a the same, the twist's negative."""
FLAT = 1.0e-12
"""Smallest |a/|a| + b/|b||^2 of which a direction is made."""


def variant_name(strains: int) -> str:
    """What the modules of a variant are called."""
    return {0: "string", 2: "straight", 3: "framed"}[strains]


def flux_components(strains: int) -> int:
    """Derivatives of a row's energy by edge b, and by edge a where nodes have strains."""
    return 6 if strains else 3


@functools.cache
def curve(width: int, real: Any, strains: int) -> SimpleNamespace:
    """Kernels of the elastic curve for one lane width, precision and number of strains of a node.

    Args:
        width: Lane width.
        real: ``wp.float32`` or ``wp.float64``.
        strains: 0 without bending, 2 for round sections that are straight at rest, 3 with a material frame.

    Returns:
        Kernels ``product``, ``gather`` and ``measure``, without a frame also ``stress`` and ``energy``, and
        ``gathering``, for products with A.
    """
    words, shape = lanes(width, real), curve_geometry(width, real)
    V = words.V
    load1, load3, store1, store3 = words.load1, words.load3, words.store1, words.store3
    add3, sum_lanes = words.add3, words.sum_lanes
    dot3, cross3, normal3, scale, mul = words.dot3, words.cross3, words.normal3, words.scale, words.mul
    row_before, edges = shape.row_before, shape.edges
    length, unit3, spread = shape.length, shape.unit3, shape.spread
    binormal, binormal_slopes, store_stretch = shape.binormal, shape.binormal_slopes, shape.store_stretch
    half, flat = real(0.5), real(FLAT)
    module = kernel_module(f"curve_{variant_name(strains)}", width, real)

    @wp.kernel(module=module)
    def stress(
        r: wp.array3d(dtype=real),
        loop: int,
        axial: wp.array3d(dtype=real),
        g0: wp.array3d(dtype=real),
        bending: wp.array3d(dtype=real),
        floor: real,
        stretch_out: wp.array3d(dtype=real),
        slopes_out: wp.array3d(dtype=real),
        flux_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        a, b = edges(r, loop, i, j)
        fb = store_stretch(stretch_out, axial, g0, b, i, j)
        if wp.static(strains > 0):
            la, lb = length(a, floor), length(b, floor)
            inverse = spread(a, b, la, lb)
            kb = binormal(a, b, inverse)
            weight = load1(bending, 0, i, j)
            ga, gb = binormal_slopes(a, b, la, lb, inverse, kb, scale(mul(weight, weight), kb))
            store3(flux_out, 3, i, j, ga)
            fb = fb + gb
            tangent = unit3(unit3(a, floor) + unit3(b, floor), flat)
            n = normal3(tangent)
            wa, wb = binormal_slopes(a, b, la, lb, inverse, kb, scale(weight, n))
            store3(slopes_out, 0, i, j, wa)
            store3(slopes_out, 3, i, j, wb)
            wa, wb = binormal_slopes(a, b, la, lb, inverse, kb, scale(weight, cross3(tangent, n)))
            store3(slopes_out, 6, i, j, wa)
            store3(slopes_out, 9, i, j, wb)
        store3(flux_out, 0, i, j, fb)

    @wp.kernel(module=module)
    def product(
        loop: int,
        stretch: wp.array3d(dtype=real),
        slopes: wp.array3d(dtype=real),
        spins: wp.array3d(dtype=real),
        turn: wp.array3d(dtype=real),
        p: wp.array3d(dtype=real),
        flux_out: wp.array3d(dtype=real),
    ):
        """Flux of the displacement p; `turn` is how the angles follow it."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        before = row_before(i, loop)
        pa, pb = edges(p, loop, i, j)
        w = load3(stretch, 0, i, j)
        fb = scale(dot3(w, pb), w) + scale(load1(stretch, 3, i, j), pb)
        if wp.static(strains > 0):
            fa = V()
            for k in range(strains):
                wa, wb = load3(slopes, 6 * k, i, j), load3(slopes, 6 * k + 3, i, j)
                q = dot3(wa, pa) + dot3(wb, pb)
                if wp.static(strains == 3):
                    turned = load1(turn, 0, i, j) - load1(turn, 0, before, j)
                    if k < 2:
                        turned = load1(turn, 0, i, j) + load1(turn, 0, before, j)
                    q = q + mul(load1(spins, k, i, j), turned)
                fa = fa + scale(q, wa)
                fb = fb + scale(q, wb)
            store3(flux_out, 3, i, j, fa)
        store3(flux_out, 0, i, j, fb)

    @wp.struct
    class Fluxes:
        flux: wp.array3d(dtype=real)

    @wp.func
    def gathered(fluxes: Fluxes, i: int, j: int):
        """Force on a node: it ends the edge before it and begins the one behind it."""
        flux = fluxes.flux
        f = load3(flux, 0, i - 1, j) - load3(flux, 0, i, j)
        if wp.static(strains > 0):
            f = f + (load3(flux, 3, i, j) - load3(flux, 3, i + 1, j))
        return f

    @wp.kernel(module=module)
    def gather(fluxes: Fluxes, force_out: wp.array3d(dtype=real)):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        add3(force_out, 0, i, j, gathered(fluxes, i, j))

    @wp.kernel(module=module)
    def energy(
        r: wp.array3d(dtype=real),
        loop: int,
        axial: wp.array3d(dtype=real),
        g0: wp.array3d(dtype=real),
        bending: wp.array3d(dtype=real),
        floor: real,
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        a, b = edges(r, loop, i, j)
        q = half * mul(load1(axial, 0, i, j), dot3(b, b) - load1(g0, 0, i, j))
        w = mul(q, q)
        if wp.static(strains > 0):
            kb = binormal(a, b, spread(a, b, length(a, floor), length(b, floor)))
            weight = load1(bending, 0, i, j)
            w = w + mul(mul(weight, weight), dot3(kb, kb))
        partials_out[i, j] = partials_out[i, j] + wp.float64(0.5) * sum_lanes(w)

    @wp.kernel(module=module)
    def measure(
        r: wp.array3d(dtype=real),
        loop: int,
        floor: real,
        metric_out: wp.array3d(dtype=real),
        binormal_out: wp.array3d(dtype=real),
    ):
        """|b|^2 of the segments and kb of the nodes."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        a, b = edges(r, loop, i, j)
        store1(metric_out, 0, i, j, dot3(b, b))
        if wp.static(strains > 0):
            store3(binormal_out, 0, i, j, binormal(a, b, spread(a, b, length(a, floor), length(b, floor))))

    gathering = Gathering(f"curve_{variant_name(strains)}", gathered, Fluxes)
    kernels = {"product": product, "gather": gather, "measure": measure, "gathering": gathering}
    if strains < 3:
        kernels |= {"stress": stress, "energy": energy}
    return SimpleNamespace(module=module, **kernels)
