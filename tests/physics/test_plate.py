"""Square plates under uniform load against Kirchhoff's plate: deflection of the middle (design 1.6).

The deflection is 1e-6 of the side and less, so that stretching adds less than 1e-6 of it. Pinning the border row
supports the plate simply; pinning two rows clamps it in the middle between them.
"""

import pytest
from physics.statics import GRAVITY, equilibrium, listed, orders, percent, skewed_square

from warpdeform.body import Body, Pin
from warpdeform.material import Material
from warpdeform.shape import sheet

SUPPORTED, CLAMPED = 0.00406235, 0.00126532
"""w D / (q a^4) in the middle."""
LOAD = 1e-3


def deflection(cells: int, *, clamped: bool, poisson_ratio: float = 0.3, skewed: bool = False) -> float:
    """w D / (q a^4) in the middle of a plate of unit effective side and D = 1 N m."""
    side = cells / (cells - 1) if clamped else 1.0
    rows = 2 if clamped else 1
    material = Material(
        areal_density=LOAD / GRAVITY, membrane_stiffness=1e4, poisson_ratio=poisson_ratio, bending_stiffness=1.0
    )
    pins = tuple(Pin(f"edge:{axis},{end},{rows}") for axis in "uv" for end in (0, 1))
    shape = skewed_square(cells) if skewed else sheet((cells + 1, cells + 1), (side, side))
    body = Body("plate", shape, material, pins=pins)
    positions = equilibrium(body)["plate"].positions()
    return float(-positions[cells // 2, cells // 2, 2]) / LOAD


@pytest.mark.parametrize(
    ("clamped", "exact", "bound"), [(False, SUPPORTED, 5e-5), (True, CLAMPED, 2e-3)], ids=["supported", "clamped"]
)
def test_plate_deflects_as_kirchhoff_says(clamped: bool, exact: float, bound: float) -> None:
    cells = (16, 32, 64)
    errors = [deflection(count, clamped=clamped) / exact - 1 for count in cells]
    print(f"\nplate {'clamped' if clamped else 'supported'}, cells {cells}: errors", end=" ")
    print(f"{percent(errors)}; orders {listed(orders(errors))}", end="")
    assert abs(errors[-1]) < bound
    assert orders(errors).min() > 1.9


def test_a_supported_plate_deflects_alike_on_a_skewed_chart() -> None:
    cells = (16, 32, 64)
    errors = [deflection(count, clamped=False, skewed=True) / SUPPORTED - 1 for count in cells]
    print(f"\nplate supported, skewed chart, cells {cells}: errors", end=" ")
    print(f"{percent(errors)}; orders {listed(orders(errors))}", end="")
    assert abs(errors[-1]) < 3e-3
    assert orders(errors)[-1] > 1.85


def test_a_supported_plate_deflects_alike_for_every_poisson_ratio() -> None:
    """Along straight supported edges nu enters through D alone."""
    deflections = [deflection(16, clamped=False, poisson_ratio=nu) for nu in (0.0, 0.3, 0.45)]
    assert max(deflections) - min(deflections) < 2e-3 * SUPPORTED
