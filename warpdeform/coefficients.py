"""Coefficients of the elastic energies, as a material gives them to a kind of body (design 1.3, 1.4).

Where the material varies over the body they are arrays over the places that they belong to, whose axes come first.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Number = float | Array
"""One number, or an array of them where a material varies."""


@dataclass(frozen=True)
class SurfaceCoefficients:
    """Coefficients of the elastic shell energy in an orthonormal frame of the rest surface.

    Attributes:
        density: Mass per area [kg/m2].
        membrane: Membrane stiffness [N/m], shape (3, 3), for the strains (E11, E22, 2 E12).
        membrane_modes: (E1 h, E2 h) [N/m]: stiffness of the Legendre modes ad, bd of a cell, (E h / 6) ad^2.
        bending: Bending stiffness [N m], shape (3, 3), for the curvature changes (k11, k22, 2 k12), or zero.
        thickness: Thickness [m], 0 if unknown.
    """

    density: Number
    membrane: Array
    membrane_modes: tuple[Number, Number]
    bending: Array
    thickness: Number

    def mapped(self, function: Callable[[Array], Array]) -> "SurfaceCoefficients":
        """The same with a function applied to all arrays that vary: it takes and gives the axes of places first."""
        return SurfaceCoefficients(
            _mapped(self.density, 0, function),
            _mapped(self.membrane, 2, function),
            (_mapped(self.membrane_modes[0], 0, function), _mapped(self.membrane_modes[1], 0, function)),
            _mapped(self.bending, 2, function),
            _mapped(self.thickness, 0, function),
        )

    def exchanged(self) -> "SurfaceCoefficients":
        """The same with the axes exchanged."""
        swap = [1, 0, 2]
        membrane, bending = (law[..., swap, :][..., swap] for law in (self.membrane, self.bending))
        return replace(self, membrane=membrane, membrane_modes=self.membrane_modes[::-1], bending=bending)


@dataclass(frozen=True)
class PaperWeights:
    """Weights of the paper's energy, whose strains have no cross term (design 1.3).

    Attributes:
        density: Mass per area [kg/m2].
        eta: (eta11, eta22, eta12) [N/m], coefficients of alpha.
        xi: (xi11, xi22, xi12) [N m], coefficients of beta.
        thickness: Thickness [m], 0 if unknown.
    """

    density: Number
    eta: tuple[Number, Number, Number]
    xi: tuple[Number, Number, Number]
    thickness: Number

    def mapped(self, function: Callable[[Array], Array]) -> "PaperWeights":
        """The same with a function applied to all arrays that vary."""
        eta, xi = ([_mapped(weight, 0, function) for weight in weights] for weights in (self.eta, self.xi))
        density, thickness = (_mapped(value, 0, function) for value in (self.density, self.thickness))
        return PaperWeights(density, (eta[0], eta[1], eta[2]), (xi[0], xi[1], xi[2]), thickness)

    def exchanged(self) -> "PaperWeights":
        """The same with the axes exchanged."""
        (eta1, eta2, eta12), (xi1, xi2, xi12) = self.eta, self.xi
        return replace(self, eta=(eta2, eta1, eta12), xi=(xi2, xi1, xi12))


@dataclass(frozen=True)
class CurveCoefficients:
    """Coefficients of the elastic energy of a curve per rest length.

    Attributes:
        density: Mass per length [kg/m].
        axial: EA [N].
        bending: EI about directors 1 and 2 of the section [N m2].
        torsion: GJ [N m2].
    """

    density: Number
    axial: Number
    bending: tuple[Number, Number]
    torsion: Number


@dataclass(frozen=True)
class PaperCurveWeights:
    """Weights of the paper's energy of a curve, whose metric and curvature are those of its parametrisation.

    Attributes:
        density: Mass per length [kg/m].
        eta: Coefficient of alpha [N]: EA / 2 of a curve that is parametrised by its rest length (design 1.4).
        xi: Coefficient of beta [N m2]: EI of such a curve.
    """

    density: Number
    eta: Number
    xi: Number


@dataclass(frozen=True)
class SolidCoefficients:
    """Coefficients of the elastic energy of an isotropic solid.

    Attributes:
        density: Mass per volume [kg/m3].
        youngs_modulus: E [Pa].
        poisson_ratio: nu, below 1/2.
        inversion_barrier: Strength of the barrier against inversion [Pa], 0 for none.
    """

    density: Number
    youngs_modulus: Number
    poisson_ratio: float
    inversion_barrier: Number

    def mapped(self, function: Callable[[Array], Array]) -> "SolidCoefficients":
        """The same with a function applied to all arrays that vary."""
        density, modulus, barrier = (
            _mapped(value, 0, function) for value in (self.density, self.youngs_modulus, self.inversion_barrier)
        )
        return SolidCoefficients(density, modulus, self.poisson_ratio, barrier)


@dataclass(frozen=True)
class PaperSolidWeights:
    """Weights of the paper's energy of a solid, whose strains have no cross term.

    Attributes:
        density: Mass per volume [kg/m3].
        eta: (eta11, eta22, eta33, eta12, eta13, eta23) [Pa] where the parameters are lengths, coefficients of alpha.
        inversion_barrier: Strength of the barrier against inversion [Pa], 0 for none.
    """

    density: Number
    eta: tuple[Number, ...]
    inversion_barrier: Number

    def mapped(self, function: Callable[[Array], Array]) -> "PaperSolidWeights":
        """The same with a function applied to all arrays that vary."""
        density, barrier, *eta = (
            _mapped(value, 0, function) for value in (self.density, self.inversion_barrier, *self.eta)
        )
        return PaperSolidWeights(density, tuple(eta), barrier)


def _mapped(value: Any, rank: int, function: Callable[[Array], Array]) -> Any:
    """The function of a coefficient of that rank if it varies, else the coefficient."""
    return value if np.ndim(value) == rank else function(value)


def plane_stress(e1: Number, e2: Number, nu12: float, shear: Number | None) -> Array:
    """Plane-stress stiffness for (E11, E22, 2 E12), shape (..., 3, 3), in the unit of `e1`, `e2` and `shear`.

    Args:
        e1: Young's modulus along axis 1, times anything.
        e2: Young's modulus along axis 2, times the same.
        nu12: Contraction along 2 over extension along 1, pulled along 1.
        shear: Shear modulus, times the same; None takes the isotropic e1 / (2 (1 + nu12)).
    """
    across = 1.0 / (1.0 - nu12 * nu12 * np.divide(e2, e1))
    shear = e1 / (2.0 * (1.0 + nu12)) if shear is None else shear
    return matrix(across * e1, across * nu12 * e2, across * e2, shear)


def matrix(m11: Number, m12: Number, m22: Number, m33: Number) -> Array:
    """[[m11, m12, 0], [m12, m22, 0], [0, 0, m33]] at every place, shape (..., 3, 3)."""
    m11, m12, m22, m33 = np.broadcast_arrays(m11, m12, m22, m33)
    zero = np.zeros(np.shape(m11))
    rows = [[m11, m12, zero], [m12, m22, zero], [zero, zero, m33]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def of_matrix(factor: Number) -> Array:
    """A factor of a matrix at every place."""
    return np.asarray(factor)[..., None, None]
