"""A round drum: a membrane on a chart with a pole, stretched evenly and held at its rim."""

import numpy as np
from physics.statics import listed, orders, percent
from scipy.linalg import eigh
from surfaces import Array, Surface, disk

from warpdeform.material import Material

STIFFNESS, NU, DENSITY, STRETCH = 1000.0, 0.3, 0.2, 1.1
ZEROS = np.array([2.404825557695773, 5.520078110286311, 8.653727912911012])
"""Of the Bessel function J0."""


def frequencies(rings: int) -> Array:
    """The lowest frequencies [1/s] at which all of a ring moves alike, across the drum."""
    shape = disk((2 * rings, rings))
    material = Material(areal_density=DENSITY, membrane_stiffness=STIFFNESS, poisson_ratio=NU)
    surface = Surface(shape, material)
    surface.linearise(shape.positions * STRETCH)
    mass = DENSITY * surface.force.stiffness.node_area.sum(axis=0)
    K = np.empty((rings, rings))
    for ring in range(rings):
        up = np.zeros_like(shape.positions)
        up[:, ring, 2] = 1.0
        K[ring] = surface.product(up)[..., 2].sum(axis=0)
    squares = eigh(K[:-1, :-1], np.diag(mass[:-1]), eigvals_only=True)
    return np.sqrt(squares[: len(ZEROS)])


def test_round_drum_sounds_as_bessel_says() -> None:
    # omega = (j0n/R0) sqrt(E h (lam^2 - 1) / (2 (1 - nu) mu)), R0 and mu at rest (design 1.6).
    exact = ZEROS * np.sqrt(STIFFNESS * (STRETCH**2 - 1) / (2 * (1 - NU) * DENSITY))
    errors = np.array([frequencies(rings) / exact - 1 for rings in (8, 16, 32)])
    print(
        f"\nround drum, modes 1-3, 32 rings: errors {percent(errors[-1])}; orders {listed(orders(errors)[-1])}", end=""
    )
    assert orders(errors).min() > 1.8
    assert np.abs(errors[-1]).max() < 5e-3
