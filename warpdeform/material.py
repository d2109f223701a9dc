"""What a body is made of (design 1.3, 1.4): one description in four forms, and the coefficients of its energy.

A material is given in exactly one of four forms, told apart by the stiffness that is named:

* physical units, `youngs_modulus`: a solid substance; a surface also needs a thickness, a curve a section;
* shell constants, `membrane_stiffness`: what is measured on a cloth, whose thickness means nothing;
* rod constants, `axial_stiffness`: what is measured on a thread or cable, whose section means nothing;
* the paper's weights, `eta`: the coefficients of alpha and beta in Terzopoulos et al. 1987.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from warpdeform.errors import InputError, Mistake
from warpdeform.section import Section

Pair = tuple[float, float]
Triple = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Quantity:
    """What a number of a material must be.

    Attributes:
        remedy: Its unit and an example.
        counts: How many numbers may be given.
        above: The numbers must be greater than this.
        or_equal: Whether they may equal it.
    """

    remedy: str
    counts: tuple[int, ...] = (1,)
    above: float = 0.0
    or_equal: bool = False


QUANTITIES = {
    "density": Quantity("Use kg/m3, for example 950 for rubber or 7850 for steel."),
    "youngs_modulus": Quantity("Use Pa, for example 1.5e6 for rubber or 2e11 for steel.", (1, 2)),
    "poisson_ratio": Quantity("Use 0 to 0.49, for example 0.3.", above=-math.inf),
    "shear_modulus": Quantity("Use Pa, for example 2e9; leave it out for an isotropic material."),
    "thickness": Quantity("Use m, for example 0.001 for a millimetre."),
    "areal_density": Quantity("Use kg/m2, for example 0.15 for cotton."),
    "membrane_stiffness": Quantity("Use N/m (Young's modulus times thickness), for example 1000.", (1, 2)),
    "shear_stiffness": Quantity("Use N/m (shear modulus times thickness), for example 50; leave it out if isotropic."),
    "bending_stiffness": Quantity(
        "Use N m, for example 1e-5, or N m2 (one or two) for a curve; 0 for none.", (1, 2), or_equal=True
    ),
    "bending_multipliers": Quantity("Use two factors without a unit, for example [1.0, 0.5].", (2,), or_equal=True),
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
    "damping": Quantity("Use 1/s, for example 0.1, or 0 for none.", or_equal=True),
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
class SurfaceCoefficients:
    """Coefficients of the elastic shell energy in an orthonormal frame of the rest surface.

    Attributes:
        areal_density: Mass per area [kg/m2].
        membrane: Membrane stiffness [N/m], shape (3, 3), for the strains (E11, E22, 2 E12).
        membrane_modes: (E1 h, E2 h) [N/m]: stiffness of the Legendre modes ad, bd of a cell, (E h / 6) ad^2.
        bending: Bending stiffness [N m], shape (3, 3), for the curvature changes (k11, k22, 2 k12), or zero.
        thickness: Thickness [m], 0 if unknown.
    """

    areal_density: float
    membrane: NDArray[np.float64]
    membrane_modes: Pair
    bending: NDArray[np.float64]
    thickness: float


@dataclass(frozen=True)
class PaperWeights:
    """Weights of the paper's energy, whose strains have no cross term (design 1.3).

    Attributes:
        areal_density: Mass per area [kg/m2].
        eta: (eta11, eta22, eta12) [N/m], coefficients of alpha.
        xi: (xi11, xi22, xi12) [N m], coefficients of beta.
        thickness: Thickness [m], 0 if unknown.
    """

    areal_density: float
    eta: Triple
    xi: Triple
    thickness: float


@dataclass(frozen=True)
class CurveCoefficients:
    """Coefficients of the elastic energy of a curve per rest length.

    Attributes:
        linear_density: Mass per length [kg/m].
        axial: EA [N].
        bending: EI about directors 1 and 2 of the section [N m2].
        torsion: GJ [N m2].
    """

    linear_density: float
    axial: float
    bending: Pair
    torsion: float


@dataclass(frozen=True)
class PaperCurveWeights:
    """Weights of the paper's energy of a curve, whose metric and curvature are those of its parametrisation.

    Attributes:
        linear_density: Mass per length [kg/m].
        eta: Coefficient of alpha [N]: EA / 2 of a curve that is parametrised by its rest length (design 1.4).
        xi: Coefficient of beta [N m2]: EI of such a curve.
    """

    linear_density: float
    eta: float
    xi: float


@dataclass(frozen=True)
class SolidCoefficients:
    """Coefficients of the elastic energy of an isotropic solid.

    Attributes:
        density: Mass per volume [kg/m3].
        youngs_modulus: E [Pa].
        poisson_ratio: nu, below 1/2.
        inversion_barrier: Strength of the barrier against inversion [Pa], 0 for none.
    """

    density: float
    youngs_modulus: float
    poisson_ratio: float
    inversion_barrier: float


@dataclass(frozen=True)
class PaperSolidWeights:
    """Weights of the paper's energy of a solid, whose strains have no cross term.

    Attributes:
        density: Mass per volume [kg/m3].
        eta: (eta11, eta22, eta33, eta12, eta13, eta23) [Pa] where the parameters are lengths, coefficients of alpha.
        inversion_barrier: Strength of the barrier against inversion [Pa], 0 for none.
    """

    density: float
    eta: Six
    inversion_barrier: float


@dataclass(frozen=True)
class Material:
    """An elastic material, in exactly one of four forms; SI units; axis 1 is u, axis 2 is v, axis 3 is w.

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
        bending_multipliers: Factors of the bending stiffness along u and v, for materials whose bending does not follow
            from their stretching (laminates, cloth); the twist and the cross term get their geometric mean.
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

    density: float | None = None
    youngs_modulus: float | Pair | None = None
    poisson_ratio: float | None = None
    shear_modulus: float | None = None
    thickness: float | None = None
    areal_density: float | None = None
    membrane_stiffness: float | Pair | None = None
    shear_stiffness: float | None = None
    bending_stiffness: float | Pair | None = None
    bending_multipliers: Pair | None = None
    linear_density: float | None = None
    axial_stiffness: float | None = None
    torsional_stiffness: float | None = None
    eta: float | Triple | Six | None = None
    xi: float | Triple | None = None
    inversion_barrier: float | None = None
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
        """The material of `warpdeform.material.PRESETS` with this name; vary it with `dataclasses.replace`.

        Raises:
            InputError: There is no such preset.
        """
        if name not in PRESETS:
            problem, remedy = "is not a material preset", f"Use one of {', '.join(PRESETS)}, or give the numbers."
            raise InputError(Mistake("material", name, problem, remedy))
        return PRESETS[name]

    def surface(self) -> SurfaceCoefficients | PaperWeights:
        """The coefficients of a surface made of this material.

        Isotropic: membrane C = E h / (1 - nu^2) [[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu)/2]], bending the same with
        D = E h^3 / (12 (1 - nu^2)) in place of E h / (1 - nu^2); orthotropic: the plane-stress matrix Q, C = Q h and
        Q h^3 / 12. Shell constants name D itself, with nu = sqrt(nu12 nu21) for its cross term and twist.

        Raises:
            InputError: The form is not one of surfaces, or what a surface needs beside it is missing.
        """
        self._check_body("surface", {"youngs_modulus": "thickness", "membrane_stiffness": "", "eta": "areal_density"})
        if isinstance(self.eta, tuple) and len(self.eta) != 3:
            raise InputError(_foreign("eta", self.eta, "surface", "Use one number or [eta11, eta22, eta12], in N/m."))
        if self.form == "eta":
            assert self.areal_density is not None
            eta, xi = (_triple(weight) for weight in (self.eta, self.xi))
            return PaperWeights(self.areal_density, eta, xi, self.thickness or 0.0)
        stiffness, shear, thickness, areal_density = self._membrane_constants()
        nu12, (e1, e2) = self.poisson_ratio or 0.0, stiffness
        membrane = plane_stress(e1, e2, nu12, shear)
        if self.form == "youngs_modulus":
            bending = membrane * (thickness**2 / 12.0)
        else:
            nu = nu12 * math.sqrt(e2 / e1)
            bending = _pair(self.bending_stiffness)[0] * np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]])
        m1, m2 = self.bending_multipliers or (1.0, 1.0)
        mixed = math.sqrt(m1 * m2)
        bending = bending * np.array([[m1, mixed, 0], [mixed, m2, 0], [0, 0, mixed]])
        return SurfaceCoefficients(areal_density, membrane, (e1, e2), bending, thickness)

    def curve(self, section: Section | None = None) -> CurveCoefficients | PaperCurveWeights:
        """The coefficients of a curve made of this material.

        Physical units: EA, EI about both directors, GJ with G = E / (2 (1 + nu)), and rho A. The paper's weights go
        with nu = 0 and a round section, so that GJ = EI = xi where a curve has twist at all (design 1.4).

        Args:
            section: Cross-section; what the physical form needs and no other does.

        Raises:
            InputError: The form is not one of curves, or what a curve needs beside it is missing.
        """
        self._check_body("curve", {"youngs_modulus": "", "axial_stiffness": "", "eta": "linear_density"})
        if self.form == "youngs_modulus":
            if section is None:
                remedy = "Give a circular or rectangular section, in m, or use axial_stiffness and bending_stiffness."
                raise InputError(Mistake("section", None, "is missing beside youngs_modulus in a curve", remedy))
            assert self.density is not None
            e, (i1, i2) = self._single("youngs_modulus"), section.moments
            torsion = e / (2.0 * (1.0 + (self.poisson_ratio or 0.0))) * section.torsion
            return CurveCoefficients(self.density * section.area, e * section.area, (e * i1, e * i2), torsion)
        assert self.linear_density is not None
        if self.form == "eta":
            return PaperCurveWeights(self.linear_density, self._single("eta"), self._single("xi"))
        assert self.axial_stiffness is not None
        bending = _pair(self.bending_stiffness)
        torsion = 0.5 * sum(bending) if self.torsional_stiffness is None else self.torsional_stiffness
        return CurveCoefficients(self.linear_density, self.axial_stiffness, bending, torsion)

    def solid(self) -> SolidCoefficients | PaperSolidWeights:
        """The coefficients of a solid made of this material.

        Raises:
            InputError: The form is not one of solids, or what a solid needs beside it is missing or does not fit one.
        """
        self._check_body("solid", {"youngs_modulus": "", "eta": "density"})
        assert self.density is not None
        barrier = self.inversion_barrier or 0.0
        if self.form == "eta":
            eta = self.eta if isinstance(self.eta, tuple) else (self.eta or 0.0,) * 6
            if len(eta) != 6:
                remedy = "Use one number or [eta11, eta22, eta33, eta12, eta13, eta23], in Pa."
                raise InputError(_foreign("eta", eta, "solid", remedy))
            return PaperSolidWeights(self.density, eta, barrier)
        if isinstance(self.youngs_modulus, tuple):
            remedy = "Use one number, in Pa; solids are isotropic, or take the paper's weights."
            raise InputError(_foreign("youngs_modulus", self.youngs_modulus, "solid", remedy))
        for key in ("shear_modulus", "bending_multipliers"):
            if getattr(self, key) is not None:
                raise InputError(_foreign(key, getattr(self, key), "solid", f"Leave out {key}: solids are isotropic."))
        assert self.youngs_modulus is not None
        return SolidCoefficients(self.density, self.youngs_modulus, self.poisson_ratio or 0.0, barrier)

    def _check_body(self, kind: str, needed: dict[str, str]) -> None:
        """Refuse a form that does not describe such a body, lacks the key that it needs, or has one that it cannot."""
        if self.form not in needed:
            problem, remedy = f"does not describe a {kind}", f"Use one of {', '.join(needed)}."
            raise InputError(Mistake(self.form, getattr(self, self.form), problem, remedy))
        key = needed[self.form]
        if key and getattr(self, key) is None:
            raise InputError(Mistake(key, None, f"is missing beside {self.form}", QUANTITIES[key].remedy))
        if kind != "solid" and self.inversion_barrier is not None:
            raise InputError(_foreign("inversion_barrier", self.inversion_barrier, kind, "Leave it out."))

    def _single(self, key: str) -> float:
        """The value of a key that must be one number where a curve is meant; 0 if it is not given."""
        value = getattr(self, key)
        if isinstance(value, tuple):
            raise InputError(Mistake(key, value, "must be one number in a curve", QUANTITIES[key].remedy))
        return float(value or 0.0)

    def _membrane_constants(self) -> tuple[Pair, float | None, float, float]:
        """(E1 h, E2 h), G12 h (None: isotropic), thickness and mass per area of the two shell forms."""
        thickness = self.thickness or 0.0
        if self.form == "youngs_modulus":
            assert self.density is not None
            e1, e2 = _pair(self.youngs_modulus)
            shear = None if self.shear_modulus is None else self.shear_modulus * thickness
            return (e1 * thickness, e2 * thickness), shear, thickness, self.density * thickness
        assert self.areal_density is not None
        return _pair(self.membrane_stiffness), self.shear_stiffness, thickness, self.areal_density

    def _normalise_numbers(self) -> list[Mistake]:
        """Turn every number into a float or a tuple of floats, and say which ones cannot be meant."""
        mistakes = []
        for key, quantity in QUANTITIES.items():
            value = getattr(self, key)
            if value is None:
                continue
            numbers = _numbers(value)
            if numbers is None or len(numbers) not in quantity.counts:
                problem = "must be " + " or ".join(_COUNTED[count] for count in quantity.counts)
            elif not all(math.isfinite(x) for x in numbers):
                problem = "must be finite"
            elif not all(x > quantity.above or (quantity.or_equal and x == quantity.above) for x in numbers):
                problem = "must not be negative" if quantity.or_equal else "must be positive"
            else:
                object.__setattr__(self, key, numbers[0] if len(numbers) == 1 else numbers)
                continue
            mistakes.append(Mistake(key, value, problem, quantity.remedy))
        return mistakes

    def _form_mistakes(self) -> list[Mistake]:
        given = [field.name for field in fields(self) if getattr(self, field.name) is not None]
        named = [key for key in FORMS if key in given]
        if len(named) != 1:
            key, value = (named[1], getattr(self, named[1])) if named else ("youngs_modulus", None)
            problem = f"does not go with {named[0]}" if named else f"is missing, as are {_listed(list(FORMS)[1:])}"
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
        bound = math.sqrt(e1 / e2)
        problem = f"must lie within +-{bound:.3g}: nu12 nu21 = nu12^2 E2/E1 stays below 1, or stretching frees energy"
        remedy = f"Use 0 to {0.98 * min(bound, 0.5):.2g}."
        return [] if abs(nu) < bound else [Mistake("poisson_ratio", nu, problem, remedy)]


def plane_stress(e1: float, e2: float, nu12: float, shear: float | None) -> NDArray[np.float64]:
    """Plane-stress stiffness for (E11, E22, 2 E12), shape (3, 3), in the unit of `e1`, `e2` and `shear`.

    Args:
        e1: Young's modulus along axis 1, times anything.
        e2: Young's modulus along axis 2, times the same.
        nu12: Contraction along 2 over extension along 1, pulled along 1.
        shear: Shear modulus, times the same; None takes the isotropic e1 / (2 (1 + nu12)).
    """
    nu21 = nu12 * e2 / e1
    across = 1.0 / (1.0 - nu12 * nu21)
    shear = e1 / (2.0 * (1.0 + nu12)) if shear is None else shear
    return np.array([[across * e1, across * nu12 * e2, 0], [across * nu12 * e2, across * e2, 0], [0, 0, shear]])


def _listed(words: list[str]) -> str:
    return ", ".join(words[:-1]) + " and " + words[-1]


def _foreign(key: str, value: object, kind: str, remedy: str) -> Mistake:
    return Mistake(key, value, f"does not go with a {kind}", remedy)


_COUNTED = {1: "one number", 2: "two numbers", 3: "three numbers", 6: "six numbers"}


def _numbers(value: object) -> tuple[float, ...] | None:
    """The floats in a number or a sequence of numbers; None if it is anything else."""
    items = value if isinstance(value, Iterable) and not isinstance(value, str) else (value,)
    try:
        return tuple(_number(item) for item in items)
    except (TypeError, ValueError):
        return None


def _number(value: object) -> float:
    if isinstance(value, bool | str | bytes) or not hasattr(value, "__float__"):
        raise TypeError
    return float(value)


def _pair(value: float | Pair | None) -> Pair:
    return value if isinstance(value, tuple) else (value or 0.0, value or 0.0)


def _triple(value: float | Triple | Six | None) -> Triple:
    return (value[0], value[1], value[2]) if isinstance(value, tuple) else (value or 0.0, value or 0.0, value or 0.0)


_CLOTH_DATA = "Wang, O'Brien, Ramamoorthi, Data-Driven Elastic Models for Cloth, SIGGRAPH 2011"

PRESETS = {
    preset.name: preset
    for preset in (
        Material(
            name="rubber",
            density=950.0,
            youngs_modulus=1.5e6,
            poisson_ratio=0.49,
            thickness=0.0005,
            source="Vulcanised natural rubber, a sheet of half a millimetre: density 950 kg/m3 and shear modulus "
            "0.5 MPa from the MatWeb data sheet of vulcanised natural rubber, E = 3 G as of a nearly "
            "incompressible solid.",
        ),
        Material(
            name="cotton",
            areal_density=0.15,
            membrane_stiffness=1400.0,
            poisson_ratio=0.03,
            shear_stiffness=40.0,
            bending_stiffness=5e-6,
            source="Plain-weave shirting, representative: stretch, cross and shear stiffness of a woven cotton "
            f"blend of 0.22 kg/m2 ({_CLOTH_DATA}: Royal Target) scaled to 0.15 kg/m2; bending stiffness w "
            "c^3 (Peirce, The Handle of Cloth as a Measurable Quantity, 1930) with weight w and the "
            "bending length c = 15 mm of light plain weaves.",
        ),
        Material(
            name="silk",
            areal_density=0.07,
            membrane_stiffness=700.0,
            poisson_ratio=0.03,
            shear_stiffness=20.0,
            bending_stiffness=1.9e-6,
            source="Charmeuse of 16 momme (4.34 g/m2 each), representative: stretch and shear per mass as of "
            "cotton, which agrees with the small shear stiffness of silk weaves (Matsudaira, "
            "Characteristics of Mechanical Properties and Handles of Silk Filament Weaves, Kanazawa "
            "University); bending stiffness w c^3 (Peirce 1930) with c = 14 mm.",
        ),
        Material(
            name="denim",
            areal_density=0.324,
            membrane_stiffness=(1050.0, 224.0),
            poisson_ratio=0.18,
            shear_stiffness=110.0,
            bending_stiffness=1.7e-5,
            source="Stretch denim of 11 oz, the stiff yarns along u: mass, stretch and cross stiffness measured "
            f"({_CLOTH_DATA}: 11oz Black Denim); shear 1.96 gf/(cm degree) and bending 0.174 gf cm2/cm are "
            "the KES-F means of six denims (Journal of Textiles 2016, 4614168, table 5).",
        ),
        Material(
            name="paper",
            density=800.0,
            youngs_modulus=(7.44e9, 3.47e9),
            poisson_ratio=0.43,
            shear_modulus=2.04e9,
            thickness=0.0001,
            source="Office paper of 80 g/m2 and 0.1 mm, machine direction along u: E1, E2, G12 of a machine-made "
            "paper of 780 kg/m3 (Mann, Baum, Habeger, Tappi 63(2), 1980); sqrt(nu12 nu21) = 0.293 "
            "(Schulgasser, On the In-Plane Elastic Constants of Paper, Fibre Science and Technology, "
            "1981).",
        ),
        Material(
            name="spring-steel",
            density=7850.0,
            youngs_modulus=2.0e11,
            poisson_ratio=0.29,
            thickness=0.0001,
            source="Hardened carbon steel, a shim of 0.1 mm: E from the table of spring materials in Machinery's "
            "Handbook (28.5 to 29.5 million psi), density and Poisson's ratio of AISI 1095.",
        ),
    )
}
"""Materials by name; the `source` of each says where its numbers come from."""
