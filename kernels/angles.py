"""Sines and arc tangents as words of the lane type: without a branch, so that all lanes of a group are worked at once.

Libraries take an angle at a time; here a few dozen multiplications do for sixteen of them.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import lanes

SINE_TERMS = {"float32": 6, "float64": 10}
"""Terms of the series at a quarter of the angle: full precision up to two half turns."""
TANGENT_TERMS = {"float32": 9, "float64": 21}
"""Terms of the series at an eighth of the angle, whose tangent is at most sqrt(2) - 1."""


@functools.cache
def angles(width: int, real: Any) -> SimpleNamespace:
    """Device functions ``cos_sin`` and ``angle_of`` for one lane width and precision."""
    words = lanes(width, real)
    L = words.L
    mul, div, root, at_least, splat = words.mul, words.div, words.root, words.at_least, words.splat
    sines, tangents = SINE_TERMS[real.__name__], TANGENT_TERMS[real.__name__]
    quarter, one, two, eight, tiny = real(0.25), real(1.0), real(2.0), real(8.0), real(1.0e-12)

    @wp.func
    def cos_sin(angle: L):
        """Cosine and sine, by their series at a quarter of the angle and doubling twice."""
        x = quarter * angle
        xx = mul(x, x)
        unit = splat(one)
        c, s = splat(one), splat(one)
        for k in range(sines):
            n = real(2 * (sines - k))
            c = unit - (one / (n * (n - one))) * mul(xx, c)
            s = unit - (one / (n * (n + one))) * mul(xx, s)
        s = mul(x, s)
        c, s = unit - two * mul(s, s), two * mul(s, c)
        return unit - two * mul(s, s), two * mul(s, c)

    @wp.func
    def angle_of(c: L, s: L):
        """The angle in (-pi, pi) whose cosine and sine are c and s: halved three times, then its tangent's series."""
        unit = splat(one)
        t = div(s, at_least(unit + c, tiny))
        t = div(t, unit + root(unit + mul(t, t)))
        t = div(t, unit + root(unit + mul(t, t)))
        tt = mul(t, t)
        p = splat(one / real(2 * tangents + 1))
        for k in range(tangents):
            p = splat(one / real(2 * (tangents - k) - 1)) - mul(tt, p)
        return eight * mul(t, p)

    return SimpleNamespace(cos_sin=cos_sin, angle_of=angle_of)
