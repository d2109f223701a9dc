import math
from typing import Any

import numpy as np
import pytest
from obstacle_shapes import box_mesh, sheet_mesh, torus_mesh

from warpdeform.errors import InputError
from warpdeform.kernels.distance import KINDS
from warpdeform.obstacle import SIZES, Obstacle
from warpdeform.track import Track, rotation_to

GRAVITY = (0.0, 0.0, -9.81)
GOOD: dict[str, dict[str, Any]] = {
    "plane": {},
    "sphere": {"radius": 0.3},
    "box": {"size": [0.4, 0.6, 0.2]},
    "capsule": {"radius": 0.1, "height": 0.5},
    "cylinder": {"radius": 0.1, "height": 0.5},
    "cone": {"radius": 0.1, "height": 0.5},
    "torus": {"radius": 0.3, "tube_radius": 0.1},
}


def test_host_and_kernels_know_the_same_kinds() -> None:
    assert tuple(SIZES) == KINDS


def test_sizes_become_radii_and_half_lengths() -> None:
    vectors = {kind: Obstacle(kind, sizes).size_vector for kind, sizes in GOOD.items()}
    assert vectors["box"] == (0.2, 0.3, 0.1)
    assert vectors["capsule"] == (0.1, 0.25, 0.0)
    assert vectors["torus"] == (0.3, 0.1, 0.0)
    assert vectors["sphere"] == (0.3, 0.0, 0.0)


def test_inradius_is_the_depth_of_the_inside() -> None:
    depth = {kind: Obstacle(kind, sizes).inradius for kind, sizes in GOOD.items()}
    expected = {"plane": math.inf, "sphere": 0.3, "box": 0.1, "capsule": 0.1, "cylinder": 0.1, "cone": 0, "torus": 0.1}
    assert depth == pytest.approx(expected)


def test_bounding_balls_hold_the_primitives() -> None:
    radii = {kind: Obstacle(kind, sizes).bounding_radius for kind, sizes in GOOD.items()}
    half, slant = math.sqrt(0.2**2 + 0.3**2 + 0.1**2), math.hypot(0.1, 0.25)
    expected = {"sphere": 0.3, "box": half, "capsule": 0.35, "cylinder": slant, "cone": slant, "torus": 0.4}
    assert radii == pytest.approx({"plane": math.inf, **expected})


@pytest.mark.parametrize(("speed", "eps"), [(1.0, 0.416e-3), (10.0, 0.197e-3)])
def test_field_constants_of_the_design_figures(speed: float, eps: float) -> None:
    constants = Obstacle("plane", design_speed=speed, gap=0.002).field_constants(GRAVITY)
    assert constants.range == pytest.approx(eps, abs=0.5e-6)
    assert constants.cutoff == pytest.approx(0.002 + 7 * constants.range)


@pytest.mark.parametrize("speed", [0.01, 1.0, 30.0])
@pytest.mark.parametrize("gap", [1e-4, 0.002, 0.05])
def test_at_the_gap_the_field_carries_the_weight(speed: float, gap: float) -> None:
    c = Obstacle("plane", design_speed=speed, gap=gap).field_constants(GRAVITY)
    assert c.design_speed**2 / (2 * c.range) * math.exp(-gap / c.range) == pytest.approx(9.81, rel=1e-5)
    assert gap / c.range >= 3.0
    assert c.design_speed >= speed


def test_gravity_counts_with_its_normal_part_on_planes_only() -> None:
    wall = Track.fixed((0, 0, 0), rotation_to((1, 0, 0)))
    assert Obstacle("plane", track=wall).normal_gravity(GRAVITY) == pytest.approx(0.0, abs=1e-12)
    assert Obstacle("plane", track=wall, gap=0.007).field_constants(GRAVITY).range == pytest.approx(0.001)
    slope = Track.fixed((0, 0, 0), rotation_to((1, 0, 1)))
    assert Obstacle("plane", track=slope).normal_gravity(GRAVITY) == pytest.approx(9.81 / math.sqrt(2))
    assert Obstacle("sphere", {"radius": 1.0}, track=wall).normal_gravity(GRAVITY) == pytest.approx(9.81)


def test_design_speed_follows_from_fall_and_motion() -> None:
    sheet = np.array([[[0.0, 0.0, 1.3], [0.1, 0.0, 1.3]]])
    fall = math.sqrt(2 * 9.81 * 1.3)
    assert Obstacle("plane").expected_speed(sheet, 2.0, GRAVITY) == pytest.approx(2.0 + fall)
    ball = Obstacle("sphere", {"radius": 0.3}, track=Track.line((0, 0, 0), (0, 0, 5), 0.0, 1.0))
    far = math.hypot(0.1, 1.3) - 0.3
    assert ball.expected_speed(sheet, 0.0, GRAVITY) == pytest.approx(5.0 + math.sqrt(2 * 9.81 * far))
    assert ball.field_constants(GRAVITY, 10.0).design_speed == pytest.approx(12.0)
    assert ball.field_constants((0, 0, 0), 0.0).design_speed == 1.0


@pytest.mark.parametrize(
    ("words", "key"),
    [
        ({"kind": "ball"}, "kind"),
        ({"kind": "sphere"}, "radius"),
        ({"kind": "sphere", "sizes": {"radius": -1.0}}, "radius"),
        ({"kind": "sphere", "sizes": {"radius": float("nan")}}, "radius"),
        ({"kind": "sphere", "sizes": {"radius": "big"}}, "radius"),
        ({"kind": "sphere", "sizes": {"radius": 1.0, "height": 1.0}}, "height"),
        ({"kind": "box", "sizes": {"size": [1.0, 1.0]}}, "size"),
        ({"kind": "box", "sizes": {"size": [1.0, 0.0, 1.0]}}, "size"),
        ({"kind": "torus", "sizes": {"radius": 0.1, "tube_radius": 0.2}}, "tube_radius"),
        ({"kind": "plane", "friction": -0.1}, "friction"),
        ({"kind": "plane", "friction": float("inf")}, "friction"),
        ({"kind": "plane", "gap": 0.0}, "gap"),
        ({"kind": "plane", "design_speed": 0.0}, "design_speed"),
        ({"kind": "plane", "thickness": 0.01}, "thickness"),
        ({"kind": "plane", "vertices": np.zeros((3, 3))}, "vertices"),
        ({"kind": "mesh"}, "mesh"),
        ({"kind": "mesh", "vertices": np.zeros((3, 3)), "faces": [[0, 1, 3]]}, "mesh"),
        ({"kind": "mesh", "vertices": np.full((3, 3), np.nan), "faces": [[0, 1, 2]]}, "mesh"),
    ],
)
def test_refused_obstacles_name_the_key(words: dict[str, Any], key: str) -> None:
    with pytest.raises(InputError) as refused:
        Obstacle(**words)
    assert [mistake.key for mistake in refused.value.mistakes] == [key]


def test_all_mistakes_are_reported_at_once() -> None:
    with pytest.raises(InputError) as refused:
        Obstacle("capsule", {"radius": 0.0}, friction=-1.0, gap=2.0)
    assert [mistake.key for mistake in refused.value.mistakes] == ["radius", "height", "friction", "gap"]


def test_a_mesh_without_inside_is_refused_unless_it_is_a_shell() -> None:
    vertices, faces = box_mesh((1, 1, 1))
    fin = np.concatenate([vertices, [[0, 0, 2]]]), np.concatenate([faces, [[0, 1, 8]]])
    flipped = faces.copy()
    flipped[3] = flipped[3, ::-1]
    bad = {"open": sheet_mesh(1.0), "manifold": fin, "wound": (vertices, flipped), "one": (vertices, faces[1:])}
    for word, (v, f) in bad.items():
        with pytest.raises(InputError, match=rf"{word}.*no inside.*thickness"):
            Obstacle("mesh", vertices=v, faces=f)
        assert Obstacle("mesh", vertices=v, faces=f, thickness=0.004).thickness == 0.004


def test_a_closed_mesh_is_taken_with_its_outside_out() -> None:
    vertices, faces = torus_mesh(0.3, 0.1)
    for triangles in (faces, faces[:, ::-1]):
        taken = Obstacle("mesh", vertices=vertices, faces=triangles)
        assert taken.vertices is not None
        assert taken.faces is not None
        a, b, c = (taken.vertices[taken.faces[:, k]] for k in range(3))
        volume = np.sum(np.cross(a, b) * c) / 6
        assert volume == pytest.approx(2 * np.pi**2 * 0.3 * 0.1**2, rel=0.05)
        assert taken.bounding_radius == pytest.approx(0.4)


def test_vertices_split_at_seams_are_welded() -> None:
    vertices, faces = box_mesh((1, 1, 1))
    taken = Obstacle("mesh", vertices=vertices[faces].reshape(-1, 3), faces=np.arange(36).reshape(-1, 3))
    assert taken.vertices is not None
    assert len(taken.vertices) == 8
