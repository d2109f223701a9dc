"""A hanging strip without bending against the catenary: sag and horizontal thrust (design 1.6)."""

import numpy as np
import pytest
from physics.statics import GRAVITY, elastic_forces, equilibrium, listed, orders, percent

from warpdeform.body import Body, Pin
from warpdeform.material import Material
from warpdeform.shape import sheet

EXACT = {1.25: (0.331797, 0.422752), 1.5: (0.502633, 0.308236)}
"""Sag over span and thrust over weight per length times span, by length over span."""
WIDTH = 0.1


def hang(cells: int, length: float, bending: float = 0.0) -> tuple[float, float]:
    """Sag and thrust of a strip of unit weight per area over a unit span; it starts as a V of the right length."""
    u = np.linspace(-0.5, 0.5, cells + 1)
    depth = np.sqrt(length**2 - 1.0) * (np.abs(u) - 0.5)
    start = np.stack([np.broadcast_to(a[:, None], (cells + 1, 2)) for a in (u, 0 * u, depth)], axis=-1)
    start[:, 1, 1] = WIDTH
    material = Material(
        areal_density=1.0 / GRAVITY, membrane_stiffness=1e5, poisson_ratio=0.0, bending_stiffness=bending
    )
    body = Body(
        "strip",
        sheet((cells + 1, 2), (length, WIDTH)),
        material,
        initial_positions=start,
        pins=(Pin("edge:u,0"), Pin("edge:u,1")),
    )
    handle = equilibrium(body, dt=0.1)["strip"]
    pulls = elastic_forces(handle)
    left, right = pulls[0].sum(axis=0) / WIDTH, pulls[-1].sum(axis=0) / WIDTH
    np.testing.assert_allclose(left, right * [-1, -1, 1], atol=1e-6)
    half_cell = 0.5 * length / cells  # of the strip's weight, which hangs on the pin itself
    assert abs(left[2] + 0.5 * length - half_cell) < 1e-6
    return float(-handle.positions()[..., 2].min()), float(left[0])


@pytest.mark.parametrize("length", EXACT)
def test_catenary_sags_and_pulls_as_it_should(length: float) -> None:
    cells = (8, 16, 32)
    found = np.array([hang(count, length) for count in cells])
    errors = found / EXACT[length] - 1
    for name, column in zip(("sag", "thrust"), errors.T, strict=True):
        print(f"\ncatenary L/S {length:g}, {name}, cells {cells}: errors", end=" ")
        print(f"{percent(column)}; orders {listed(orders(column))}", end="")
    assert orders(errors).min() > 1.9
    assert np.abs(errors[-1]).max() < 1e-3


def test_a_trace_of_bending_leaves_the_catenary() -> None:
    np.testing.assert_allclose(hang(16, 1.25, bending=1e-9), hang(16, 1.25), rtol=1e-5)
