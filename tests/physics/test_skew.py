"""Bending does not see the chart: the energy of a cylinder bent out of a parallelogram, by direction and skew.

The cylinder is forced upon the sheet, and nodes of the first and last row or column have no curvature across: half a
cell at each border carries the least energy that goes with the rest. That is what leaves free edges free of moments; it
is 3 % of the energy at 32 cells, right angles or not, and the exact value counts it.
"""

import numpy as np
import pytest
from physics.statics import Array, orders, percent

from warpdeform.body import Body
from warpdeform.material import Material
from warpdeform.settings import Settings
from warpdeform.shape import from_array
from warpdeform.simulation import Simulation

RADIUS = 5.0
POISSON_RATIO = 0.3
DIRECTIONS = np.pi * np.arange(6) / 6


def energies(cosine: float, cells: int) -> Array:
    """Energy over D/(2 R^2) times the area, for bends along each direction."""
    u, v = np.meshgrid(np.linspace(0, 1, cells + 1), np.linspace(0, 1, cells + 1), indexing="ij")
    sine = np.sqrt(1 - cosine**2)
    rest = np.stack([u + cosine * v, sine * v, 0 * u], axis=-1)
    material = Material(areal_density=1.0, membrane_stiffness=1e-9, poisson_ratio=POISSON_RATIO, bending_stiffness=1.0)
    settings = Settings(precision="float64", gravity=(0, 0, 0))
    found = []
    for angle in DIRECTIONS:
        along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        s, t = rest[..., :2] @ along, rest[..., :2] @ across
        bent = np.stack([RADIUS * np.sin(s / RADIUS), t, RADIUS * (1 - np.cos(s / RADIUS))], axis=-1)
        body = Body("sheet", from_array(rest), material, initial_positions=bent)
        simulation = Simulation([body], settings=settings, captured=False)
        found.append(simulation.record().energy.elastic / (0.5 * sine / RADIUS**2))
    return np.array(found)


def exact_energies(cosine: float, cells: int) -> Array:
    """The same from Kirchhoff's plate; strips of half a cell along the borders bend across as they like."""
    axes = np.array([[1.0, 0.0], [cosine, np.sqrt(1 - cosine**2)]])
    raised = [np.linalg.solve(axes @ axes.T, T) for T in ([[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 1], [1, 0]])]
    traces = np.array([np.trace(T) for T in raised])
    squares = np.array([[np.trace(S @ T) for T in raised] for S in raised])
    law = POISSON_RATIO * np.outer(traces, traces) + (1 - POISSON_RATIO) * squares
    h = 1.0 / cells
    found = []
    for angle in DIRECTIONS:
        k1, k2 = axes @ [np.cos(angle), np.sin(angle)]
        k = np.array([k1**2, k2**2, k1 * k2])
        total = (1 - h) ** 2 * k @ law @ k
        for share, free in ((h * (1 - h), [0]), (h * (1 - h), [1]), (h**2, [0, 1])):
            held = [index for index in range(3) if index not in free]
            released = k.copy()
            released[free] = np.linalg.solve(law[np.ix_(free, free)], -law[np.ix_(free, held)] @ k[held])
            total += share * released @ law @ released
        found.append(total)
    return np.array(found)


@pytest.mark.parametrize("cosine", [0.0, 0.01, 0.1, 0.5, 0.707, 0.9])
def test_a_cylinder_has_its_energy_whatever_the_angle_between_the_axes(cosine: float) -> None:
    cells = (8, 16, 32)
    errors = np.array([energies(cosine, count) / exact_energies(cosine, count) - 1 for count in cells])
    print(f"\ncylinder at cos {cosine:g}, {cells[-1]} cells, by direction: errors {percent(errors[-1], 4)}", end="")
    print(f"; lowest order {orders(errors).min():.2f}", end="")
    assert np.abs(errors[-1]).max() < 1e-4
    assert orders(errors).min() > 1.9


def test_borders_are_all_that_a_cylinder_lacks() -> None:
    """Their share falls with the spacing: without it the energies at two spacings extrapolate to Kirchhoff's."""
    for cosine in (0.0, 0.707):
        coarse, fine = energies(cosine, 16), energies(cosine, 32)
        assert np.abs(fine - 1).max() < 0.06
        assert np.abs(2 * fine - coarse - 1).max() < 2e-3
