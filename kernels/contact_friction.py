"""Friction between bodies: every point sticks to the triangle it touches, up to mu N (design 5.1, 5.2).

Per pair of a point and a triangle, with the weights w of its corners, x the positions at the start of the step:

    u = T (u_n + sum w_k (z_k - x_k)),   T = 1 - n n'
    potential  kt |u|^2 / 2 up to |u| = u0, then mu N (|u| - u0/2),   kt = mu N / u0

n, w and N follow the first Newton iterations and are frozen then; with them frozen the gradient is the derivative of
the potential. What a pair has stretched, u_n, is kept with the point between steps, for either side of its surface:
pairs come and go as points slide over triangles.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.boxes import box_words
from warpdeform.kernels.contact import contact
from warpdeform.kernels.contact_law import contact_law
from warpdeform.kernels.contact_lists import LENGTH, Pair
from warpdeform.kernels.fields import STICK
from warpdeform.kernels.lanes import kernel_module, lanes

SAME_SIDE = 0.5
"""Cosine between normals from which on they are those of one contact."""


@functools.cache
def contact_friction(real: Any) -> SimpleNamespace:
    """The kernels for one precision; `Grip` is what a pair holds by, `Anchors` what a point keeps."""
    words = lanes(1, real)
    V, W, outer, isotropic = words.V, wp.types.vector(4, real), words.outer, words.isotropic
    at_slot, Law = box_words(real).at_slot, contact_law(real)
    zero, one, half, stick = real(0.0), real(1.0), real(0.5), real(STICK)
    Push = contact(real).Push
    module = kernel_module("contact_friction", 1, real)

    @wp.struct
    class Grip:
        """What a pair holds by.

        Attributes:
            n: Unit normal.
            load: mu N [N].
        """

        n: V
        load: real

    @wp.struct
    class Anchors:
        """What a point keeps between steps, for two contacts.

        Attributes:
            n, m: Unit normals; zero for none.
            u, v: What has been stretched [m].
        """

        n: V
        u: V
        m: V
        v: V

    @wp.func
    def slip(
        pair: Pair,
        w: W,
        n: V,
        anchors: wp.array(dtype=Anchors),
        points: wp.array3d(dtype=real),
        start: wp.array3d(dtype=real),
    ):
        """u of a pair."""
        u = w[0] * (at_slot(points, pair.a) - at_slot(start, pair.a))
        u += w[1] * (at_slot(points, pair.b) - at_slot(start, pair.b))
        u += w[2] * (at_slot(points, pair.c) - at_slot(start, pair.c))
        u += w[3] * (at_slot(points, pair.d) - at_slot(start, pair.d))
        kept = anchors[pair.a]
        if wp.dot(kept.n, n) > real(SAME_SIDE):
            u += kept.u
        elif wp.dot(kept.m, n) > real(SAME_SIDE):
            u += kept.v
        return u - wp.dot(u, n) * n

    @wp.kernel(module=module)
    def grip_pairs(
        threads: int,
        counts: wp.array(dtype=wp.int32),
        pairs: wp.array(dtype=Pair),
        lagged_iterations: int,
        iteration: wp.array(dtype=wp.int32),
        stale: wp.array(dtype=wp.int32),
        laws: wp.array(dtype=Law),
        pushes: wp.array(dtype=Push),
        grips_out: wp.array(dtype=Grip),
    ):
        """Normal and load of each pair, while they are not frozen or the list is new."""
        k = wp.tid()
        while k < counts[LENGTH] and (iteration[0] < lagged_iterations or stale[0] == 1):
            grip = Grip()
            if pairs[k].edges == 0:
                press = wp.length(pushes[k].gradient)
                grip.load = laws[pairs[k].law].friction * press
                grip.n = pushes[k].gradient / wp.max(press, real(1e-30))
            grips_out[k] = grip
            k += threads

    @wp.kernel(module=module)
    def push_grips(
        threads: int,
        counts: wp.array(dtype=wp.int32),
        pairs: wp.array(dtype=Pair),
        shares: wp.array(dtype=W),
        grips: wp.array(dtype=Grip),
        anchors: wp.array(dtype=Anchors),
        points: wp.array3d(dtype=real),
        start: wp.array3d(dtype=real),
        pushes_out: wp.array(dtype=Push),
    ):
        """Add friction to what pairs do."""
        k = wp.tid()
        while k < counts[LENGTH]:
            grip = grips[k]
            if grip.load > zero:
                u = slip(pairs[k], shares[k], grip.n, anchors, points, start)
                slid = wp.length(u)
                stiffness = grip.load / wp.max(stick, slid)
                push = pushes_out[k]
                push.gradient = push.gradient + stiffness * u
                block = stiffness * (isotropic(one) - outer(grip.n, grip.n))
                if slid > stick:
                    # Slipping on meets no more friction; a hundredth is left, so that the block stays positive.
                    block -= real(0.99) * stiffness * outer(u / slid, u / slid)
                push.block = push.block + block
                pushes_out[k] = push
            k += threads

    @wp.kernel(module=module)
    def grip_energies(
        threads: int,
        counts: wp.array(dtype=wp.int32),
        pairs: wp.array(dtype=Pair),
        shares: wp.array(dtype=W),
        grips: wp.array(dtype=Grip),
        anchors: wp.array(dtype=Anchors),
        points: wp.array3d(dtype=real),
        start: wp.array3d(dtype=real),
        energies_out: wp.array(dtype=wp.float64),
    ):
        """Add the potential [J] of each thread's pairs."""
        thread = wp.tid()
        total = energies_out[thread]
        k = thread
        while k < counts[LENGTH]:
            grip = grips[k]
            if grip.load > zero:
                u = wp.length(slip(pairs[k], shares[k], grip.n, anchors, points, start))
                inner = wp.min(u, stick)
                total = total + wp.float64(grip.load * (half * inner * inner / stick + u - inner))
            k += threads
        energies_out[thread] = total

    @wp.kernel(module=module)
    def drop_anchors(anchors_out: wp.array(dtype=Anchors)):
        anchors_out[wp.tid()] = Anchors()

    @wp.kernel(module=module)
    def keep_anchors(
        starts: wp.array(dtype=wp.int32),
        entries: wp.array(dtype=wp.int32),
        pairs: wp.array(dtype=Pair),
        shares: wp.array(dtype=W),
        grips: wp.array(dtype=Grip),
        points: wp.array3d(dtype=real),
        start: wp.array3d(dtype=real),
        anchors_out: wp.array(dtype=Anchors),
    ):
        """What points keep at the end of the step, stretched to u0 at most: of the first contact and one beyond it."""
        s = wp.tid()
        kept = Anchors()
        first, second = real(zero), real(zero)
        for e in range(starts[s], starts[s + 1]):
            k = entries[e] >> 2
            grip = grips[k]
            if (entries[e] & 3) == 0 and grip.load > zero:
                u = slip(pairs[k], shares[k], grip.n, anchors_out, points, start)
                u = (stick / wp.max(stick, wp.length(u))) * u
                if first == zero or wp.dot(kept.n, grip.n) > real(SAME_SIDE):
                    kept.n = wp.where(first == zero, grip.n, kept.n)
                    kept.u = (first * kept.u + grip.load * u) / (first + grip.load)
                    first += grip.load
                elif second == zero or wp.dot(kept.m, grip.n) > real(SAME_SIDE):
                    kept.m = wp.where(second == zero, grip.n, kept.m)
                    kept.v = (second * kept.v + grip.load * u) / (second + grip.load)
                    second += grip.load
        anchors_out[s] = kept

    @wp.kernel(module=module)
    def release_grips(
        threads: int, counts: wp.array(dtype=wp.int32), pairs: wp.array(dtype=Pair), grips_out: wp.array(dtype=Grip)
    ):
        """The step is over: until the next one begins nothing holds."""
        k = wp.tid()
        while k < counts[LENGTH]:
            grips_out[k] = Grip()
            k += threads

    return SimpleNamespace(
        module=module,
        release_grips=release_grips,
        Grip=Grip,
        Anchors=Anchors,
        grip_pairs=grip_pairs,
        push_grips=push_grips,
        grip_energies=grip_energies,
        drop_anchors=drop_anchors,
        keep_anchors=keep_anchors,
    )
