"""What holds between two bodies, or between a body and itself: constants of the field and of the guard."""

import functools
from typing import Any

import warp as wp


@functools.cache
def contact_law(real: Any) -> Any:
    """The struct for one precision; the table has one for every ordered pair of bodies."""

    @wp.struct
    class Law:
        """Lengths in metres.

        Attributes:
            active: 1 where the bodies feel each other.
            strength: V^2/2 [m2/s2].
            eps: Range of the field.
            cutoff: Distance of the skins beyond which there is no force.
            offset: Distance of the middle surfaces at which the skins touch.
            gap: Distance of the skins at rest.
            inner: Distance of the middle surfaces towards which the wall grows without bound.
            wall: Thickness of the wall outside of it.
            floor: Distance of the middle surfaces below which the guard lets nothing come nearer.
            friction: Coefficient.
        """

        active: wp.int32
        strength: real
        eps: real
        cutoff: real
        offset: real
        gap: real
        inner: real
        wall: real
        floor: real
        friction: real

    return Law
