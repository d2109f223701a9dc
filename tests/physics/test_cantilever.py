"""Heavy cantilever strip against the elastica under its own weight (design 1.6).

A strip of unit length and weight, nu = 0, is clamped by pinning its first two rows. The clamp acts in the middle of the
pinned segment, so that its free length is (cells - 1/2) spacings; Gamma = w L^3 / D with that length. Height H and
width W are measured from the same point to the tip.
"""

import csv
from pathlib import Path

import numpy as np
import pytest
from physics.statics import GRAVITY, Array, equilibrium, listed, orders, percent

from warpdeform.body import Body, Pin
from warpdeform.material import Material
from warpdeform.shape import sheet
from warpdeform.simulation import Simulation

REFERENCE = Path(__file__).parents[1] / "data" / "cantilever_master_curve.csv"
WEIGHT = 1.0
"""Weight per area [N/m2]; with the unit length and width it makes D = 1 / Gamma."""
STIFFNESS = 1e5
"""Membrane stiffness [N/m]: the strip stretches by less than 1e-5 under its own weight."""


def master_curve() -> dict[float, dict[str, float]]:
    """The reference by Gamma."""
    with REFERENCE.open() as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    return {row["Gamma"]: row for row in rows}


def shell(gamma: float) -> Material:
    return Material(
        areal_density=WEIGHT / GRAVITY,
        membrane_stiffness=STIFFNESS,
        poisson_ratio=0.0,
        bending_stiffness=WEIGHT / gamma,
    )


def paper(gamma: float) -> Material:
    return Material(areal_density=WEIGHT / GRAVITY, eta=0.5 * STIFFNESS, xi=WEIGHT / gamma)


def hang(cells: int, material: Material, *, axis: str = "u", gravity: float = -GRAVITY) -> Simulation:
    """A strip of `cells` cells along `axis`, clamped at its start, at rest."""
    length, nodes = cells / (cells - 0.5), (cells + 1, 3)
    size = (length, 0.1)
    shape = sheet(nodes, size) if axis == "u" else sheet(nodes[::-1], size[::-1])
    body = Body("strip", shape, material, pins=(Pin(f"edge:{axis},0,2"),))
    return equilibrium(body, gravity=(0.0, 0.0, gravity))


def tip(simulation: Simulation, cells: int, axis: str = "u") -> Array:
    """Width W and height H of the strip over its free length."""
    positions = simulation["strip"].positions()
    end = positions[-1].mean(axis=0) if axis == "u" else positions[:, -1].mean(axis=0)[[1, 0, 2]]
    return np.array([end[0] - 0.5 / (cells - 0.5), -end[2]])


@pytest.mark.parametrize("gamma", [0.1, 1.0, 5.0, 10.0, 20.0, 50.0, 100.0])
def test_cantilever_follows_the_heavy_elastica(gamma: float) -> None:
    width, height = tip(hang(40, shell(gamma)), 40)
    exact = master_curve()[gamma]
    errors = height / width / exact["H_over_W"] - 1, height - exact["H_over_L"], width - exact["W_over_L"]
    print(f"\ncantilever Gamma {gamma:g}: H/W {height / width:.6f}, exact {exact['H_over_W']:.6f}", end="")
    print(f"; errors H/W {errors[0]:+.2%}, H/L {errors[1]:+.5f}, W/L {errors[2]:+.5f}", end="")
    assert abs(errors[0]) < 0.01
    assert max(map(abs, errors[1:])) < 0.001


def test_cantilever_converges_with_second_order() -> None:
    gamma, cells = 50.0, (10, 20, 40)
    exact = master_curve()[gamma]["H_over_W"]
    ratios = []
    for count in cells:
        width, height = tip(hang(count, shell(gamma)), count)
        ratios.append(height / width)
    errors = [ratio / exact - 1 for ratio in ratios]
    print(f"\ncantilever Gamma {gamma:g}, cells {cells}: errors", end=" ")
    print(f"{percent(errors)}; orders {listed(orders(errors))}", end="")
    assert orders(errors)[0] > 1.6
    assert orders(errors)[1] > 1.9


def test_a_flat_strip_bends_equally_easily_both_ways() -> None:
    down, up = (hang(12, shell(10.0), gravity=g)["strip"].positions() for g in (-GRAVITY, GRAVITY))
    np.testing.assert_array_equal(down, up * [1.0, 1.0, -1.0])


def test_a_strip_bends_alike_along_either_axis() -> None:
    along_u, along_v = (tip(hang(12, shell(10.0), axis=axis), 12, axis) for axis in "uv")
    np.testing.assert_allclose(along_v, along_u, atol=1e-6)


def test_the_papers_weights_are_the_same_strip() -> None:
    """At nu = 0 they are eta = E h / 2 and xi = E h^3 / 12 (design 1.4)."""
    ours, theirs = (tip(hang(12, material(10.0)), 12) for material in (shell, paper))
    np.testing.assert_allclose(theirs, ours, atol=1e-6)
