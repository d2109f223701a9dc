"""Linearly implicit Euler, the step of most cloth engines."""

from typing import ClassVar

from warpdeform.integrators.implicit_euler import ImplicitEuler


class LinearImplicit(ImplicitEuler):
    """One projected Newton iteration of backward Euler from x_n, without a line search (Baraff and Witkin 1998).

    Kept to measure the others against: it starts from where the last step ended, so that the error of the one iteration
    drowns that of any method (design 6.2), and nothing holds it where the iteration overshoots.
    """

    name: ClassVar[str] = "linear-implicit"
    order: ClassVar[int] = 1
    searches: ClassVar[bool] = False
    predicts: ClassVar[bool] = False
    iterations: ClassVar[int | None] = 1
