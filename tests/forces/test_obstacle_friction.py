"""Friction with stick anchors: holds below the friction angle, slides above it, follows the obstacle."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from field_nodes import LooseNodes, Points

from warpdeform.obstacle import Obstacle
from warpdeform.track import Track, rotation_matrix, rotation_to


def incline_run(ratio: float, friction: float, steps: int, real: Any = wp.float64) -> tuple[Points, Points]:
    """A node released on an incline of tan a = ratio * friction; returns displacement and height over time."""
    angle = np.arctan(ratio * friction)
    normal = np.array([np.sin(angle), 0, np.cos(angle)])
    slope = Obstacle("plane", track=Track.fixed((0, 0, 0), rotation_to(normal)), friction=friction, design_speed=1.0)
    nodes = LooseNodes([0.002 * normal], real=real)
    field = nodes.field(slope)
    way = []
    for _ in range(steps):
        nodes.step(field, 1 / 60, 4)
        way.append(nodes.position[0] - 0.002 * normal)
    return np.linalg.norm(way, axis=1), np.array(way) @ normal


@pytest.mark.parametrize("real", [wp.float32, wp.float64])
def test_an_incline_below_the_friction_angle_holds(real: Any) -> None:
    slid, height = incline_run(0.95, 0.4, 240, real)
    assert slid.max() < 5e-4
    rounding = 1e-12 if real is wp.float64 else 1e-6
    assert np.ptp(slid[120:]) < rounding
    np.testing.assert_allclose(height[-1], 0.0, atol=1e-5)


def test_an_incline_above_the_friction_angle_slides_as_it_must() -> None:
    steps, friction = 240, 0.4
    slid, _ = incline_run(1.05, friction, steps)
    angle = np.arctan(1.05 * friction)
    exact = 0.5 * 9.81 * (np.sin(angle) - friction * np.cos(angle)) * (steps / 60) ** 2
    assert slid[-1] == pytest.approx(exact, rel=0.03)


def test_a_moving_table_takes_a_node_along() -> None:
    """Anchors live in the obstacle's frame: a turning, travelling table carries what sticks to it."""
    track = Track([0.0, 1.0], np.array([[0, 0, 0], [0.3, 0, 0]]), spin=(0, 0, 1.0))
    nodes = LooseNodes([[0.1, 0.05, 0.002]])
    nodes.velocity = np.array([[0.3 - 0.05, 0.1, 0.0]])
    field = nodes.field(Obstacle("plane", track=track, friction=0.8, design_speed=1.0))
    for _ in range(100):
        nodes.step(field, 0.01, 4)
    position, rotation = track.pose(1.0)
    local = rotation_matrix(rotation).T @ (nodes.position[0] - position)
    np.testing.assert_allclose(local, [0.1, 0.05, 0.002], atol=3e-4)


def test_a_rejected_step_leaves_the_anchors_alone() -> None:
    nodes = LooseNodes([[0, 0, 0.002]])
    field = nodes.field(Obstacle("plane", friction=0.5, design_speed=1.0))
    z = np.array([[5e-5, 0, 0.002]])
    forces = []
    for _ in range(2):  # the second try begins where the first did
        nodes.prepare(field, 0.01)
        forces.append(nodes.gradient(field, z)[0, 0])
    assert forces[0] == forces[1] > 0
    nodes.position = z
    nodes.x.assign(nodes.upload(z))
    field.finish(nodes)
    nodes.prepare(field, 0.01)
    assert nodes.gradient(field, z)[0, 0] == pytest.approx(forces[0])  # held by the stored anchor
    nodes.position = np.array([[5e-5, 0, 0.1]])
    nodes.prepare(field, 0.01)
    nodes.prepare(field, 0.01)
    nodes.position = z
    nodes.prepare(field, 0.01)
    assert nodes.gradient(field, z)[0, 0] == 0.0  # beyond the cutoff it was forgotten
    field.reset()
