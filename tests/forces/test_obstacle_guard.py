"""Nothing crosses an obstacle: guarded displacements, carried nodes, impacts."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from field_nodes import LooseNodes, Points
from obstacle_shapes import PRIMITIVES, crossings, distance_to, obstacle, sheet_mesh, torus_mesh

from warpdeform.obstacle import Obstacle
from warpdeform.track import Track, rotation_matrix, rotation_to

GUARDED_UPDATES = 12
TILTED = np.array([0.18257419, 0.36514837, 0.54772256, 0.73029674])


def guard_scene(name: str) -> tuple[Obstacle, float]:
    """An obstacle that is to be guarded, and how deep a node may come: solids always let it approach by half of eps."""
    if name == "plate":
        return Obstacle("box", {"size": (1.0, 1.0, 0.002)}), 0.0
    if name == "torus mesh":
        vertices, faces = torus_mesh(0.5, 0.2, 24, 12)
        return Obstacle("mesh", vertices=vertices, faces=faces), 0.0
    if name == "shell":
        vertices, faces = sheet_mesh(1.0)
        return Obstacle("mesh", vertices=vertices, faces=faces, thickness=0.004), 0.0
    it = obstacle(name)
    return it, 0.0 if name in ("cone", "mesh") else GUARDED_UPDATES * 0.5 * it.gap / 3.0


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


def test_a_solid_lets_no_node_nearer_than_a_part_of_its_gap_and_gives_way_to_those_inside() -> None:
    f = np.array([0.01, 1e-3, 1e-5, -0.001, -0.1])
    nodes = LooseNodes(np.stack([0.5 + f, 0 * f, 0 * f], axis=1))
    field = nodes.field(Obstacle("sphere", {"radius": 0.5}, gap=0.002))
    eps = field.constants[0].range
    guarded = nodes.guarded(field, nodes.position, np.tile([-1.0, 0.0, 0.0], (5, 1)))
    np.testing.assert_allclose(guarded[:, 0], [-0.009, -0.0007, 0.0, -0.5 * eps, -0.5 * eps], rtol=1e-6)


def test_a_corner_of_two_obstacles_holds() -> None:
    walls = [
        Obstacle("box", {"size": (40, 40, 0.002)}, track=Track.fixed((0, 0, 0), rotation_to(n))) for n in np.eye(3)
    ]
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
    room = 0.9 * 0.1 * 0.3 / np.hypot(1, 0.3)
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


def test_an_impact_is_foreseen_and_a_gentle_landing_is_not() -> None:
    nodes = LooseNodes([[0.0, 0.0, 0.1], [1.0, 0.0, 0.0025], [2.0, 0.0, 0.3]])
    field = nodes.field(Obstacle("plane", gap=0.002))
    ways = {0: [0.0, 0.0, -0.2], 1: [0.5, 0.0, -0.001], 2: [0.0, 0.0, -0.2]}
    assert [nodes.foreseen(field, {k: way}) for k, way in ways.items()] == [True, False, False]
