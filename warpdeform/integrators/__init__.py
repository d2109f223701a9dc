"""Time integration (floor 3 of the house): one file per implicit method, found by name."""

from warpdeform.integrators.bdf2 import BDF2
from warpdeform.integrators.implicit_euler import ImplicitEuler
from warpdeform.integrators.integrator import Integrator, Stage

INTEGRATORS: dict[str, type[Integrator]] = {method.name: method for method in (ImplicitEuler, BDF2)}
"""The methods by the name that scenes and `--integrator` use."""

__all__ = ["BDF2", "INTEGRATORS", "ImplicitEuler", "Integrator", "Stage"]
