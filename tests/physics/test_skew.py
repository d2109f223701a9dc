"""What skew of the rest shape costs: the bending energy of a cylinder bent out of a parallelogram, by direction."""

import numpy as np
import pytest

from warpdeform.body import Body
from warpdeform.errors import InputError
from warpdeform.forces.surface_coefficients import MAX_SKEW
from warpdeform.material import Material
from warpdeform.settings import Settings
from warpdeform.shape import from_array
from warpdeform.simulation import Simulation

RADIUS = 5.0
DIRECTIONS = np.pi * np.arange(6) / 6


def energies(cosine: float, cells: int = 32) -> np.ndarray:
    """Energy over D/(2 R^2) times the area, for bends along each direction."""
    u, v = np.meshgrid(np.linspace(0, 1, cells + 1), np.linspace(0, 1, cells + 1), indexing="ij")
    sine = np.sqrt(1 - cosine**2)
    rest = np.stack([u + cosine * v, sine * v, 0 * u], axis=-1)
    material = Material(areal_density=1.0, membrane_stiffness=1e-9, poisson_ratio=0.3, bending_stiffness=1.0)
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


def test_the_error_of_bending_is_below_twice_the_cosine_between_the_axes() -> None:
    for cosine in (0.01, 0.03, 0.99 * MAX_SKEW):
        ratio = energies(cosine) / energies(0.0)
        print(f"\nbending energy at cos {cosine:g} over that of a right angle, by direction: {ratio.round(4)}")
        assert np.abs(ratio - 1).max() < 2 * cosine


def test_more_skew_is_refused_with_the_angle() -> None:
    with pytest.raises(InputError, match=r"84 or more"):
        energies(1.1 * MAX_SKEW)
