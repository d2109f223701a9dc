"""Frequencies of strings and rods against closed forms that are exact on the grid (design 1.6)."""

import numpy as np
import pytest
import warp as wp
from curves import Array, Curve, segment_lengths
from physics.statics import listed, orders, percent
from scipy.linalg import eigh

from warpdeform.material import Material

DENSITY, STIFFNESS = 0.1, 50.0


def string(count: int, material: Material) -> Curve:
    rest = np.linspace(0, 1, count)[:, None, None] * np.array([1.0, 0.0, 0.0])
    return Curve(rest, material, wp.float64, 1)


@pytest.mark.parametrize("mode", [1, 3, 15])
def test_prestretched_string_swings_at_its_exact_frequencies(mode: int) -> None:
    # omega = (2/h) sin(n pi h / 2L) sqrt(EA (lam^2 - 1) / 2 mu) across, 3 lam^2 - 1 along.
    count, stretch = 17, 1.3
    curve = string(count, Material(linear_density=DENSITY, axial_stiffness=STIFFNESS))
    h = 1.0 / (count - 1)
    wave = np.sin(mode * np.pi * np.arange(count) / (count - 1))[:, None]
    rate = (2 / h * np.sin(mode * np.pi * h / 2)) ** 2
    curve.linearise(curve.rest * stretch)
    mass = DENSITY * curve.grid.cells_to_nodes(segment_lengths(curve))
    for axis, tension in ((2, stretch**2 - 1), (1, stretch**2 - 1), (0, 3 * stretch**2 - 1)):
        push = curve.product(np.where(np.arange(3) == axis, wave[..., None], 0.0))
        expected = rate * STIFFNESS * tension / (2 * DENSITY) * wave * mass
        assert np.abs(push[1:-1, :, axis] - expected[1:-1]).max() < 1e-11 * np.abs(expected).max()


@pytest.mark.parametrize("framed", [False, True])
def test_pinned_rod_bends_at_its_exact_frequencies(framed: bool) -> None:
    # omega^2 = (EI / mu) ((2/h) sin(n pi h / 2L))^4: the sine is an eigenvector of the second difference.
    count, mode, bending = 17, 3, 0.4
    material = Material(linear_density=DENSITY, axial_stiffness=STIFFNESS, bending_stiffness=bending)
    rest = np.linspace(0, 1, count)[:, None, None] * np.array([1.0, 0.0, 0.0])
    curve = Curve(rest, material, wp.float64, 1, framed=framed)
    h = 1.0 / (count - 1)
    wave = np.sin(mode * np.pi * np.arange(count) / (count - 1))[:, None]
    curve.linearise(curve.rest)
    push = curve.product(wave[..., None] * np.array([0.0, 0.6, 0.8]))
    expected = bending * (2 / h * np.sin(mode * np.pi * h / 2)) ** 4 * wave * h
    assert np.abs(push @ np.array([0.0, 0.6, 0.8]) - expected)[1:-1].max() < 1e-6 * np.abs(expected).max()


def clamped_frequencies(cells: int, framed: bool) -> Array:
    """The two lowest of a rod of unit EI, mass and free length, its first two nodes pinned."""
    material = Material(linear_density=1.0, axial_stiffness=1e4, bending_stiffness=1.0)
    rest = np.linspace(0, cells / (cells - 0.5), cells + 1)[:, None, None] * np.array([1.0, 0.0, 0.0])
    # One strand for each node that is lifted.
    curve = Curve(np.repeat(rest, cells - 1, axis=1), material, wp.float64, 8, framed=framed)
    curve.linearise(curve.rest)
    lifted = np.eye(cells + 1)[:, 2:, None] * np.array([0.0, 0.6, 0.8])
    K = (curve.product(lifted) @ np.array([0.0, 0.6, 0.8]))[2:]
    mass = curve.grid.cells_to_nodes(segment_lengths(curve))[2:, 0]
    return np.asarray(np.sqrt(eigh((K + K.T) / 2, np.diag(mass), eigvals_only=True)[:2]))


@pytest.mark.parametrize("framed", [False, True])
def test_clamped_rod_swings_as_euler_and_bernoulli_say(framed: bool) -> None:
    exact = np.array([1.87510, 4.69409]) ** 2
    errors = np.array([clamped_frequencies(cells, framed) / exact - 1 for cells in (10, 20, 40)])
    print(f"\nclamped rod, framed {framed}, modes 1, 2, 40 cells: errors {percent(errors[-1])}", end="")
    print(f"; orders {listed(orders(errors)[-1])}", end="")
    assert orders(errors).min() > 1.9
    assert np.abs(errors[-1]).max() < 5e-3
