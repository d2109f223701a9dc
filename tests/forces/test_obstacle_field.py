"""The obstacles of one body: exact derivatives, a guard that nothing crosses, carried nodes, friction that holds."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from field_nodes import MASS, LooseNodes, Points
from obstacle_shapes import box_mesh, crossings, distance_to, sheet_mesh, torus_mesh

from warpdeform.obstacle import Obstacle
from warpdeform.track import Track, rotation_matrix, rotation_to

GUARDED_UPDATES = 12
TILTED = np.array([0.18257419, 0.36514837, 0.54772256, 0.73029674])
PRIMITIVES: dict[str, dict[str, Any]] = {
    "plane": {},
    "sphere": {"radius": 0.5},
    "box": {"size": (1.2, 0.6, 0.4)},
    "capsule": {"radius": 0.25, "height": 0.8},
    "cylinder": {"radius": 0.4, "height": 1.0},
    "cone": {"radius": 0.4, "height": 1.2},
    "torus": {"radius": 0.5, "tube_radius": 0.2},
}


def obstacle(kind: str, **words: Any) -> Obstacle:
    if kind == "mesh":
        vertices, faces = box_mesh((1.2, 0.6, 0.4))
        return Obstacle(kind, vertices=vertices, faces=faces, **words)
    return Obstacle(kind, PRIMITIVES[kind], **words)


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


def guard_scene(name: str) -> tuple[Obstacle, float]:
    """An obstacle that is to be guarded, and how deep a node may come: solids give way by a gap, then by eps / 2."""
    if name == "plate":
        return Obstacle("box", {"size": (1.0, 1.0, 0.002)}), 0.0
    if name == "torus mesh":
        vertices, faces = torus_mesh(0.5, 0.2, 24, 12)
        return Obstacle("mesh", vertices=vertices, faces=faces), 0.0
    if name == "shell":
        vertices, faces = sheet_mesh(1.0)
        return Obstacle("mesh", vertices=vertices, faces=faces, thickness=0.004), 0.0
    it = obstacle(name)
    return it, 0.0 if name in ("cone", "mesh") else it.gap + GUARDED_UPDATES * 0.5 * it.gap / 3.0


@pytest.mark.parametrize("real", [wp.float32, wp.float64])
@pytest.mark.parametrize("name", [*PRIMITIVES, "mesh", "plate", "torus mesh", "shell"])
def test_no_guarded_way_crosses(name: str, real: Any) -> None:
    """Random displacements, again and again from where the last ones ended; every way is sampled or intersected."""
    it, depth = guard_scene(name)
    random = np.random.default_rng(11)
    z = random.uniform(-0.8, 0.8, (3000, 3)) * (1, 1, 0.4)
    kind, size = ("box", (0.6, 0.3, 0.2)) if name == "mesh" else (it.kind, it.size_vector)
    if it.kind == "mesh" and name != "mesh":
        kind, size = {"torus mesh": ("torus", (0.5, 0.21, 0)), "shell": ("box", (0.5, 0.5, 0.002))}[name]
    z = z[distance_to(kind, size, z) > 1e-3][:400]
    nodes = LooseNodes(z, real=real)
    field = nodes.field(it)
    free = 0
    for sweep in range(GUARDED_UPDATES):
        d = random.normal(0, 0.3, z.shape) - 0.5 * z * (sweep % 2)
        guarded = nodes.guarded(field, z, d)
        end = z + guarded
        if it.kind == "mesh":
            assert it.vertices is not None
            assert it.faces is not None
            assert crossings(it.vertices, np.asarray(it.faces), z, end) == 0
        if name not in ("torus mesh", "shell"):
            way = z[None] + np.linspace(0, 1, 101)[:, None, None] * guarded
            assert distance_to(kind, size, way.reshape(-1, 3)).min() > -depth - 1e-6
        free += int(np.isclose(guarded, d, rtol=1e-6).all(axis=1).sum())
        z = end
    assert free > 50 * GUARDED_UPDATES  # what does no harm is left as it is
    assert np.abs(z).max() < 8.0


def test_only_the_approaching_component_is_cut() -> None:
    nodes = LooseNodes([[0.0, 0.0, 0.1], [0.0, 0.0, 0.1], [0.0, 0.0, 0.1]])
    plate = Obstacle("box", {"size": (1.0, 1.0, 0.002)}, track=Track.fixed((0, 0, -0.001)))
    field = nodes.field(plate)
    guarded = nodes.guarded(field, nodes.position, np.array([[0.3, 0, -1.0], [0.3, 0, -0.05], [0.0, 0.2, 1.0]]))
    np.testing.assert_allclose(guarded, [[0.3, 0, -0.09], [0.3, 0, -0.05], [0.0, 0.2, 1.0]])


def test_a_solid_gives_way_and_never_holds_a_node_in_place() -> None:
    """Slack of one gap under the surface; at the bottom of it half of eps may still be gone at once."""
    ball = Obstacle("sphere", {"radius": 0.5})
    f = np.array([0.01, -0.001, -0.002, -0.1])
    nodes = LooseNodes(np.stack([0.5 + f, 0 * f, 0 * f], axis=1))
    field = nodes.field(ball)
    eps = field.constants[0].range
    guarded = nodes.guarded(field, nodes.position, np.tile([-1.0, 0.0, 0.0], (4, 1)))
    np.testing.assert_allclose(guarded[:, 0], [-0.0108, -0.0009, -0.5 * eps, -0.5 * eps])


def test_a_corner_of_two_obstacles_holds() -> None:
    walls = [Obstacle("box", {"size": (40, 40, 0.002)}, track=Track.fixed((0, 0, 0), rotation_to(n))) for n in np.eye(3)]
    random = np.random.default_rng(2)
    z = random.uniform(0.002, 0.5, (300, 3))
    nodes = LooseNodes(z)
    field = nodes.field(*walls)
    for _ in range(10):
        d = random.normal(-0.3, 0.4, z.shape)
        z = z + nodes.guarded(field, z, d)
        assert z.min() > 0.001
        assert np.abs(z).max() < 10
    # Obstacles that meet at a sharp angle: what three cuts leave is scaled.
    wedge = [Obstacle("plane", track=Track.fixed((0, 0, 0), rotation_to((s, 0, 0.3)))) for s in (-1.0, 1.0)]
    nodes = LooseNodes([[0.0, 0.0, 0.1]])
    guarded = nodes.guarded(nodes.field(*wedge), nodes.position, np.array([[0.2, 0.1, -1.0]]))
    room = 0.9 * (0.1 * 0.3 / np.hypot(1, 0.3) + 0.002)
    for s in (-1.0, 1.0):
        assert -guarded[0] @ [s, 0, 0.3] / np.hypot(1, 0.3) <= room * (1 + 1e-5)


def test_pinned_nodes_are_neither_clipped_nor_carried() -> None:
    nodes = LooseNodes([[0, 0, 0.01], [0, 0, 0.01]])
    nodes.free = nodes.upload(np.array([[0.0], [1.0]]))
    lift = Obstacle("box", {"size": (1, 1, 0.002)}, track=Track.line((0, 0, -0.01), (0, 0, 0.04), 0.0, 0.01))
    field = nodes.field(lift)
    nodes.prepare(field, 0.01)
    start = nodes.carried(field, nodes.position)
    np.testing.assert_array_equal(start[0], nodes.position[0])
    assert start[1, 2] > 0.041
    d = np.array([[0, 0, 0.1], [0, 0, 0.1]])
    guarded = nodes.guarded(field, nodes.position - [0, 0, 0.02], d)
    np.testing.assert_array_equal(guarded[0], d[0])
    assert guarded[1, 2] < d[1, 2]


@pytest.mark.parametrize("real", [wp.float32, wp.float64])
@pytest.mark.parametrize("kind", ["box", "sphere", "cone", "torus", "mesh"])
def test_carried_nodes_stay_on_their_side_of_a_moving_obstacle(kind: str, real: Any) -> None:
    """Against 2000 poses in between: no node is passed, and those that the obstacle does not reach stay put."""
    track = Track([0.0, 0.1], [[0, 0, -0.5], [0.2, 0.1, 0.5]], np.array([TILTED, TILTED]), spin=(6.0, 3.0, 0.0))
    it = obstacle(kind, track=track)
    shape, size = ("box", (0.6, 0.3, 0.2)) if kind == "mesh" else (kind, it.size_vector)

    def seen(time: float, points: Points) -> Points:
        position, rotation = track.pose(time)
        return (points - position) @ rotation_matrix(rotation)

    x = np.random.default_rng(4).uniform(-0.8, 0.8, (400, 3))
    x = x[distance_to(shape, size, seen(0.0, x)) > 5e-3]
    nodes = LooseNodes(x, real=real)
    field = nodes.field(it)
    dt = 0.1
    nodes.prepare(field, dt)
    carried = nodes.carried(field, x)
    least = np.min([distance_to(shape, size, seen(t, x)) for t in np.linspace(0, dt, 400)], axis=0)
    end = distance_to(shape, size, seen(dt, carried))
    eps = field.constants[0].range
    assert end.min() > 0.3 * eps
    reached, clear = least < 0.3 * eps, least > 0.7 * eps
    assert reached.sum() > 40
    assert clear.sum() > 20
    assert (np.linalg.norm(carried - x, axis=1)[reached] > 0).all()
    assert (end[reached] < 0.55 * eps).mean() > 0.9  # the rest grazes it: too long a way for the steps of the trace
    assert end[reached].max() < it.gap
    if real is wp.float64:
        np.testing.assert_array_equal(carried[clear], x[clear])


def plate_run(speed: float, dt: float, iterations: int, real: Any = wp.float64) -> tuple[LooseNodes, float]:
    """A 2 mm plate driven through loose nodes; returns them and the least distance above it ever."""
    track = Track.line((0, 0, -0.1), (0, 0, 1.9), 0.0, 2.0 / speed)
    nodes = LooseNodes([[0, 0, 0.002 * k] for k in range(-20, 40)], real=real, gravity=(0, 0, 0))
    field = nodes.field(Obstacle("box", {"size": (1, 1, 0.002)}, track=track))
    least = np.inf
    while nodes.time < 1.5 / speed:
        nodes.step(field, dt, iterations)
        least = min(least, float((nodes.position[:, 2] - track.pose(nodes.time)[0][2]).min()) - 0.001)
    return nodes, least


@pytest.mark.parametrize("iterations", [1, 6])
@pytest.mark.parametrize(("speed", "dt"), [(10.0, 1 / 60), (20.0, 1 / 60), (10.0, 1 / 240)])
def test_a_thin_plate_leaves_no_node_behind(speed: float, dt: float, iterations: int) -> None:
    nodes, least = plate_run(speed, dt, iterations)
    assert least > 0.1 * 0.002
    assert (nodes.velocity[:, 2] > 0.9 * speed).all()


def test_a_thin_plate_leaves_no_node_behind_in_float32() -> None:
    assert plate_run(10.0, 1 / 60, 1, wp.float32)[1] > 0.1 * 0.002


@pytest.mark.parametrize(("kind", "dt"), [("plane", 1 / 60), ("sphere", 1 / 60), ("sphere", 1 / 240), ("mesh", 1 / 60)])
def test_nodes_dropped_at_10_m_per_s_do_not_pass(kind: str, dt: float) -> None:
    it = obstacle(kind)
    top = {"plane": 0.0, "sphere": 0.5, "mesh": 0.2}[kind]
    nodes = LooseNodes([[0, 0, top + 0.02 + 0.013 * k] for k in range(20)], (0, 0, -10.0))
    field = nodes.field(it)
    for _ in range(int(1.2 / dt)):
        nodes.step(field, dt, 6)
        assert nodes.position[:, 2].min() > top + 0.1 * it.gap
    np.testing.assert_allclose(nodes.position[:, 2], top + it.gap, rtol=1e-2, atol=0.01 * it.gap)


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
