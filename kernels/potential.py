"""The exponential potential of obstacles and of contact (design 5.1), per unit of mass.

phi(f) = (V^2/2) exp(-f/eps),   below f = 0 continued by its quadratic (twice differentiable)
"""

import functools
from typing import Any

import warp as wp


@functools.cache
def potential(real: Any) -> Any:
    """The device function (strength V^2/2, eps, f) -> (phi, phi', phi'') for one precision."""
    V = wp.types.vector(3, real)
    zero, one, half = real(0.0), real(1.0), real(0.5)

    @wp.func
    def potential(strength: real, eps: real, f: real):
        e = strength * wp.exp(-wp.max(f, zero) / eps)
        q = wp.min(f, zero) / eps
        return V(e * (one - q + half * q * q), e * (q - one) / eps, e / (eps * eps))

    return potential
