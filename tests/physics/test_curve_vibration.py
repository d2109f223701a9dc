"""Frequencies of strings and rods against closed forms that are exact on the grid (design 1.6)."""

import numpy as np
import pytest
import warp as wp
from curves import Curve, segment_lengths

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
