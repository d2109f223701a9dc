"""The obstacles of one body: energy, gradient and blocks agree, and cost only what the scene needs."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from field_nodes import MASS, LooseNodes, Points
from obstacle_shapes import PRIMITIVES, distance_to, obstacle

from warpdeform.obstacle import Obstacle
from warpdeform.track import Track, rotation_matrix

TILTED = np.array([0.18257419, 0.36514837, 0.54772256, 0.73029674])


def near_surface(of: Obstacle, distances: Points, seed: int = 3) -> Points:
    """Points in the obstacle's own frame at given distances from its surface, where it is smooth; shape (n, 3)."""
    random = np.random.default_rng(seed)
    kind, size = ("box", (0.6, 0.3, 0.2)) if of.kind == "mesh" else (of.kind, of.size_vector)
    points: list[Points] = []
    while len(points) < len(distances):
        wanted = distances[len(points)]
        p = random.uniform(-0.7, 0.7, 3)
        for _ in range(3):
            q = p + 1e-7 * np.concatenate([np.eye(3), -np.eye(3)])
            f = distance_to(kind, size, np.concatenate([[p], q]))
            n = (f[1:4] - f[4:]) / 2e-7
            p = p + (wanted - f[0]) * n
        if abs(f[0] - wanted) < 1e-9 and abs(np.linalg.norm(n) - 1) < 1e-6 and f[1:].max() - f[1:].min() < 2.1e-7:
            points.append(p)
    return np.array(points)


def in_contact(kind: str, friction: float, moving: bool, seed: int = 3, **words: Any) -> tuple[LooseNodes, Any, Points]:
    """Nodes near an obstacle that has been linearised there, and where they stand."""
    both = np.array([TILTED, TILTED])
    turn = Track([0.0, 0.1], np.array([[0, 0, 0], [0.002, 0.001, 0]]), both, spin=(0.02, 0.0, 0.03))
    track = turn if moving else Track.fixed((0.1, -0.2, 0.3), TILTED)
    it = obstacle(kind, track=track, friction=friction, design_speed=1.0, **words)
    eps = it.field_constants((0, 0, -9.81)).range
    local = near_surface(it, eps * np.array([-1.5, -0.6, -0.1, 0.2, 0.9, 2.0, 4.0]), seed)
    dt = 0.1
    position, rotation = track.pose(dt)
    z = position + local @ rotation_matrix(rotation).T
    slid = np.random.default_rng(seed).uniform(-1, 1, z.shape) * np.array([[2e-5], [3e-4]])[np.arange(len(z)) % 2]
    nodes = LooseNodes(z + slid)
    field = nodes.field(it)
    nodes.prepare(field, dt)
    nodes.gradient(field, z)
    return nodes, field, z


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("kind", [*PRIMITIVES, "mesh"])
def test_gradient_is_the_slope_of_the_energy(kind: str, friction: float, moving: bool) -> None:
    nodes, field, z = in_contact(kind, friction, moving)
    nodes.iteration.fill_(3)  # the pressing force stays as it is
    gradient = nodes.gradient(field, z)
    h = 1e-8
    shifted = [nodes.energies(field, z + s * h * e) for e in np.eye(3) for s in (-1, 1)]
    slope = np.stack([(shifted[2 * k + 1] - shifted[2 * k]) / (2 * h) for k in range(3)], axis=1)
    scale = np.linalg.norm(gradient, axis=1, keepdims=True)
    assert (scale > 0).all()
    np.testing.assert_allclose(slope / scale, gradient / scale, atol=1e-6)


@pytest.mark.parametrize("kind", [*PRIMITIVES, "mesh"])
def test_blocks_are_symmetric_and_positive(kind: str) -> None:
    nodes, field, _ = in_contact(kind, 0.5, moving=True)
    values = np.linalg.eigvalsh(nodes.blocks(field))
    assert (values >= -1e-12 * values.max()).all()
    assert (values[:, 0] > 0).all()  # friction holds the tangent plane, pressure the normal


def test_blocks_are_the_slope_of_the_gradient_on_a_plane() -> None:
    nodes, field, z = in_contact("plane", 0.5, moving=False)
    nodes.iteration.fill_(3)
    nodes.gradient(field, z)
    blocks, h = nodes.blocks(field), 1e-9
    shifted = [nodes.gradient(field, z + s * h * e) for e in np.eye(3) for s in (-1, 1)]
    slope = np.stack([(shifted[2 * k + 1] - shifted[2 * k]) / (2 * h) for k in range(3)], axis=2)
    sticking = np.arange(len(z)) % 2 == 0  # beyond the circle the turning of the slip direction is left out
    scale = np.abs(blocks[sticking]).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(slope[sticking] / scale, blocks[sticking] / scale, atol=1e-5)
    difference = blocks[~sticking] - slope[~sticking]
    assert (np.linalg.eigvalsh(difference) > -1e-5 * np.abs(blocks[~sticking]).max()).all()


def test_the_pressing_force_follows_three_iterations_and_freezes() -> None:
    nodes = LooseNodes([[0.0, 0.0, 0.002]])
    field = nodes.field(Obstacle("plane", friction=0.5, design_speed=1.0))
    nodes.prepare(field, 0.01)
    slid, deeper = np.array([[1e-3, 0.0, 0.002]]), np.array([[1e-3, 0.0, 0.0015]])
    for iteration, z, pressed in ((0, slid, slid), (2, deeper, deeper), (3, slid, deeper), (0, slid, slid)):
        nodes.iteration.fill_(iteration)
        friction = nodes.gradient(field, z)[0, 0]
        plain = LooseNodes(pressed)
        pressing = -plain.gradient(plain.field(Obstacle("plane", design_speed=1.0)), pressed)[0, 2]
        assert friction == pytest.approx(0.5 * pressing, rel=1e-9)


def test_a_node_at_the_gap_is_in_balance_with_its_weight() -> None:
    for gap in (0.001, 0.004):
        nodes = LooseNodes([[0.3, 0.2, gap]])
        field = nodes.field(Obstacle("plane", gap=gap, design_speed=3.0))
        np.testing.assert_allclose(nodes.gradient(field, nodes.position), [[0, 0, -9.81 * MASS]], rtol=1e-5)


def test_far_nodes_feel_nothing_and_what_is_outside_the_body_stays_zero() -> None:
    nodes = LooseNodes([[0, 0, 1.0], [0, 0, 0.001]], lane_width=8)
    field = nodes.field(Obstacle("plane", friction=0.5), obstacle("mesh", track=Track.fixed((0, 0, 1.5))))
    nodes.prepare(field, 0.01)
    position, gradient, blocks = nodes.x, nodes.upload(np.zeros((2, 3))), nodes.upload(np.zeros((2, 6)))
    field.linearise(nodes, position)
    field.add_gradient(nodes, position, gradient)
    field.add_node_blocks(nodes, blocks)
    field.add_energy(nodes, position, nodes.partials)
    for array in (gradient.numpy(), blocks.numpy(), nodes.partials.numpy()[None]):
        touched = np.argwhere(np.any(array != 0, axis=0))
        np.testing.assert_array_equal(touched, [[2, 8]])


@pytest.mark.parametrize("real", [wp.float32, wp.float64])
def test_layouts_agree_to_the_bit(real: Any) -> None:
    results = []
    for lane_width in (1, 8, 16):
        nodes = LooseNodes([[0, 0, 0.0005 * k] for k in range(6)], (0.3, 0, -2.0), real=real, lane_width=lane_width)
        field = nodes.field(Obstacle("plane", friction=0.4))
        for _ in range(3):
            nodes.step(field, 0.01, 2)
        results.append(nodes.position)
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(results[0], results[2])


def test_only_what_the_scene_needs() -> None:
    nodes = LooseNodes([[0, 0, 0.1]])
    plain = nodes.field(Obstacle("plane"))
    assert "guard.carry_nodes" not in plain.kernels
    assert "fields.begin_friction" not in plain.kernels
    rough = nodes.field(
        Obstacle("plane", friction=0.1), obstacle("sphere", track=Track.line((0, 0, 0), (1, 0, 0), 0, 1))
    )
    assert {"guard.carry_nodes", "fields.begin_friction"} <= set(rough.kernels)
    assert rough.bytes() > plain.bytes() > 0


def test_a_static_obstacle_writes_nothing() -> None:
    nodes = LooseNodes([[0, 0, 0.1]])
    static, moving = (
        nodes.field(Obstacle("plane", track=track))
        for track in (Track.fixed((0, 0, 0.01)), Track.line((0, 0, 0), (0, 0, 0.1), 0.0, 0.2))
    )
    poses = [wp.clone(field._poses).numpy().tobytes() for field in (static, moving)]
    for field in (static, moving):
        field.prepare(0.1, 0.01, 0.01)
    assert static._poses.numpy().tobytes() == poses[0]
    assert moving._poses.numpy().tobytes() != poses[1]


def test_steps_record_into_a_graph_that_follows_the_poses() -> None:
    nodes = LooseNodes([[0, 0, 0.01], [0, 0, 0.02]])
    track = Track.line((0, 0, 0), (0, 0, 0.1), 0.0, 0.1)
    field = nodes.field(Obstacle("plane", track=track, friction=0.3), obstacle("mesh", track=Track.fixed((0, 0, 5))))
    start, direction = nodes.upload(nodes.position), nodes.upload(np.full((2, 3), -0.1))
    gradient = nodes.upload(np.zeros((2, 3)))

    def step() -> None:
        wp.copy(start, nodes.x)
        field.begin(nodes)
        field.carry(nodes, start)
        field.guard(nodes, start, direction)
        field.linearise(nodes, start)
        field.add_gradient(nodes, start, gradient)
        field.finish(nodes)

    field.prepare(0.0, 0.01, 0.01)
    step()
    with wp.ScopedCapture(device="cpu") as capture:
        step()
    heights = []
    for k in range(1, 4):
        field.prepare(0.01 * k + 0.005, 0.02, 0.02)
        nodes.x.assign(nodes.upload(nodes.position + [0, 0, 0.01 * k]))
        wp.capture_launch(capture.graph)
        heights.append(nodes.download(start)[:, 2])
    lifted = np.array(heights) - np.array([[0.02, 0.03], [0.03, 0.04], [0.04, 0.05]])
    np.testing.assert_allclose(lifted, 0.0, atol=1e-12)
