"""Time integration (floor 3 of the house): one file per method, found by name."""

from warpdeform.integrators.bdf2 import BDF2
from warpdeform.integrators.energy_momentum import EnergyMomentum
from warpdeform.integrators.implicit_euler import ImplicitEuler
from warpdeform.integrators.integrator import ImplicitMethod, Integrator, Stage
from warpdeform.integrators.linear_implicit import LinearImplicit
from warpdeform.integrators.sdirk2 import SDIRK2
from warpdeform.integrators.stepper import Problem, Stepper
from warpdeform.integrators.symplectic_euler import SymplecticEuler
from warpdeform.integrators.terzopoulos import Terzopoulos, TerzopoulosExact
from warpdeform.integrators.tr_bdf2 import TRBDF2
from warpdeform.integrators.verlet import Verlet

INTEGRATORS: dict[str, type[Integrator]] = {
    method.name: method
    for method in (
        SymplecticEuler,
        Verlet,
        Terzopoulos,
        TerzopoulosExact,
        LinearImplicit,
        ImplicitEuler,
        BDF2,
        TRBDF2,
        SDIRK2,
        EnergyMomentum,
    )
}
"""The methods by the name that scenes and `--integrator` use."""

__all__ = [
    "BDF2",
    "INTEGRATORS",
    "SDIRK2",
    "TRBDF2",
    "ImplicitEuler",
    "ImplicitMethod",
    "Integrator",
    "Problem",
    "Stage",
    "Stepper",
]
