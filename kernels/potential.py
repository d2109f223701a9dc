"""The potentials of obstacles and of contact (design 5.1, 5.2), per unit of mass.

Both are a strength V^2/2 times

    exponential   exp(-f/eps),           below f = 0 continued by its quadratic
    wall          -(1 - x)^2 ln x,       x = (f - inner)/thin, 0 from x = 1 on

The exponential stops what comes at a design speed, and at rest keeps the gap. It carries only so much: light nodes that
heavy ones hang on, or cloth that is drawn tight, are pressed through it to where the guard holds them, and there no
line search gets anywhere. The wall takes over inside half the gap: its force grows without bound towards `inner`, as
that of Li et al. 2020 (Incremental potential contact); below `LEAST` of its thickness it stays what it is there, and so
does its phi'', as an upper bound: else Newton would throw out what is pressed so deep.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

LEAST = 0.01
"""Share of the wall's thickness below which its force does not grow any more."""


@functools.cache
def potentials(real: Any) -> SimpleNamespace:
    """Device functions for one precision.

    `exponential`: (strength, eps, f) -> (phi, phi', phi'').
    `wall`: (strength, thin, f - inner) -> (phi, phi', phi'' or more); nothing where thin is 0.
    """
    V = wp.types.vector(3, real)
    zero, one, half, two = real(0.0), real(1.0), real(0.5), real(2.0)

    @wp.func
    def exponential(strength: real, eps: real, f: real):
        e = strength * wp.exp(-wp.max(f, zero) / eps)
        q = wp.min(f, zero) / eps
        return V(e * (one - q + half * q * q), e * (q - one) / eps, e / (eps * eps))

    @wp.func
    def wall(strength: real, thin: real, height: real):
        rise = V()
        if thin > zero and height < thin:
            x = height / thin
            y = wp.max(x, real(LEAST))
            log, rest = wp.log(y), one - y
            slope = rest * (two * log - rest / y)
            bend = -two * log + rest * (real(4.0) + rest / y) / y
            rise = strength * V((x - y) * slope - rest * rest * log, slope / thin, bend / (thin * thin))
        return rise

    return SimpleNamespace(exponential=exponential, wall=wall)
