"""Frenet's curvature and torsion of polygons against circles and helices."""

import numpy as np
import pytest

from warpdeform.frenet import frenet


def test_a_ring_has_the_curvature_of_its_circle_and_no_torsion() -> None:
    phase = 2 * np.pi * np.arange(32) / 32
    ring = 0.5 * np.stack([np.cos(phase), np.sin(phase), 0 * phase], -1)
    curvature, torsion = frenet(ring, closed=True)
    # The polygon turns by 2 pi / 32 at every node: 2 tan(phi/2) over the edge.
    np.testing.assert_allclose(curvature, 2 * np.tan(np.pi / 32) / (2 * 0.5 * np.sin(np.pi / 32)), rtol=1e-12)
    assert torsion.shape == (32,)
    np.testing.assert_allclose(torsion, 0.0, atol=1e-12)


@pytest.mark.parametrize("hand", [1.0, -1.0])
def test_a_helix_converges_to_its_curvature_and_torsion(hand: float) -> None:
    radius, pitch, errors = 0.4, 0.15, []
    for count in (41, 81):
        phase = np.linspace(0, 6, count)[:, None] * np.ones((1, 2))
        helix = np.stack([radius * np.cos(phase), hand * radius * np.sin(phase), pitch * phase], -1)
        curvature, torsion = frenet(helix)
        assert (curvature.shape, torsion.shape) == ((count - 2, 2), (count - 3, 2))
        scale = radius**2 + pitch**2
        errors.append([np.abs(curvature - radius / scale).max(), np.abs(torsion - hand * pitch / scale).max()])
    orders = np.log2(np.divide(errors[0], errors[1]))
    assert (np.array(errors[1]) < 2e-3).all()
    assert (orders > 1.9).all()


def test_torsion_of_a_straight_piece_is_undefined() -> None:
    straight = np.stack([np.arange(6.0), np.zeros(6), np.zeros(6)], -1)
    curvature, torsion = frenet(straight)
    np.testing.assert_array_equal(curvature, 0.0)
    assert np.isnan(torsion).all()
