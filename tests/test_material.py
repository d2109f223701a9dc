"""Materials: the coefficients against the textbook, and everything that must be refused."""

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from warpdeform.coefficients import (
    CurveCoefficients,
    PaperCurveWeights,
    PaperSolidWeights,
    PaperWeights,
    SolidCoefficients,
    SurfaceCoefficients,
    plane_stress,
)
from warpdeform.errors import InputError
from warpdeform.grid import ParameterGrid
from warpdeform.material import Material
from warpdeform.presets import PRESETS
from warpdeform.section import Section
from warpdeform.varying import Varying

PHYSICAL = {"density": 1000.0, "youngs_modulus": 1e6, "poisson_ratio": 0.3, "thickness": 0.002}
ORTHOTROPIC = PHYSICAL | {"youngs_modulus": (4e6, 1e6), "shear_modulus": 5e5}
SHELL = {"areal_density": 0.2, "membrane_stiffness": 1000.0, "poisson_ratio": 0.3, "bending_stiffness": 1e-5}
ZERO_ALLOWED = ("bending_stiffness", "xi")
PAPER = {"areal_density": 0.2, "eta": (500.0, 400.0, 300.0), "xi": 1e-5}


def coefficients(**values: object) -> SurfaceCoefficients:
    surface = Material(**values).surface()
    assert isinstance(surface, SurfaceCoefficients)
    return surface


def mistakes(**values: object) -> dict[str, str]:
    with pytest.raises(InputError) as caught:
        Material(**values).surface()
    return {mistake.key: str(mistake) for mistake in caught.value.mistakes}


def test_isotropic_plate_is_koiters() -> None:
    surface = coefficients(**PHYSICAL)
    h, nu = 0.002, 0.3
    pattern = np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]])
    np.testing.assert_allclose(surface.membrane, 1e6 * h / (1 - nu**2) * pattern, rtol=1e-14)
    np.testing.assert_allclose(surface.bending, 1e6 * h**3 / (12 * (1 - nu**2)) * pattern, rtol=1e-14)
    assert surface.membrane_modes == pytest.approx((2000.0, 2000.0))
    assert surface.density == pytest.approx(2.0)
    assert surface.thickness == h


def test_shell_constants_name_the_stiffness_itself() -> None:
    surface = coefficients(**SHELL)
    pattern = np.array([[1, 0.3, 0], [0.3, 1, 0], [0, 0, 0.35]])
    np.testing.assert_allclose(surface.membrane, 1000.0 / 0.91 * pattern, rtol=1e-14)
    np.testing.assert_allclose(surface.bending, 1e-5 * pattern, rtol=1e-14)
    assert (surface.density, surface.membrane_modes, surface.thickness) == (0.2, (1000.0, 1000.0), 0.0)


def test_shell_constants_and_physical_units_agree() -> None:
    plate = coefficients(**PHYSICAL)
    rigidity = 1e6 * 0.002**3 / (12 * 0.91)
    shell = coefficients(areal_density=2.0, membrane_stiffness=2000.0, poisson_ratio=0.3, bending_stiffness=rigidity)
    np.testing.assert_allclose(shell.membrane, plate.membrane, rtol=1e-14)
    np.testing.assert_allclose(shell.bending, plate.bending, rtol=1e-14)


def test_orthotropic_compliance_is_that_of_its_engineering_constants() -> None:
    surface = coefficients(**ORTHOTROPIC)
    compliance = np.linalg.inv(surface.membrane / 0.002)
    e1, e2, nu12, g12 = 4e6, 1e6, 0.3, 5e5
    expected = np.array([[1 / e1, -nu12 / e1, 0], [-nu12 / e1, 1 / e2, 0], [0, 0, 1 / g12]])
    np.testing.assert_allclose(compliance, expected, rtol=1e-12, atol=1e-22)
    np.testing.assert_allclose(surface.bending, surface.membrane * 0.002**2 / 12, rtol=1e-14)
    assert surface.membrane_modes == pytest.approx((8000.0, 2000.0))


def test_isotropy_is_a_special_case_of_orthotropy() -> None:
    spelled_out = PHYSICAL | {"youngs_modulus": [1e6, 1e6], "shear_modulus": 1e6 / 2.6}
    np.testing.assert_allclose(coefficients(**spelled_out).membrane, coefficients(**PHYSICAL).membrane, rtol=1e-14)


def test_turning_the_axes_swaps_the_coefficients() -> None:
    there = coefficients(**ORTHOTROPIC, bending_multipliers=(2.0, 0.5))
    back = coefficients(
        **ORTHOTROPIC | {"youngs_modulus": (1e6, 4e6), "poisson_ratio": 0.3 / 4}, bending_multipliers=(0.5, 2.0)
    )
    swap = np.array([1, 0, 2])
    for name in ("membrane", "bending"):
        np.testing.assert_allclose(getattr(there, name)[np.ix_(swap, swap)], getattr(back, name), rtol=1e-13)


def test_bending_multipliers_scale_the_bending_only() -> None:
    plain, scaled = coefficients(**PHYSICAL), coefficients(**PHYSICAL, bending_multipliers=(4.0, 0.25))
    np.testing.assert_array_equal(scaled.membrane, plain.membrane)
    factors = np.array([[4.0, 1.0, 1.0], [1.0, 0.25, 1.0], [1.0, 1.0, 1.0]])
    np.testing.assert_allclose(scaled.bending, plain.bending * factors, rtol=1e-14)
    assert not coefficients(**PHYSICAL, bending_multipliers=(0, 0)).bending.any()


def test_a_membrane_has_no_bending() -> None:
    without = {key: value for key, value in SHELL.items() if key != "bending_stiffness"}
    assert not coefficients(**without).bending.any()
    assert Material(areal_density=0.2, eta=500.0).surface().xi == (0.0, 0.0, 0.0)


def test_the_papers_weights_have_no_cross_term() -> None:
    weights = Material(**PAPER).surface()
    assert weights == PaperWeights(0.2, (500.0, 400.0, 300.0), (1e-5, 1e-5, 1e-5), 0.0)


@pytest.mark.parametrize("values", [PHYSICAL, ORTHOTROPIC, SHELL, SHELL | {"shear_stiffness": 10}], ids=str)
@pytest.mark.parametrize("nu", [-0.9, 0.0, 0.49])
def test_stiffness_is_symmetric_and_positive(values: dict[str, object], nu: float) -> None:
    surface = coefficients(**values | {"poisson_ratio": nu})
    for matrix in (surface.membrane, surface.bending):
        np.testing.assert_array_equal(matrix, matrix.T)
        assert np.linalg.eigvalsh(matrix).min() > 0


def test_plane_stress_without_shear_modulus_is_isotropic() -> None:
    turn = math.radians(30)
    c, s = math.cos(turn), math.sin(turn)
    strain = np.array([[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]])
    stiffness = plane_stress(3.0, 3.0, 0.2, None)
    np.testing.assert_allclose(strain.T @ stiffness @ strain, stiffness, atol=1e-14)


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_sourced_and_sane(name: str) -> None:
    preset = Material.preset(name)
    assert preset.name == name
    assert len(preset.source) > 50
    surface = preset.surface()
    assert isinstance(surface, SurfaceCoefficients)
    assert 0.02 < surface.density < 1.0
    assert 100 < min(surface.membrane_modes) <= max(surface.membrane_modes) < 1e8
    assert 1e-6 < surface.bending[0, 0] < 0.1
    assert np.linalg.eigvalsh(surface.membrane).min() > 0
    assert np.linalg.eigvalsh(surface.bending).min() > 0


def test_presets_stand_in_the_order_that_hands_feel() -> None:
    stiffness = {name: Material.preset(name).surface().bending[0, 0] for name in PRESETS}
    order = ["silk", "cotton", "denim", "paper", "spring-steel"]
    assert sorted(order, key=stiffness.__getitem__) == order


def test_presets_can_be_varied() -> None:
    thin = replace(Material.preset("spring-steel"), thickness=5e-5)
    assert thin.surface().density == pytest.approx(7850 * 5e-5)
    with pytest.raises(InputError, match=r'material = "velvet".*cotton'):
        Material.preset("velvet")


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf, "1", True, None, [1.0, 2.0, 3.0, 4.0], {}])
@pytest.mark.parametrize(
    ("values", "key"),
    [(form, key) for form in (PHYSICAL, SHELL, PAPER) for key in form if key not in ("poisson_ratio", *ZERO_ALLOWED)],
)
def test_bad_numbers_are_refused_with_their_unit(values: dict[str, object], key: str, bad: object) -> None:
    said = mistakes(**values | {key: bad})
    if bad is None and key in ("youngs_modulus", "membrane_stiffness", "eta"):
        assert "youngs_modulus" in said
    else:
        assert any(unit in said[key] for unit in ("kg/m3", "Pa", "Use m,", "kg/m2", "N/m", "N m"))


@pytest.mark.parametrize("bad", [-1.0, math.nan, "1", [1.0, 2.0]])
@pytest.mark.parametrize(("values", "key"), [(SHELL, "bending_stiffness"), (PAPER, "xi")])
def test_bad_bending_is_refused(values: dict[str, object], key: str, bad: object) -> None:
    assert "N m" in mistakes(**values | {key: bad})[key]


@pytest.mark.parametrize("nu", [0.5, 0.7, -1.0, math.nan, "0.3"])
@pytest.mark.parametrize("values", [PHYSICAL, SHELL])
def test_bad_poisson_ratios_are_refused(values: dict[str, object], nu: object) -> None:
    said = mistakes(**values | {"poisson_ratio": nu})
    assert list(said) == ["poisson_ratio"]
    assert "0.49" in said["poisson_ratio"]


def test_orthotropic_poisson_ratio_must_be_admissible() -> None:
    assert coefficients(**ORTHOTROPIC | {"poisson_ratio": 1.9}).membrane[0, 0] > 0
    assert "nu12 nu21" in mistakes(**ORTHOTROPIC | {"poisson_ratio": 2.0})["poisson_ratio"]
    assert "nu12 nu21" in mistakes(**ORTHOTROPIC | {"poisson_ratio": -2.1})["poisson_ratio"]


def test_exactly_one_form() -> None:
    assert "eta" in mistakes(**SHELL, eta=500.0)
    assert "membrane_stiffness" in mistakes(**PHYSICAL, membrane_stiffness=1000.0)
    assert (
        "is missing, as are membrane_stiffness, axial_stiffness and eta" in mistakes(density=1000.0)["youngs_modulus"]
    )
    assert "does not go with eta" in mistakes(**PAPER, bending_stiffness=1e-5)["bending_stiffness"]
    assert "does not go with youngs_modulus" in mistakes(**PHYSICAL, areal_density=1.0)["areal_density"]


def test_orthotropy_needs_its_shear() -> None:
    assert "shear_modulus" in mistakes(**PHYSICAL | {"youngs_modulus": (1e6, 2e6)})
    assert "shear_stiffness" in mistakes(**SHELL | {"membrane_stiffness": (1e3, 2e3)})


GRID = ParameterGrid((4, 3), (0.1, 0.1))
THICKNESS = np.array([[1.0, 2.0], [1.0, 2.0], [4.0, 2.0]]) * 1e-3


@pytest.mark.parametrize("at", ["cells", "nodes"])
@pytest.mark.parametrize(
    ("values", "local"),
    [
        (PHYSICAL, {"thickness": THICKNESS, "density": lambda u, v: 900 + 100 * u}),
        (ORTHOTROPIC, {"youngs_modulus": (Varying(THICKNESS * 1e9), 1e6), "thickness": Varying(THICKNESS)}),
        (SHELL, {"bending_stiffness": THICKNESS, "membrane_stiffness": lambda u, v: 900 + 100 * v}),
        (SHELL, {"bending_multipliers": THICKNESS}),
        (PAPER, {"eta": (lambda u, v: 400 + u, 300.0, Varying(THICKNESS)), "xi": THICKNESS}),
    ],
)
def test_what_varies_is_everywhere_the_material_of_that_place(
    values: dict[str, object], local: dict[str, object], at: str
) -> None:
    material = Material(**values | local)
    assert material.varies
    assert not Material(**values).varies
    found = material.surface(GRID, at=at)

    def here(value: object, index: tuple[int, ...]) -> object:
        if isinstance(value, tuple):
            return tuple(here(item, index) for item in value)
        if isinstance(value, np.ndarray) or callable(value):
            value = Varying(value)
        return getattr(value, f"at_{at}")(GRID)[index] if isinstance(value, Varying) else value

    for index in np.ndindex(GRID.cells if at == "cells" else GRID.nodes):
        alone = Material(**values | {key: here(value, index) for key, value in local.items()}).surface()
        picked = found.mapped(lambda array, index=index: array[index])
        for name, value in vars(alone).items():
            np.testing.assert_allclose(np.array(getattr(picked, name)), np.array(value), rtol=1e-13)


def test_exchanged_axes_are_those_of_the_exchanged_material() -> None:
    there = Material(**ORTHOTROPIC, bending_multipliers=(2.0, 0.5)).surface().exchanged()
    back = Material(
        **ORTHOTROPIC | {"youngs_modulus": (1e6, 4e6), "poisson_ratio": 0.3 / 4}, bending_multipliers=(0.5, 2.0)
    ).surface()
    for name in ("membrane", "bending", "membrane_modes"):
        np.testing.assert_allclose(getattr(there, name), getattr(back, name), rtol=1e-13)
    assert Material(**PAPER).surface().exchanged().eta == (400.0, 500.0, 300.0)


def test_mean_thickness() -> None:
    assert Material(**PHYSICAL).mean_thickness(GRID) == 0.002
    assert Material(**SHELL).mean_thickness(GRID) == 0.0
    assert Material(**PHYSICAL | {"thickness": lambda u, v: 0.001 + 0.002 * u}).mean_thickness(GRID) == pytest.approx(
        0.002
    )


def test_what_varies_must_be_physical_everywhere() -> None:
    holed = THICKNESS.copy()
    holed[1, 1] = 0.0
    assert "must be positive" in mistakes(**PHYSICAL | {"thickness": holed})["thickness"]
    assert "an array of shape (3, 2)" in mistakes(**PHYSICAL | {"thickness": holed})["thickness"]
    Material(**SHELL | {"bending_stiffness": holed})
    assert (
        "is not finite at [0, 0]"
        in mistakes(**PHYSICAL | {"thickness": [[np.nan, 1.0]] * np.ones((2, 2))})["thickness"]
    )
    assert "must be one number" in mistakes(**PHYSICAL | {"poisson_ratio": lambda u, v: 0.3 * u})["poisson_ratio"]
    for values, problem in (
        ({"thickness": lambda u, v: u - 0.2}, "thickness: must be positive, and is -0.0333333 at the cell [0, 0]"),
        ({"thickness": np.ones((7, 7))}, "thickness: has the shape 7 x 7"),
        ({"thickness": 1.0, "density": lambda u: u}, "density: is a function that fails"),
    ):
        with pytest.raises(InputError, match=re.escape(problem)):
            Material(**PHYSICAL | values).surface(GRID)
    uneven = Material(**ORTHOTROPIC | {"youngs_modulus": (lambda u, v: 1e4 + 4e6 * u, 1e6)})
    with pytest.raises(InputError, match="nu12 nu21"):
        uneven.surface(GRID, at="nodes")
    with pytest.raises(ValueError, match="thickness varies over the body"):
        Material(**PHYSICAL | {"thickness": THICKNESS}).surface()


def test_all_mistakes_are_said_at_once() -> None:
    said = mistakes(density=-1.0, youngs_modulus=1e6, poisson_ratio=0.6, thickness=0.0, damping=-1.0, xi=1.0)
    assert set(said) == {"density", "poisson_ratio", "thickness", "damping", "xi"}


ROUND = Section.circular(0.01)
ROD = {"linear_density": 0.1, "axial_stiffness": 1000.0, "bending_stiffness": (2e-4, 4e-4)}


def test_curves_of_a_substance_have_the_stiffness_of_their_section() -> None:
    curve = Material(density=1000.0, youngs_modulus=2e6, poisson_ratio=0.25).curve(Section.rectangular(0.03, 0.01))
    assert curve.density == pytest.approx(0.3)
    assert curve.axial == pytest.approx(600.0)
    assert curve.bending == pytest.approx((2e6 * 0.03 * 1e-6 / 12, 2e6 * 0.01 * 27e-6 / 12))
    assert curve.torsion == pytest.approx(8e5 * Section.rectangular(0.03, 0.01).torsion)


def test_rod_constants_name_the_stiffness_itself() -> None:
    assert Material(**ROD).curve() == CurveCoefficients(0.1, 1000.0, (2e-4, 4e-4), pytest.approx(3e-4))
    assert Material(**ROD, torsional_stiffness=5e-5).curve().torsion == 5e-5
    string = Material(linear_density=0.1, axial_stiffness=1000.0).curve()
    assert (string.bending, string.torsion) == ((0.0, 0.0), 0.0)


def test_the_papers_weights_of_a_curve() -> None:
    weights = Material(linear_density=0.1, eta=500.0, xi=1e-3)
    assert weights.curve() == PaperCurveWeights(0.1, 500.0, 1e-3)


def test_presets_of_substances_make_curves() -> None:
    for name in ("rubber", "spring-steel"):
        assert Material.preset(name).curve(ROUND).axial > 0


@pytest.mark.parametrize(
    ("values", "section", "key", "message"),
    [
        (PHYSICAL, None, "section", "is missing beside youngs_modulus in a curve"),
        (ORTHOTROPIC, ROUND, "youngs_modulus", "must be one number in a curve"),
        (SHELL, ROUND, "membrane_stiffness", "does not describe a curve"),
        ({"areal_density": 0.2, "eta": 500.0}, None, "linear_density", "is missing beside eta"),
        ({"linear_density": 0.2, "eta": (1.0, 2.0, 3.0)}, None, "eta", "must be one number in a curve"),
        ({"linear_density": 0.2, "eta": 1.0, "xi": (1.0, 2.0, 3.0)}, None, "xi", "must be one number in a curve"),
    ],
)
def test_materials_that_make_no_curve_say_why(values: Any, section: Any, key: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        Material(**values).curve(section)
    assert [mistake.key for mistake in caught.value.mistakes] == [key]


def test_materials_that_make_no_surface_say_why() -> None:
    assert "does not describe a surface" in mistakes(**ROD)["axial_stiffness"]
    assert "Use m, " in mistakes(density=1000.0, youngs_modulus=1e6, poisson_ratio=0.3)["thickness"]
    assert "kg/m2" in mistakes(eta=500.0, linear_density=0.1)["areal_density"]


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf, "1", True, [1.0, 2.0]])
@pytest.mark.parametrize("key", ["linear_density", "axial_stiffness"])
def test_bad_rod_constants_are_refused_with_their_unit(key: str, bad: object) -> None:
    assert any(unit in mistakes(**ROD | {key: bad})[key] for unit in ("kg/m", "Use N "))


def test_rod_constants_go_with_nothing_else() -> None:
    assert "does not go with axial_stiffness" in mistakes(**ROD, poisson_ratio=0.3)["poisson_ratio"]
    assert "is missing beside axial_stiffness" in mistakes(axial_stiffness=1.0)["linear_density"]
    assert "N m2" in mistakes(**ROD, torsional_stiffness=-1.0)["torsional_stiffness"]


def test_solids_need_no_thickness() -> None:
    values = {key: value for key, value in PHYSICAL.items() if key != "thickness"}
    assert Material(**values).solid() == SolidCoefficients(1000.0, 1e6, 0.3, 0.0)
    assert Material(**PHYSICAL, inversion_barrier=2e5).solid() == SolidCoefficients(1000.0, 1e6, 0.3, 2e5)
    assert "Use m," in mistakes(**values)["thickness"]


def test_the_papers_weights_of_a_solid_are_six() -> None:
    six = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    assert Material(density=1000.0, eta=six).solid() == PaperSolidWeights(1000.0, six, 0.0)
    assert Material(density=1000.0, eta=5.0, inversion_barrier=1.0).solid() == PaperSolidWeights(
        1000.0, (5.0,) * 6, 1.0
    )


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (SHELL, "membrane_stiffness = 1000.0: does not describe a solid. Use one of youngs_modulus, eta."),
        (ORTHOTROPIC, "youngs_modulus = [4000000.0, 1000000.0]: does not go with a solid. Use one number, in Pa"),
        (PHYSICAL | {"shear_modulus": 1e5}, "shear_modulus = 100000.0: does not go with a solid. Leave out"),
        (PHYSICAL | {"bending_multipliers": (1.0, 2.0)}, "bending_multipliers = [1.0, 2.0]: does not go with a solid"),
        ({"eta": 5.0}, "density: is missing beside eta. Use kg/m3"),
        ({"eta": (1.0, 2.0, 3.0), "density": 1e3}, "eta = [1.0, 2.0, 3.0]: does not go with a solid. Use one number"),
        (PHYSICAL | {"inversion_barrier": -1.0}, "inversion_barrier = -1.0: must not be negative. Use Pa"),
    ],
)  # fmt: skip
def test_what_is_no_solid_is_refused(values: dict[str, object], said: str) -> None:
    with pytest.raises(InputError) as caught:
        Material(**values).solid()
    assert str(caught.value).startswith(said)


def test_what_only_solids_have_is_refused_for_surfaces() -> None:
    assert "does not go with a surface" in mistakes(**PHYSICAL, inversion_barrier=1.0)["inversion_barrier"]
    assert "N/m" in mistakes(areal_density=0.2, eta=(1.0,) * 6)["eta"]
