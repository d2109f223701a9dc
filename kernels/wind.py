"""The force of the air (design 1.1): the paper's viscous force c (n.v) n, on whatever faces the air.

v = u - (z - w)/tau is the slip: u the velocity of the air, z the unknown position, (z - w)/tau its velocity. A node has
faces, each with a share A of the area at rest and a direction f; a face catches the part M v of the slip:

    body     faces of a node                                        direction f       M
    curve    one, of length times diameter                          tangent           1 - f f'
    surface  one                                                    normal            f f'
    solid    three: those at the ends of u, v, w, A = 0 elsewhere   normals           f f'

    potential of a face  c A d.M (d/(2 tau) - u),  d = z - w;  gradient  c A M (d/tau - u);  block  (c A/tau) M

f and u are frozen where gradients are taken, so that the force is the exact gradient of its potential, which is
relative to z = w: with constants left out it keeps its digits in float32. Outside the body A and f are zero, and so is
every result.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes

FACES = {"curve": 1, "surface": 1, "solid": 3}
"""Faces of a node of each kind of body."""


@functools.cache
def wind(width: int, real: Any, kind: str) -> SimpleNamespace:
    """Kernels of the force on one kind of body, for one lane width and precision.

    `facing` holds the directions of a node's faces and behind them u, (3 faces + 3, rows, columns); `area` their
    shares, (faces, rows, columns); `air` c [kg/(m2 s)] and 1/tau [1/s].

    Returns:
        Kernels ``add_energy``, ``add_gradient`` and ``add_blocks``.
    """
    words = lanes(width, real)
    load1, load3, add3, add6, V = words.load1, words.load3, words.add3, words.add6, words.V
    dot3, scale, scale6, mul, outer, sum_lanes, splat = (
        words.dot3, words.scale, words.scale6, words.mul, words.outer, words.sum_lanes, words.splat,
    )  # fmt: skip
    isotropic = words.isotropic
    half, faces, across = real(0.5), FACES[kind], kind == "curve"
    module = kernel_module(f"wind_{kind}", width, real)

    @wp.func
    def caught(f: V, v: V):
        along = scale(dot3(f, v), f)
        if wp.static(across):
            return v - along
        return along

    @wp.kernel(module=module)
    def add_energy(
        area: wp.array3d(dtype=real),
        facing: wp.array3d(dtype=real),
        base: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        air: wp.array(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d = load3(position, 0, i, j) - load3(base, 0, i, j)
        slip = scale(splat(half * air[1]), d) - load3(facing, 3 * faces, i, j)
        energy = splat(real(0.0))
        for k in range(faces):
            energy = energy + mul(load1(area, k, i, j), dot3(d, caught(load3(facing, 3 * k, i, j), slip)))
        partials_out[i, j] = partials_out[i, j] + sum_lanes(air[0] * energy)

    @wp.kernel(module=module)
    def add_gradient(
        area: wp.array3d(dtype=real),
        facing: wp.array3d(dtype=real),
        base: wp.array3d(dtype=real),
        position: wp.array3d(dtype=real),
        air: wp.array(dtype=real),
        gradient_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d = load3(position, 0, i, j) - load3(base, 0, i, j)
        slip = scale(splat(air[1]), d) - load3(facing, 3 * faces, i, j)
        for k in range(faces):
            add3(gradient_out, 0, i, j, scale(air[0] * load1(area, k, i, j), caught(load3(facing, 3 * k, i, j), slip)))

    @wp.kernel(module=module)
    def add_blocks(
        area: wp.array3d(dtype=real),
        facing: wp.array3d(dtype=real),
        air: wp.array(dtype=real),
        blocks_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        for k in range(faces):
            f = load3(facing, 3 * k, i, j)
            block = outer(f, f)
            if wp.static(across):
                block = isotropic(splat(real(1.0))) - block
            add6(blocks_out, 0, i, j, scale6(air[0] * air[1] * load1(area, k, i, j), block))

    return SimpleNamespace(add_energy=add_energy, add_gradient=add_gradient, add_blocks=add_blocks)


@functools.cache
def facing(width: int, real: Any, kind: str, gusting: bool) -> SimpleNamespace:
    """The kernel that finds out how the nodes of a body face the air, for one lane width and precision.

    It works on the rows from the first row of nodes to the last; u and v of solids lie `stride` rows and one row apart.
    `slopes_rows`, (2 axes, rows, 1), and `slopes_columns`, (2, 1, columns), weigh the differences to the next and from
    the last node: central ones, one-sided at a border.

    Args:
        width: Nodes per lane group.
        real: ``wp.float32`` or ``wp.float64``.
        kind: "curve", "surface" or "solid".
        gusting: Whether there are `waves`, wave vectors [1/m] and amplitudes [m/s], shape (m, 6), with `phases` in
            turns, shape (m,), beside the `mean` stream [m/s], shape (3,) (:class:`warpdeform.wind.Wind`).

    Returns:
        ``face``, which writes what :func:`wind` reads. Where a face is folded to a point (tangents shorter than about
        1e-8 m) its direction shrinks to zero.
    """
    words = lanes(width, real)
    load1, load3, store3, along_u, splat, V, vector = (
        words.load1, words.load3, words.store3, words.along_u, words.splat, words.V, words.vector,
    )  # fmt: skip
    dot3, cross3, scale, div, root, at_least = (
        words.dot3, words.cross3, words.scale, words.div, words.root, words.at_least,
    )  # fmt: skip
    faces = FACES[kind]
    module = kernel_module(f"facing_{kind}_gusts" if gusting else f"facing_{kind}", width, real)
    gust = gusts(width, real) if gusting else None

    @wp.func
    def unit(a: V):
        return scale(div(splat(real(1.0)), root(at_least(dot3(a, a), real(1.0e-30)))), a)

    @wp.func
    def along_rows(position: wp.array3d(dtype=real), slopes: wp.array3d(dtype=real), c: int, step: int, i: int, j: int):
        r = load3(position, 0, i, j)
        forward = scale(along_u(slopes, c, i), load3(position, 0, i + step, j) - r)
        return forward + scale(along_u(slopes, c + 1, i), r - load3(position, 0, i - step, j))

    @wp.func
    def along_columns(position: wp.array3d(dtype=real), slopes: wp.array3d(dtype=real), i: int, j: int):
        r = load3(position, 0, i, j)
        forward = scale(load1(slopes, 0, 0, j), load3(position, 0, i, j + 1) - r)
        return forward + scale(load1(slopes, 1, 0, j), r - load3(position, 0, i, j - 1))

    @wp.kernel(module=module)
    def face(
        iteration: wp.array(dtype=int),
        frozen_from: int,
        first_row: int,
        stride: int,
        position: wp.array3d(dtype=real),
        slopes_rows: wp.array3d(dtype=real),
        slopes_columns: wp.array3d(dtype=real),
        mean: wp.array(dtype=real),
        waves: wp.array2d(dtype=real),
        phases: wp.array(dtype=real),
        facing_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + first_row, (group + 1) * width
        if iteration[0] < frozen_from:
            a = along_rows(position, slopes_rows, 0, stride, i, j)
            if wp.static(kind == "curve"):
                store3(facing_out, 0, i, j, unit(a))
            if wp.static(kind == "surface"):
                store3(facing_out, 0, i, j, unit(cross3(a, along_columns(position, slopes_columns, i, j))))
            if wp.static(kind == "solid"):
                b = along_rows(position, slopes_rows, 2, 1, i, j)
                c = along_columns(position, slopes_columns, i, j)
                store3(facing_out, 0, i, j, unit(cross3(b, c)))
                store3(facing_out, 3, i, j, unit(cross3(c, a)))
                store3(facing_out, 6, i, j, unit(cross3(a, b)))
            u = vector(splat(mean[0]), splat(mean[1]), splat(mean[2]))
            if wp.static(gusting):
                u = u + gust(waves, phases, position, i, j)
            store3(facing_out, 3 * faces, i, j, u)

    return SimpleNamespace(face=face)


def gusts(width: int, real: Any) -> Any:
    """The function (waves, phases, position, i, j) that is the velocity of the gusts at a node [m/s]."""
    words = lanes(width, real)
    load1, mul, splat, L, vector = words.load1, words.mul, words.splat, words.L, words.vector
    # Added and taken away again, it rounds a number to an integer: beyond it a real has no digits behind the point.
    rounder = real(1.5 * 2.0 ** (23 if real is wp.float32 else 52))

    @wp.func
    def cosine_of_turns(turns: L):
        """cos(2 pi turns), to 1.2e-10: a Chebyshev fit in the square of what is left of whole turns."""
        q = turns - ((turns + splat(rounder)) - splat(rounder))
        s = mul(q, q)
        p = splat(real(7.800131424886704)) - real(1.4531122995535755) * s
        p = mul(p, s) - splat(real(26.404668183346548))
        p = mul(p, s) + splat(real(60.242131337659366))
        p = mul(p, s) - splat(real(85.45665831471976))
        p = mul(p, s) + splat(real(64.93938907588694))
        p = mul(p, s) - splat(real(19.739208743453563))
        return mul(p, s) + splat(real(0.9999999998855438))

    @wp.func
    def gust(
        waves: wp.array2d(dtype=real), phases: wp.array(dtype=real), position: wp.array3d(dtype=real), i: int, j: int
    ):
        x, y, z = load1(position, 0, i, j), load1(position, 1, i, j), load1(position, 2, i, j)
        u, v, w = splat(real(0.0)), splat(real(0.0)), splat(real(0.0))
        for m in range(phases.shape[0]):
            turns = waves[m, 0] * x + waves[m, 1] * y + waves[m, 2] * z + splat(phases[m])
            wave = cosine_of_turns(turns)
            u = u + waves[m, 3] * wave
            v = v + waves[m, 4] * wave
            w = w + waves[m, 5] * wave
        return vector(u, v, w)

    return gust
