"""A rubber block dropped on the ground: it stays above it, keeps its cells upright where it is asked to, and rests."""

from typing import Any

import numpy as np
import pytest

from warpdeform.body import Body
from warpdeform.forces.solid_coefficients import RestCells
from warpdeform.material import Material
from warpdeform.obstacle import Obstacle
from warpdeform.settings import Settings
from warpdeform.shape import block
from warpdeform.simulation import Simulation

Array = np.ndarray[Any, Any]


def drop(height: float, speed: float = 0.0, **of: Any) -> Simulation:
    """A cube of 0.2 m, ten nodes to a side."""
    law = {"density": 1000.0, "youngs_modulus": 1e5, "poisson_ratio": 0.4, **of}
    shape = block(nodes=(10, 10, 10), size=(0.2, 0.2, 0.2))
    body = Body("jelly", shape, Material(**law), position=(0.0, 0.0, height), velocity=(0.0, 0.0, -speed))
    return Simulation([body], obstacles=[Obstacle("plane")], settings=Settings(device="cpu"))


def relative_volumes(simulation: Simulation) -> Array:
    handle = simulation["jelly"]
    grid = handle.model.grid
    now = RestCells(grid, handle.positions(), check=False).signed_volume
    return now / RestCells(grid, handle.rest_positions).signed_volume


def test_dropped_block_stays_above_the_ground_and_comes_to_rest() -> None:
    simulation = drop(0.1)
    lowest = min(float((simulation.step(), simulation["jelly"].positions())[1][..., 2].min()) for _ in range(180))
    handle = simulation["jelly"]
    print(f"\ndropped block: lowest point {1e3 * lowest:.2f} mm above the ground", end="")
    assert lowest > 0.0
    assert np.abs(handle.velocities()).max() < 0.05
    assert relative_volumes(simulation).min() > 0.95


@pytest.mark.parametrize("barrier", [None, 2e4])
def test_barrier_keeps_cells_upright_in_an_impact_that_turns_them_over(barrier: float | None) -> None:
    simulation = drop(0.1, 8.0, inversion_barrier=barrier)
    least = 1.0
    for _ in range(20):
        simulation.step()
        least = min(least, float(relative_volumes(simulation).min()))
    print(f"\nimpact at 8 m/s, barrier {barrier}: smallest volume {least:.3f} of that at rest", end="")
    assert (least > 0.0) == (barrier is not None)
