"""The linear system of a Newton iteration (floor 2): operator, sums, conjugate gradient, preconditioners."""

from warpdeform.linear.conjugate_gradient import ConjugateGradient
from warpdeform.linear.operator import LinearOperator
from warpdeform.linear.preconditioner import Preconditioner
from warpdeform.linear.preconditioners import PRECONDITIONERS, choose_preconditioner
from warpdeform.linear.sums import Sums

__all__ = ["PRECONDITIONERS", "ConjugateGradient", "LinearOperator", "Preconditioner", "Sums", "choose_preconditioner"]
