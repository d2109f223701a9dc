"""Heavy cantilever rods against the elastica under its own weight (design 1.6), all of them strands of one body.

A rod of unit free length is clamped by pinning its first two nodes. The clamp acts in the middle of the pinned segment,
so that the rod is half a segment longer; Gamma = w L^3 / EI, and with a radius for each Gamma all have one material.
"""

import numpy as np
import pytest
from curves import Curve
from physics.curve_statics import Array, Strands
from physics.statics import GRAVITY, orders, percent
from physics.test_cantilever import master_curve

from warpdeform.material import Material
from warpdeform.section import Section

GAMMAS = np.array([0.1, 1.0, 5.0, 10.0, 20.0, 50.0, 100.0])
DENSITY, MODULUS = 1000.0, 1e9
"""Of the thickest rod an end pulls it longer by less than 1e-5."""


def hang(cells: int, *, framed: bool = False, gammas: Array = GAMMAS) -> Array:
    """Height over width of the rods at rest."""
    radii = np.sqrt(4 * DENSITY * GRAVITY / (MODULUS * gammas))
    length = cells / (cells - 0.5)
    rest = np.linspace(0, length, cells + 1)[:, None, None] * np.array([1.0, 0.0, 0.0]) + np.zeros((1, len(gammas), 1))
    material = Material(density=DENSITY, youngs_modulus=MODULUS, poisson_ratio=0.0)
    sections = [Section.circular(radius) for radius in radii]
    curve = Curve(rest, material, lane_width=8, section=sections, framed=framed)
    lengths = np.full((cells, len(gammas)), length / cells)
    mass = DENSITY * np.pi * radii**2 * curve.grid.cells_to_nodes(lengths)
    pinned = np.zeros(curve.nodes, dtype=bool)
    pinned[:2] = True
    end = Strands(curve, mass, pinned).settle()[-1]
    return -end[:, 2] / (end[:, 0] - 0.5 * length / cells)


def exact(gammas: Array) -> Array:
    return np.array([master_curve()[gamma]["H_over_W"] for gamma in gammas])


def test_rods_follow_the_heavy_elastica() -> None:
    errors = hang(40) / exact(GAMMAS) - 1
    print(f"\ncantilever rods, 40 cells, Gamma {GAMMAS}: errors of H/W {percent(errors)}", end="")
    assert np.abs(errors).max() < 0.02


def test_rods_converge_with_second_order() -> None:
    gammas = np.array([1.0, 20.0])
    errors = [hang(cells, gammas=gammas) / exact(gammas) - 1 for cells in (10, 20, 40)]
    found = orders(errors)
    print(f"\ncantilever rods, 10, 20, 40 cells: {percent(errors)}; orders {found.round(2).tolist()}", end="")
    assert found.min() > 1.85
    assert found.max() < 2.15


def test_frames_change_nothing_that_bends_in_a_plane() -> None:
    gammas = np.array([1.0, 20.0])
    assert hang(10, framed=True, gammas=gammas) == pytest.approx(hang(10, gammas=gammas), rel=1e-7)
