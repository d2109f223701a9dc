"""Cross-sections of curves: area, second moments of area, torsion constant (design 1.3, Curve).

A section lies in the plane of the two directors of its material frame. Bending about director 1 stretches what lies
away from it along director 2, and the other way round.
"""

import math
from dataclasses import dataclass

from warpdeform.errors import InputError, Mistake

TORSION_TERMS = 12
"""Terms of the series of a rectangle's torsion constant: the first one left out is below 1e-8 of the whole."""


@dataclass(frozen=True)
class Section:
    """What elasticity needs of a cross-section; made by `circular` or `rectangular`.

    Attributes:
        area: Area A [m2].
        moments: Second moments of area about directors 1 and 2 [m4].
        torsion: Torsion constant J [m4]: the torque is G J times the twist per length.
        extent: Extent along directors 1 and 2 [m].
    """

    area: float
    moments: tuple[float, float]
    torsion: float
    extent: tuple[float, float]

    @staticmethod
    def circular(radius: float) -> "Section":
        """A disc: A = pi r^2, I = pi r^4 / 4 about any diameter, J = pi r^4 / 2.

        Args:
            radius: Radius r [m].

        Raises:
            InputError: The radius is not a positive number.
        """
        _check_lengths(radius=radius)
        moment = math.pi * radius**4 / 4.0
        return Section(math.pi * radius**2, (moment, moment), 2.0 * moment, (2.0 * radius, 2.0 * radius))

    @staticmethod
    def rectangular(width: float, height: float) -> "Section":
        """A rectangle: I = width height^3 / 12 about director 1, height width^3 / 12 about director 2.

        J = a b^3 (1/3 - (64/pi^5) (b/a) sum over odd n of tanh(n pi a / 2b) / n^5) with the longer side a and the
        shorter b: Saint-Venant's solution, as in Timoshenko and Goodier, Theory of Elasticity, article 109.

        Args:
            width: Extent along director 1 [m].
            height: Extent along director 2 [m].

        Raises:
            InputError: A side is not a positive number.
        """
        _check_lengths(width=width, height=height)
        a, b = max(width, height), min(width, height)
        odd = range(1, 2 * TORSION_TERMS, 2)
        series = sum(math.tanh(n * math.pi * a / (2.0 * b)) / n**5 for n in odd)
        torsion = a * b**3 * (1.0 / 3.0 - 64.0 / math.pi**5 * (b / a) * series)
        moments = (width * height**3 / 12.0, height * width**3 / 12.0)
        return Section(width * height, moments, torsion, (width, height))

    @property
    def radius(self) -> float:
        """Radius of the disc of the same area [m]: what a round picture of the curve shows, and what wind meets."""
        return math.sqrt(self.area / math.pi)


def _check_lengths(**lengths: float) -> None:
    """Refuse lengths that are not positive numbers, all at once."""
    mistakes = [
        Mistake(key, value, "must be a positive number", "Use m, for example 0.001 for a millimetre.")
        for key, value in lengths.items()
        if isinstance(value, bool | str) or not hasattr(value, "__float__") or not 0.0 < float(value) < math.inf
    ]
    if mistakes:
        raise InputError(mistakes)
