"""Starts that a solid must not have: the rule cell by cell, and a fine block in long steps."""

from typing import Any

import numpy as np
import pytest
import warp as wp

from warpdeform.body import Body
from warpdeform.forces.solid_elasticity import SolidElasticity
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.material import Material
from warpdeform.obstacle import Obstacle
from warpdeform.settings import Settings
from warpdeform.shape import block
from warpdeform.simulation import Simulation
from warpdeform.study.peers.block import least_volume

NODES = (4, 3, 5)
RUBBER = Material(density=1000.0, youngs_modulus=1e5, poisson_ratio=0.4)


def forbidden(before: np.ndarray, after: np.ndarray, width: int, real: Any) -> bool:
    """Whether a way is forbidden."""
    grid, layout = ParameterGrid(NODES, (1.0,) * 3), Layout(NODES, width)
    term = SolidElasticity(grid, layout, grid.parameters(), RUBBER, real, "cpu")
    start, end = (wp.array(layout.pack(x), dtype=real, device="cpu") for x in (before, after))
    partials = wp.zeros((layout.rows, layout.columns), dtype=wp.float64, device="cpu")
    term.forbid_start(None, start, end, partials)  # type: ignore[arg-type]
    total = float(partials.numpy().sum())
    assert total in (0.0, np.inf)
    return total > 0.0


@pytest.mark.parametrize(("width", "real"), [(1, wp.float64), (8, wp.float64), (1, wp.float32), (16, wp.float32)])
def test_cells_may_be_squeezed_but_not_flat_nor_turned(width: int, real: Any) -> None:
    rest = ParameterGrid(NODES, (1.0,) * 3).parameters()
    assert not forbidden(rest, rest, width, real)
    assert not forbidden(rest, rest * [1.0, 1.0, 0.3], width, real)
    assert forbidden(rest, rest * [1.0, 1.0, 0.1], width, real)
    assert forbidden(rest, rest * [1.0, 1.0, -1.0], width, real)
    mirrored = rest * [-1.0, 1.0, 1.0]
    assert not forbidden(mirrored, mirrored * 1.5, width, real)
    assert forbidden(mirrored, rest, width, real)
    folded = rest.copy()
    folded[..., -1, 2] -= 1.5  # the last layer of cells alone
    assert forbidden(rest, folded, width, real)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_fine_block_lands_in_long_steps_without_folding(precision: str) -> None:
    # It falls by 2.3 cm a step onto cells of 8 mm.
    body = Body("block", block((4, 4, 25), size=(0.06, 0.06, 0.2)), RUBBER, position=(0.0, 0.0, 0.1))
    simulation = Simulation([body], obstacles=[Obstacle("plane")], settings=Settings(device="cpu", precision=precision))
    for _ in range(40):
        simulation.advance_frame()
        x = simulation["block"].positions()
        assert x[..., 2].min() > 0.0
        assert least_volume(x / [0.02, 0.02, 0.2 / 24], 1.0) > 0.3
