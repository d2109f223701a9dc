"""What a body is made of (design 1.3, 1.4): one description in four forms, and the coefficients of its energy.

A material is given in exactly one of four forms, told apart by the stiffness that is named:

* physical units, `youngs_modulus`: a solid substance; a surface also needs a thickness, a curve a section;
* shell constants, `membrane_stiffness`: what is measured on a cloth, whose thickness means nothing;
* rod constants, `axial_stiffness`: what is measured on a thread or cable, whose section means nothing;
* the paper's weights, `eta`: the coefficients of alpha and beta in Terzopoulos et al. 1987.

Most numbers may vary over the body: a :class:`~warpdeform.varying.Varying` stands in their place.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from warpdeform.coefficients import (
    CurveCoefficients,
    PaperCurveWeights,
    PaperSolidWeights,
    PaperWeights,
    SolidCoefficients,
    SurfaceCoefficients,
    matrix,
    of_matrix,
    plane_stress,
)
from warpdeform.errors import InputError, Mistake
from warpdeform.grid import ParameterGrid
from warpdeform.presets import PRESETS
from warpdeform.section import Section
from warpdeform.varying import Varying

Local = float | Varying
"""One number, or one for every place of a body."""
Pair = tuple[Local, Local]
Triple = tuple[Local, Local, Local]
Six = tuple[Local, Local, Local, Local, Local, Local]


@dataclass(frozen=True)
class Quantity:
    """What a number of a material must be.

    Attributes:
        remedy: Its unit and an example.
        counts: How many numbers may be given.
        above: The numbers must be greater than this.
        or_equal: Whether they may equal it.
        varies: Whether they may vary over the body.
    """

    remedy: str
    counts: tuple[int, ...] = (1,)
    above: float = 0.0
    or_equal: bool = False
    varies: bool = True

    def problem(self, smallest: float, largest: float) -> str:
        """What is wrong with numbers between two ends; empty if nothing."""
        if not (math.isfinite(smallest) and math.isfinite(largest)):
            return "must be finite"
        if smallest > self.above or (self.or_equal and smallest == self.above):
            return ""
        return "must not be negative" if self.or_equal else "must be positive"


QUANTITIES = {
    "density": Quantity("Use kg/m3, for example 950 for rubber or 7850 for steel."),
    "youngs_modulus": Quantity("Use Pa, for example 1.5e6 for rubber or 2e11 for steel.", (1, 2)),
    "poisson_ratio": Quantity("Use 0 to 0.49, for example 0.3.", above=-math.inf, varies=False),
    "shear_modulus": Quantity("Use Pa, for example 2e9; leave it out for an isotropic material."),
    "thickness": Quantity("Use m, for example 0.001 for a millimetre."),
    "areal_density": Quantity("Use kg/m2, for example 0.15 for cotton."),
    "membrane_stiffness": Quantity("Use N/m (Young's modulus times thickness), for example 1000.", (1, 2)),
    "shear_stiffness": Quantity("Use N/m (shear modulus times thickness), for example 50; leave it out if isotropic."),
    "bending_stiffness": Quantity(
        "Use N m, for example 1e-5, or N m2 (one or two) for a curve; 0 for none.", (1, 2), or_equal=True
    ),
    "bending_multipliers": Quantity(
        "Use one factor without a unit, or two, for example [1.0, 0.5].", (1, 2), or_equal=True
    ),
    "linear_density": Quantity("Use kg/m, for example 0.01 for a thread of ten grams a metre."),
    "axial_stiffness": Quantity("Use N (Young's modulus times area), for example 1000."),
    "torsional_stiffness": Quantity(
        "Use N m2 (shear modulus times torsion constant), for example 1e-4.", or_equal=True
    ),
    "eta": Quantity(
        "Use N/m (a curve: N), one number or [eta11, eta22, eta12], for example 500; of a solid Pa, one number or "
        "[eta11, eta22, eta33, eta12, eta13, eta23].",
        (1, 3, 6),
    ),
    "xi": Quantity("Use N m (a curve: N m2), one number or [xi11, xi22, xi12], or 0.", (1, 3), or_equal=True),
    "inversion_barrier": Quantity("Use Pa, for example a fifth of youngs_modulus, or 0 for none.", or_equal=True),
    "damping": Quantity("Use 1/s, for example 0.1, or 0 for none.", or_equal=True, varies=False),
}

FORMS = {
    "youngs_modulus": ("density", "poisson_ratio"),
    "membrane_stiffness": ("areal_density", "poisson_ratio"),
    "axial_stiffness": ("linear_density",),
    "eta": (),
}
"""The stiffness that names a form, and the keys that must stand beside it whatever the body is."""

OPTIONAL = {
    "youngs_modulus": ("shear_modulus", "bending_multipliers", "thickness", "inversion_barrier"),
    "membrane_stiffness": ("shear_stiffness", "bending_stiffness", "bending_multipliers", "thickness"),
    "axial_stiffness": ("bending_stiffness", "torsional_stiffness"),
    "eta": ("xi", "thickness", "areal_density", "linear_density", "density", "inversion_barrier"),
}
"""The keys that may stand beside it."""


@dataclass(frozen=True)
class Material:
    """An elastic material, in exactly one of four forms; SI units; axis 1 is u, axis 2 is v, axis 3 is w.

    In place of every number but `poisson_ratio` and `damping` there may stand a `Varying`: creases, weak lines, hems.
    An array with two axes or a function of the parameters is taken for one.

    Attributes:
        density: Mass per volume rho [kg/m3]; physical form, and solids with the paper's weights.
        youngs_modulus: E, or (E1, E2) if orthotropic [Pa]; names the physical form.
        poisson_ratio: nu, or nu12 if orthotropic: contraction along v over extension along u, pulled along u.
        shear_modulus: G12 [Pa]; physical form; required with (E1, E2).
        thickness: h [m]; required of a surface in the physical form, for the record in the others.
        areal_density: Mass per area [kg/m2]; shell constants, and surfaces with the paper's weights.
        membrane_stiffness: E h, or (E1 h, E2 h) [N/m]; names the form of shell constants.
        shear_stiffness: G12 h [N/m]; shell constants; required with (E1 h, E2 h).
        bending_stiffness: D [N m]; shell constants; 0 or absent is a membrane. EI, or EI about directors 1 and 2
            [N m2]; rod constants; 0 or absent is a string.
        bending_multipliers: Factors of the bending stiffness along u and v, or one for both, for materials whose
            bending does not follow from their stretching (laminates, cloth, creases); the twist and the cross term get
            their geometric mean.
        linear_density: Mass per length [kg/m]; rod constants, and curves with the paper's weights.
        axial_stiffness: EA [N]; names the form of rod constants.
        torsional_stiffness: GJ [N m2]; rod constants; absent is that of a round rod of nu = 0, the mean EI.
        eta: eta, or (eta11, eta22, eta12) [N/m]; of a curve eta [N]; of a solid eta, or (eta11, eta22, eta33, eta12,
            eta13, eta23) [Pa]; names the form of the paper's weights.
        xi: xi, or (xi11, xi22, xi12) [N m]; of a curve, xi [N m2]; the paper's weights; 0 or absent: no bending.
        inversion_barrier: Strength of the barrier that keeps the cells of a solid from turning inside out [Pa]; about
            a fifth of E is enough; 0 or absent: none.
        damping: Mass-proportional damping gamma/mu [1/s].
        name: Name in messages.
        source: Where the numbers come from.

    Raises:
        InputError: No form or more than one, a missing or foreign key, a number that is not physical; all at once.
    """

    density: Local | None = None
    youngs_modulus: Local | Pair | None = None
    poisson_ratio: float | None = None
    shear_modulus: Local | None = None
    thickness: Local | None = None
    areal_density: Local | None = None
    membrane_stiffness: Local | Pair | None = None
    shear_stiffness: Local | None = None
    bending_stiffness: Local | Pair | None = None
    bending_multipliers: Local | Pair | None = None
    linear_density: Local | None = None
    axial_stiffness: Local | None = None
    torsional_stiffness: Local | None = None
    eta: Local | Triple | Six | None = None
    xi: Local | Triple | None = None
    inversion_barrier: Local | None = None
    damping: float = 0.0
    name: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        mistakes = self._normalise_numbers() + self._form_mistakes()
        mistakes += self._poisson_mistakes(wrong={mistake.key for mistake in mistakes})
        if mistakes:
            raise InputError(mistakes)

    @property
    def form(self) -> str:
        """The key that names the form: a key of `FORMS`."""
        return next(key for key in FORMS if getattr(self, key) is not None)

    @staticmethod
    def preset(name: str) -> "Material":
        """The material of `warpdeform.presets.PRESETS` with this name; vary it with `dataclasses.replace`.

        Raises:
            InputError: There is no such preset.
        """
        if name not in PRESETS:
            problem, remedy = "is not a material preset", f"Use one of {', '.join(PRESETS)}, or give the numbers."
            raise InputError(Mistake("material", name, problem, remedy))
        return Material(name=name, **PRESETS[name])

    @property
    def varies(self) -> bool:
        """Whether some number varies over the body."""
        return any(isinstance(item, Varying) for key in QUANTITIES for item in _listed(getattr(self, key)))

    def surface(self, grid: ParameterGrid | None = None, at: str = "cells") -> SurfaceCoefficients | PaperWeights:
        """The coefficients of a surface made of this material.

        Isotropic: membrane C = E h / (1 - nu^2) [[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu)/2]], bending the same with
        D = E h^3 / (12 (1 - nu^2)) in place of E h / (1 - nu^2); orthotropic: the plane-stress matrix Q, C = Q h and
        Q h^3 / 12. Shell constants name D itself, with nu = sqrt(nu12 nu21) for its cross term and twist.

        Args:
            grid: Parameter grid; needed where the material varies.
            at: Where a material that varies is asked for: at the "cells" of the grid, or at its "nodes".

        Raises:
            InputError: The form is not one of surfaces, or what a surface needs beside it is missing; what varies does
                not fit the grid, or is not physical somewhere on it.
        """
        self._check_body("surface", {"youngs_modulus": "thickness", "membrane_stiffness": "", "eta": "areal_density"})
        if isinstance(self.eta, tuple) and len(self.eta) != 3:
            raise InputError(
                _foreign("eta", _shown(self.eta), "surface", "Use one number or [eta11, eta22, eta12], in N/m.")
            )
        here = self._on(grid, at)
        thickness = 0.0 if here.thickness is None else here.thickness
        if self.form == "eta":
            eta, xi = (_triple(0.0 if weights is None else weights) for weights in (here.eta, here.xi))
            return PaperWeights(here.areal_density, eta, xi, thickness)
        if self.form == "youngs_modulus":
            e1, e2 = (modulus * thickness for modulus in _pair(here.youngs_modulus))
            shear = None if here.shear_modulus is None else here.shear_modulus * thickness
            areal_density = here.density * thickness
        else:
            (e1, e2), shear, areal_density = _pair(here.membrane_stiffness), here.shear_stiffness, here.areal_density
        nu12 = here.poisson_ratio
        if shear is not None and np.any(np.abs(nu12) >= np.sqrt(np.divide(e1, e2))):
            raise InputError(_inadmissible(nu12, float(np.sqrt(np.min(np.divide(e1, e2))))))
        membrane = plane_stress(e1, e2, nu12, shear)
        if self.form == "youngs_modulus":
            bending = membrane * of_matrix(thickness**2 / 12.0)
        else:
            nu, D = nu12 * np.sqrt(np.divide(e2, e1)), 0.0 if here.bending_stiffness is None else here.bending_stiffness
            bending = of_matrix(D) * matrix(1.0, nu, 1.0, 0.5 * (1.0 - nu))
        m1, m2 = _pair(1.0 if here.bending_multipliers is None else here.bending_multipliers)
        mixed = np.sqrt(np.multiply(m1, m2))
        bending = bending * matrix(m1, mixed, m2, mixed)
        return SurfaceCoefficients(areal_density, membrane, (e1, e2), bending, thickness)

    def curve(
        self, section: Section | None = None, grid: ParameterGrid | None = None, at: str = "cells"
    ) -> CurveCoefficients | PaperCurveWeights:
        """The coefficients of a curve made of this material.

        Physical units: EA, EI about both directors, GJ with G = E / (2 (1 + nu)), and rho A. The paper's weights go
        with nu = 0 and a round section, so that GJ = EI = xi where a curve has twist at all (design 1.4).

        Args:
            section: Cross-section; what the physical form needs and no other does.
            grid: Parameter grid; needed where the material varies.
            at: Where a material that varies is asked for: at the "cells" of the grid, or at its "nodes".

        Raises:
            InputError: As of `surface`.
        """
        self._check_body("curve", {"youngs_modulus": "", "axial_stiffness": "", "eta": "linear_density"})
        for key in ("youngs_modulus", "eta", "xi"):
            value = getattr(self, key)
            if isinstance(value, tuple):
                raise InputError(Mistake(key, _shown(value), "must be one number in a curve", QUANTITIES[key].remedy))
        here = self._on(grid, at)
        if self.form == "eta":
            return PaperCurveWeights(here.linear_density, here.eta, 0.0 if here.xi is None else here.xi)
        if self.form == "axial_stiffness":
            bending = _pair(0.0 if here.bending_stiffness is None else here.bending_stiffness)
            torsion = 0.5 * (bending[0] + bending[1]) if here.torsional_stiffness is None else here.torsional_stiffness
            return CurveCoefficients(here.linear_density, here.axial_stiffness, bending, torsion)
        if section is None:
            remedy = "Give a circular or rectangular section, in m, or use axial_stiffness and bending_stiffness."
            raise InputError(Mistake("section", None, "is missing beside youngs_modulus in a curve", remedy))
        e, (i1, i2) = here.youngs_modulus, section.moments
        torsion = e / (2.0 * (1.0 + here.poisson_ratio)) * section.torsion
        return CurveCoefficients(here.density * section.area, e * section.area, (e * i1, e * i2), torsion)

    def solid(self, grid: ParameterGrid | None = None, at: str = "cells") -> SolidCoefficients | PaperSolidWeights:
        """The coefficients of a solid made of this material.

        Args:
            grid: Parameter grid; needed where the material varies.
            at: Where a material that varies is asked for: at the "cells" of the grid, or at its "nodes".

        Raises:
            InputError: As of `surface`.
        """
        self._check_body("solid", {"youngs_modulus": "", "eta": "density"})
        if isinstance(self.eta, tuple) and len(self.eta) != 6:
            remedy = "Use one number or [eta11, eta22, eta33, eta12, eta13, eta23], in Pa."
            raise InputError(_foreign("eta", _shown(self.eta), "solid", remedy))
        if isinstance(self.youngs_modulus, tuple):
            remedy = "Use one number, in Pa; solids are isotropic, or take the paper's weights."
            raise InputError(_foreign("youngs_modulus", _shown(self.youngs_modulus), "solid", remedy))
        for key in ("shear_modulus", "bending_multipliers"):
            if getattr(self, key) is not None:
                remedy = f"Leave out {key}: solids are isotropic."
                raise InputError(_foreign(key, _shown(getattr(self, key)), "solid", remedy))
        here = self._on(grid, at)
        barrier = 0.0 if here.inversion_barrier is None else here.inversion_barrier
        if self.form == "eta":
            return PaperSolidWeights(
                here.density, here.eta if isinstance(self.eta, tuple) else (here.eta,) * 6, barrier
            )
        return SolidCoefficients(here.density, here.youngs_modulus, here.poisson_ratio, barrier)

    def _check_body(self, kind: str, needed: dict[str, str]) -> None:
        """Refuse a form that does not describe such a body, lacks the key that it needs, or has one that it cannot."""
        if self.form not in needed:
            problem, remedy = f"does not describe a {kind}", f"Use one of {', '.join(needed)}."
            raise InputError(Mistake(self.form, _shown(getattr(self, self.form)), problem, remedy))
        key = needed[self.form]
        if key and getattr(self, key) is None:
            raise InputError(Mistake(key, None, f"is missing beside {self.form}", QUANTITIES[key].remedy))
        if kind != "solid" and self.inversion_barrier is not None:
            raise InputError(_foreign("inversion_barrier", _shown(self.inversion_barrier), kind, "Leave it out."))

    def mean_thickness(self, grid: ParameterGrid) -> float:
        """Thickness, or the mean of one that varies, at the nodes of a grid [m]; 0 if unknown."""
        if isinstance(self.thickness, Varying):
            return float(self.thickness.at_nodes(grid).mean())
        return self.thickness or 0.0

    def _on(self, grid: ParameterGrid | None, at: str) -> SimpleNamespace:
        """All quantities by name, with arrays over the grid where they vary."""
        mistakes: list[Mistake] = []

        def local(key: str, item: Any) -> Any:
            if not isinstance(item, Varying):
                return item
            if grid is None:
                raise ValueError(f"{key} varies over the body: say on which grid")
            try:
                values = item.at_cells(grid) if at == "cells" else item.at_nodes(grid)
            except InputError as error:
                mistakes.extend(replace(mistake, key=key) for mistake in error.mistakes)
                return 1.0
            if problem := QUANTITIES[key].problem(float(values.min()), float(values.max())):
                where = [int(k) for k in np.unravel_index(int(values.argmin()), values.shape)]
                found = f"{problem}, and is {values.min():.6g} at the {at[:-1]} {where}"
                mistakes.append(Mistake(key, item.name or None, found, QUANTITIES[key].remedy))
                return 1.0
            return values

        found = SimpleNamespace()
        for key in QUANTITIES:
            value = getattr(self, key)
            item = tuple(local(key, each) for each in value) if isinstance(value, tuple) else local(key, value)
            setattr(found, key, item)
        if mistakes:
            raise InputError(mistakes)
        return found

    def _normalise_numbers(self) -> list[Mistake]:
        """Turn every number into a float or a tuple of floats, and say which ones cannot be meant."""
        mistakes = []
        for key, quantity in QUANTITIES.items():
            value = getattr(self, key)
            if value is None:
                continue
            try:
                numbers = _numbers(value, quantity.varies)
            except InputError as error:
                mistakes += [replace(mistake, key=key) for mistake in error.mistakes]
                continue
            if numbers is None or len(numbers) not in quantity.counts:
                problem = "must be " + " or ".join(_COUNTED[count] for count in quantity.counts)
            else:
                bounds = [x.bounds if isinstance(x, Varying) else (x, x) for x in numbers]
                low, high, problem = next(
                    ((*b, found) for b in bounds if b and (found := quantity.problem(*b))), (0, 0, "")
                )
                if problem and low != high:
                    problem = f"{problem}, and goes from {low:.6g} to {high:.6g}"
            if problem or numbers is None:
                mistakes.append(Mistake(key, _shown(value), problem, quantity.remedy))
            else:
                object.__setattr__(self, key, numbers[0] if len(numbers) == 1 else numbers)
        return mistakes

    def _form_mistakes(self) -> list[Mistake]:
        given = [field.name for field in fields(self) if getattr(self, field.name) is not None]
        named = [key for key in FORMS if key in given]
        if len(named) != 1:
            key, value = (named[1], getattr(self, named[1])) if named else ("youngs_modulus", None)
            problem = f"does not go with {named[0]}" if named else f"is missing, as are {_enumerated(list(FORMS)[1:])}"
            remedy = (
                "Give either youngs_modulus with density, poisson_ratio and thickness, or membrane_stiffness with "
                "areal_density, poisson_ratio and bending_stiffness, or axial_stiffness with linear_density and "
                "bending_stiffness, or eta with xi, and areal_density, linear_density or density."
            )
            return [Mistake(key, value, problem, remedy)]
        form = named[0]
        allowed = (form, *FORMS[form], *OPTIONAL[form], "damping", "name", "source")
        mistakes = [
            Mistake(key, getattr(self, key), f"does not go with {form}", f"Leave out {key}, or {form}.")
            for key in given
            if key not in allowed
        ]
        if form != "axial_stiffness" and isinstance(self.bending_stiffness, tuple):
            remedy = "Use N m, for example 1e-5, with bending_multipliers along u and v."
            mistakes.append(Mistake("bending_stiffness", self.bending_stiffness, "must be one number", remedy))
        required = list(FORMS[form])
        if form != "eta" and isinstance(getattr(self, form), tuple):
            required.append(OPTIONAL[form][0])
        for key in required:
            if key not in given:
                mistakes.append(Mistake(key, None, f"is missing beside {form}", QUANTITIES[key].remedy))
        return mistakes

    def _poisson_mistakes(self, wrong: set[str]) -> list[Mistake]:
        """The bounds on Poisson's ratio: -1 < nu < 1/2 in the isotropic case, nu12 nu21 < 1 in the orthotropic one."""
        nu = self.poisson_ratio
        stiffness = "membrane_stiffness" if self.membrane_stiffness is not None else "youngs_modulus"
        if nu is None or wrong & {"poisson_ratio", stiffness}:
            return []
        if self.shear_modulus is None and self.shear_stiffness is None:
            problem, remedy = "must be below 0.5 (incompressible) and above -1", QUANTITIES["poisson_ratio"].remedy
            return [] if -1.0 < nu < 0.5 else [Mistake("poisson_ratio", nu, problem, remedy)]
        e1, e2 = _pair(getattr(self, stiffness))
        if isinstance(e1, Varying) or isinstance(e2, Varying):
            return []
        bound = math.sqrt(e1 / e2)
        return [] if abs(nu) < bound else [_inadmissible(nu, bound)]


def _inadmissible(nu: float, bound: float) -> Mistake:
    problem = f"must lie within +-{bound:.3g}: nu12 nu21 = nu12^2 E2/E1 stays below 1, or stretching frees energy"
    return Mistake("poisson_ratio", nu, problem, f"Use 0 to {0.98 * min(bound, 0.5):.2g}.")


def _enumerated(words: list[str]) -> str:
    return ", ".join(words[:-1]) + " and " + words[-1]


def _foreign(key: str, value: object, kind: str, remedy: str) -> Mistake:
    return Mistake(key, value, f"does not go with a {kind}", remedy)


_COUNTED = {1: "one number", 2: "two numbers", 3: "three numbers", 6: "six numbers"}


def _listed(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


def _shown(value: Any) -> Any:
    """What a message shows of a value that may vary."""
    if isinstance(value, tuple):
        return tuple(_shown(each) for each in value)
    if isinstance(value, Varying):
        return value.name or "a quantity that varies"
    return value if np.ndim(value) < 2 else f"an array of shape {np.shape(value)}"


def _numbers(value: Any, varies: bool) -> tuple[Local, ...] | None:
    """The numbers in a number or a sequence of numbers, and what varies in place of one; None: it is anything else.

    Raises:
        InputError: An array that cannot vary over a body.
    """
    several = isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim == 1)
    if not several and isinstance(value, Iterable) and not isinstance(value, np.ndarray | str | Varying):
        value, several = list(value), True
    try:
        return tuple(_number(item, varies) for item in (value if several else (value,)))
    except (TypeError, ValueError):
        return None


def _number(value: Any, varies: bool) -> Local:
    if varies and (isinstance(value, Varying) or callable(value) or np.ndim(value) > 1):
        return value if isinstance(value, Varying) else Varying(value)
    if isinstance(value, bool | str | bytes) or not hasattr(value, "__float__"):
        raise TypeError
    return float(value)


def _pair(value: Any) -> tuple[Any, Any]:
    return value if isinstance(value, tuple) else (value, value)


def _triple(value: Any) -> tuple[Any, Any, Any]:
    return value if isinstance(value, tuple) else (value, value, value)
