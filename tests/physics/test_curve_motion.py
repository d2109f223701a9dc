"""Curves that move: momentum and length."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from curves import RUBBER, Curve, crumpled, ring, segment_lengths
from physics.curve_statics import STATIC, Strands

from warpdeform.material import Material
from warpdeform.section import Section
from warpdeform.settings import Settings

REAL_TIME = Settings(precision="float32", newton_iterations=2, device="cpu")


def test_free_flight_keeps_momentum() -> None:
    """A crumpled elastic ring that is let go: positions move, their centre does not."""
    curve = Curve(ring(16, 2), RUBBER, lane_width=8, section=Section.rectangular(0.05, 0.02), closed=True)
    mass = np.full(curve.nodes, 0.01)
    precise = replace(STATIC, newton_tolerance=1e-10, cg_tolerance=1e-10)
    start = crumpled(curve.rest)
    strands = Strands(
        curve, mass, np.zeros(curve.nodes, dtype=bool), gravity=(0, 0, 0), settings=precise, positions=start
    )
    for _ in range(20):
        strands.step(1e-3)
    drift = np.abs((strands.positions - start).mean(axis=0)).max()
    moved = np.abs(strands.positions - start).max()
    print(f"\ncrumpled rings: nodes move by {moved:.3g} m, centres drift by {drift:.1e} m", end="")
    assert moved > 0.01
    assert drift < 1e-9 * moved


@pytest.mark.parametrize("framed", [False, True])
def test_nearly_inextensible_strands_keep_their_length(framed: bool) -> None:
    """Horizontal strands, 2600 times as stiff as they are heavy, clamped at one end: two Newton iterations a frame."""
    rest = np.linspace(0, 0.3, 32)[:, None, None] * np.array([1.0, 0.0, 0.0]) + np.zeros((1, 5, 1))
    material = Material(density=1300.0, youngs_modulus=1e7, poisson_ratio=0.3)
    section = Section.circular(1e-4)
    curve = Curve(rest, material, wp.float32, 16, section=section, framed=framed)
    pinned = np.zeros(curve.nodes, dtype=bool)
    pinned[:2] = True
    if framed:
        held = np.zeros((31, 5), dtype=bool)
        held[0] = True
        curve.force.frames.hold(held)
    mass = material.curve(section).density * curve.grid.cells_to_nodes(segment_lengths(curve))
    strands = Strands(curve, mass, pinned, settings=REAL_TIME)
    stretch, lowest = [], []
    for _ in range(24):
        assert strands.step(1 / 60).cg_iterations <= 4
        stretch.append(np.linalg.norm(np.diff(strands.positions, axis=0), axis=-1) / segment_lengths(curve))
        lowest.append(strands.positions[..., 2].min())
    print(f"\nfalling strands: stretched by at most {np.max(stretch) - 1:.2%} in 24 frames", end="")
    assert np.max(stretch) < 1.02
    # They have fallen all the way: their free length is 0.295 m, and they pass the lowest point bent.
    assert min(lowest) < -0.27
