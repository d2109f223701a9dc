"""The smoothers of multigrid: Chebyshev polynomials of D^-1 A (design 7.1).

No eigenvalue of D^-1 A exceeds the most nodes that one sample of an energy couples. Cloth stays far below: 2.0 to 3.2
where the bound is 5 for bending; bending-dominated crumpled sheets come to 4.9, membranes of elongated cells to 3.85 of
4. So the smoother counts with a part of the bound, which costs a quarter fewer iterations, and takes the bound itself
for the rest of the run once conjugate gradient has found the cycle not to be positive definite. That can happen where
an eigenvalue is more than a quarter above what the short smoother counts with, a fifteenth with the long one. A power
iteration that follows the eigenvalue was tried: its vector gets caught in one corner of a crumpling sheet and misses
the others.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Smoother:
    """A polynomial.

    Attributes:
        degree: Its degree.
        share: It damps eigenvalues from the largest down to this fraction of it.
        trust: What it takes for the largest at first, as a part of the bound.
    """

    degree: int
    share: float
    trust: float


SHORT = Smoother(degree=2, share=4.0, trust=0.65)
LONG = Smoother(degree=6, share=15.0, trust=0.85)
"""For folded sheets: as much work as with the short one, in a third of the iterations."""


def rates_of(bound: float) -> NDArray[np.float64]:
    """Steps of the short smoother, trusting and with the bound, then of the long one.

    Returns:
        keep and rate of each step (:func:`chebyshev`), shape (4, degree of the long one, 2).
    """
    rates = np.zeros((4, LONG.degree, 2))
    for which, smoother in ((0, SHORT), (2, LONG)):
        for index, largest in ((which, smoother.trust * bound), (which + 1, bound)):
            rates[index, : smoother.degree] = chebyshev(largest / smoother.share, largest, smoother.degree)
    return rates


def chebyshev(smallest: float, largest: float, degree: int) -> list[tuple[float, float]]:
    """Steps of the Chebyshev iteration for eigenvalues in an interval: d = keep d + rate D^-1 r, for each step.

    Returns:
        keep and rate of each step; the first keeps nothing.
    """
    centre, radius = 0.5 * (largest + smallest), 0.5 * (largest - smallest)
    steps, rho = [(0.0, 1.0 / centre)], radius / centre
    for _ in range(degree - 1):
        following = 1.0 / (2.0 * centre / radius - rho)
        steps.append((following * rho, 2.0 * following / radius))
        rho = following
    return steps
