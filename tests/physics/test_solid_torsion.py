"""A square bar that is twisted by its ends, free to warp, against St. Venant's torsion."""

import numpy as np
import pytest
from physics.statics import listed, orders, percent
from scipy.sparse.linalg import spsolve
from solids import Term, box, stiffness_matrix

from warpdeform.material import Material

E = 1e6
SQUARE = 0.140577014955
"""J of a square over the fourth power of its side, from the series of St. Venant."""


def torsional_stiffness(cells: int, nu: float) -> float:
    """Torque over twist per length [N m2] of a bar of unit side, so many cells across.

    Every section turns about the axis by the twist that has come up to it and keeps its shape; along the axis it moves
    as it likes, but alike everywhere: a slice between two sections is enough, its two sides warped alike.
    """
    rest = box((2, cells + 1, cells + 1), (1.0 / cells, 1.0, 1.0))
    solid = Term(rest, Material(density=1000.0, youngs_modulus=E, poisson_ratio=nu))
    solid.linearise(rest.positions)
    K = stiffness_matrix(solid)
    x, y, z = np.moveaxis(rest.positions - [0.0, 0.5, 0.5], -1, 0)
    turned = np.stack([0.0 * x, -x * z, x * y], axis=-1).ravel()
    count = (cells + 1) ** 2
    index = np.arange(rest.positions.size).reshape(2, count, 3)
    # Warping w of a node moves both of its copies; one node is held.
    along = K[index[0, :, 0]] + K[index[1, :, 0]]
    A = (along[:, index[0, :, 0]] + along[:, index[1, :, 0]]).tocsc()[1:, 1:]
    warped = np.zeros(count)
    warped[1:] = spsolve(A, -(along @ turned)[1:])
    moved = turned.copy()
    moved[index[:, :, 0]] = warped
    return float(moved @ (K @ moved)) * cells


@pytest.mark.parametrize("nu", [0.0, 0.49])
def test_square_bar_twists_as_st_venant_says(nu: float) -> None:
    exact = SQUARE * E / (2 * (1 + nu))
    errors = np.array([torsional_stiffness(cells, nu) / exact - 1 for cells in (2, 4, 8, 16)])
    print(f"\ntwisted square bar nu {nu:g}, 2, 4, 8, 16 cells across: errors of GJ {percent(errors, 2)}", end="")
    print(f"; orders {listed(orders(errors))}", end="")
    assert orders(errors)[1:].min() > 1.8
    assert abs(errors[-1]) < 0.01
