"""What a scene file says is what is built."""

from pathlib import Path

import numpy as np
import pytest

from warpdeform.attachment import Attachment
from warpdeform.coefficients import SurfaceCoefficients
from warpdeform.errors import InputError
from warpdeform.obstacle import SIZES
from warpdeform.scene import BuiltScene, load_scene, scene_description, scene_names
from warpdeform.scene.schema import json_schema
from warpdeform.scene.tracks import quaternion
from warpdeform.shape import SHAPES, sphere
from warpdeform.track import rotation_matrix

HEAD = '[[body]]\nnodes = [5, 4]\nshape = { kind = "sheet", size = [0.4, 0.3] }\nmaterial = "cotton"\n'


def scene_of(tmp_path: Path, text: str, **overrides: object) -> BuiltScene:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    return load_scene(path, overrides)


def test_the_least_scene_has_sensible_defaults(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, HEAD)
    assert scene.name == "mine"
    assert scene.frames == 61
    assert scene.settings.dt == 1 / 60
    assert scene.settings.gravity == (0.0, 0.0, -9.81)
    assert scene.wind is None
    assert scene.bodies[0].name == "body0"
    assert scene.bodies[0].nodes == (5, 4)
    assert scene.bodies[0].material.name == "cotton"


def test_materials_may_vary(tmp_path: Path) -> None:
    (tmp_path / "hem.pgm").write_bytes(b"P2 2 2 255 0 255 0 255")
    np.save(tmp_path / "bending.npy", np.full((5, 4), 2e-5))
    material = '{ preset = "cotton", areal_density = { image = "hem.pgm", range = [0.1, 0.3] }, '
    material += 'bending_stiffness = { array = "bending.npy" }, membrane_stiffness = [1000, { image = "hem.pgm", '
    material += "range = [500, 900] }] }"
    body = scene_of(tmp_path, HEAD.replace('"cotton"', material)).bodies[0]
    assert np.shape(body.density) == (4, 3)
    np.testing.assert_allclose(np.asarray(body.density)[[0, -1]], [[0.1] * 3, [0.3] * 3])
    surface = body.material.surface(body.shape.grid, at="nodes")
    assert isinstance(surface, SurfaceCoefficients)
    assert surface.bending[2, 2, 0, 0] == 2e-5
    np.testing.assert_allclose(surface.membrane_modes[1][[0, -1]], [[500] * 4, [900] * 4])
    (table,) = [table for name, table in json_schema()["$defs"].items() if name == "VaryingTable"]
    assert set(table["properties"]) == {"image", "array", "range"}


def test_files_of_closed_shapes_say_where_their_poles_are(tmp_path: Path) -> None:
    np.save(tmp_path / "ball.npy", sphere((8, 5)).positions)
    text = HEAD.replace("[5, 4]", "[8, 5]").replace(
        '{ kind = "sheet", size = [0.4, 0.3] }',
        '{ kind = "file", path = "ball.npy", periodic = [true, false], poles = [true, true] }',
    )
    assert scene_of(tmp_path, text).bodies[0].shape.poles == (True, True)


def test_rest_shapes_may_change(tmp_path: Path) -> None:
    (tmp_path / "bud.pgm").write_bytes(b"P2 3 3 255 0 0 0 0 255 0 0 0 0")
    rest = "rest = { times = [0, 2], scale = [[1, 1], [1.2, 0.9]], curvature = [[0, 0], [5, 0]], "
    growth = scene_of(tmp_path, HEAD + rest + 'where = { image = "bud.pgm" } }\n').bodies[0].growth
    assert growth is not None
    scale, curvature = growth.at(1.0, 2, 3)
    np.testing.assert_allclose(scale, [1.1, 0.95])
    np.testing.assert_allclose(curvature, [2.5, 0, 0])
    assert growth.where is not None
    assert growth.where.values[1, 1] == 1.0
    assert scene_of(tmp_path, HEAD).bodies[0].growth is None
    even = scene_of(tmp_path, HEAD + "rest = { times = [0, 2], scale = [1, 0.7] }\n").bodies[0].growth
    assert even is not None
    assert even.at(9.0, 2, 3)[0].tolist() == [0.7, 0.7]


def test_samples_follow_from_duration_and_rate_or_are_given(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, HEAD, **{"scene.duration": 0.99, "scene.fps": 24, "solver.substeps": 2})
    assert scene.frames == 25
    assert scene.settings.dt == pytest.approx(1 / 48)
    assert scene.with_frames(7).frames == 7
    assert scene.with_frames(7).duration == pytest.approx(6 / 24)
    with pytest.raises(InputError, match="--frames = 0"):
        scene.with_frames(0)


def test_with_y_up_gravity_planes_and_meshes_follow(tmp_path: Path) -> None:
    text = (
        '[scene]\nup_axis = "Y"\n'
        + HEAD
        + '[[obstacle]]\nkind = "plane"\n[[obstacle]]\nkind = "mesh"\nmesh = "bunny"\n'
    )
    scene = scene_of(tmp_path, text)
    assert scene.settings.gravity == (0.0, -9.81, 0.0)
    normal = rotation_matrix(scene.obstacles[0].track.pose(0.0)[1])[:, 2]
    np.testing.assert_allclose(normal, [0, 1, 0], atol=1e-12)
    vertices = scene.obstacles[1].vertices
    assert vertices is not None
    np.testing.assert_allclose(vertices.min(axis=0), [-0.956, 0.021, -0.542], atol=1e-3)


def test_bunny_of_warp_is_found_turned_and_scaled(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, HEAD + '[[obstacle]]\nkind = "mesh"\nmesh = "bunny"\nscale = [0.5, 0.5, 1.0]\n')
    vertices = scene.obstacles[0].vertices
    assert vertices is not None
    np.testing.assert_allclose(vertices.max(axis=0), [0.3286, 0.2712, 1.6401], atol=1e-3)


def test_rotations_are_about_x_then_y_then_z_in_degrees() -> None:
    turn = rotation_matrix(quaternion([90.0, 0.0, 90.0]))
    np.testing.assert_allclose(turn @ [0, 1, 0], [0, 0, 1], atol=1e-12)  # y to z about x; z stays about z
    np.testing.assert_allclose(turn @ [0, 0, 1], [1, 0, 0], atol=1e-12)  # z to -y about x; -y to x about z
    assert tuple(quaternion([0.0, 0.0, 0.0])) == (0.0, 0.0, 0.0, 1.0)


def test_a_body_starts_where_it_is_put(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, HEAD + "position = [1, 2, 3]\nrotation = [90, 0, 0]\nvelocity = [0, 0, -1]\n")
    placed = scene.bodies[0].placed_positions()
    np.testing.assert_allclose(placed[-1, -1], [1.4, 2.0, 3.3], atol=1e-12)
    assert scene.bodies[0].velocity == (0.0, 0.0, -1.0)


def test_pins_are_led_relative_to_their_start_and_turn_about_their_middle(tmp_path: Path) -> None:
    text = HEAD + (
        'pins = ["corner:0,0", [[1, 1], [2, 2]], { nodes = "edge:u,1", path = { times = [0, 2], '
        "displacements = [[0, 0, 0], [0, 0, 1]], spin = [180, 0, 0] } }]\n"
        'springs = [{ nodes = "corner:1,1", stiffness = 50, point = [0, 0, 1] }]\n'
    )
    body = scene_of(tmp_path, text).bodies[0]
    assert [pin.nodes for pin in body.pins] == ["corner:0,0", [[1, 1], [2, 2]], "edge:u,1"]
    assert body.pins[0].track is None
    track = body.pins[2].track
    assert track is not None
    position, rotation = track.pose(1.0)
    held = body.placed_positions()[-1]
    moved = held @ rotation_matrix(rotation).T + position
    np.testing.assert_allclose(moved, held[::-1] + [0, 0, 0.5], atol=1e-12)  # half a turn swaps the ends
    assert body.springs[0].stiffness == 50
    assert body.springs[0].point == (0.0, 0.0, 1.0)


def test_an_obstacle_moves_relative_to_its_start(tmp_path: Path) -> None:
    text = HEAD + (
        '[[obstacle]]\nkind = "box"\nsize = [1, 1, 0.1]\nposition = [0, 0, 1]\nrotation = [0, 0, 90]\n'
        "path = { times = [0, 1], displacements = [[0, 0, 0], [2, 0, 0]], rotations = [[0, 0, 0], [0, 0, 90]] }\n"
        "friction = 0.4\ngap = 0.004\ndesign_speed = 3\ncolor = [1, 0, 0]\n"
    )
    (box,) = scene_of(tmp_path, text).obstacles
    position, rotation = box.track.pose(1.0)
    np.testing.assert_allclose(position, [2, 0, 1])
    np.testing.assert_allclose(rotation_matrix(rotation) @ [1, 0, 0], [-1, 0, 0], atol=1e-12)
    assert (box.friction, box.gap, box.design_speed, box.color) == (0.4, 0.004, 3.0, (1.0, 0.0, 0.0))


def test_a_preset_takes_numbers_of_its_own_form(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, HEAD, **{"body.0.material.bending_stiffness": 1e-3, "body.0.material.damping": 0.5})
    material = scene.bodies[0].material
    assert (material.bending_stiffness, material.damping, material.areal_density) == (1e-3, 0.5, 0.15)


def test_wind_and_solver_are_passed_on(tmp_path: Path) -> None:
    text = (
        '[solver]\nintegrator = "implicit-euler"\ncg_iterations = 33\n'
        + HEAD
        + "[wind]\nvelocity = [5, 0, 0]\nseed = 4\n"
    )
    scene = scene_of(tmp_path, text)
    assert scene.settings.integrator == "implicit-euler"
    assert scene.settings.cg_iterations == 33
    assert scene.wind is not None
    assert (scene.wind.velocity, scene.wind.seed) == ((5.0, 0.0, 0.0), 4)


def test_a_shape_comes_from_a_file_beside_the_scene(tmp_path: Path) -> None:
    u, v = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 4), indexing="ij")
    np.save(tmp_path / "rest.npy", np.stack([u, v, u * v], axis=-1))
    text = HEAD.replace('kind = "sheet", size = [0.4, 0.3]', 'kind = "file", path = "rest.npy"')
    np.testing.assert_array_equal(scene_of(tmp_path, text).bodies[0].shape.positions[..., 2], u * v)


def test_the_schema_follows_the_registries() -> None:
    schema = json_schema()
    tables = schema["$defs"]
    shapes = {name.removesuffix("Shape").lower() for name in tables if name.endswith("Shape")}
    assert shapes == {kind.replace("-", "") for kind in SHAPES}
    obstacles = {name.removesuffix("Obstacle").lower(): name for name in tables if name.endswith("Obstacle")}
    assert set(obstacles) == set(SIZES)
    for kind, sizes in SIZES.items():
        assert set(sizes) <= set(tables[obstacles[kind]]["required"])
    for table in tables.values():
        assert table.get("type", "object") == "object"
        for key in table.get("properties", {}).values():
            assert key["description"]


@pytest.mark.parametrize("name", scene_names())
def test_packaged_scenes_are_in_order(name: str) -> None:
    scene = load_scene(name)
    assert scene.name == name
    assert scene.description == scene_description(name)
    assert len(scene.description) > 20


def test_the_scene_of_the_design_keeps_its_keys() -> None:
    scene = load_scene("hanging")
    assert scene.frames == 61
    body = scene.bodies[0]
    assert (body.name, body.nodes) == ("sheet", (64, 64))
    assert [pin.nodes for pin in body.pins] == ["corner:0,0", "corner:1,0"]
    assert body.material.areal_density == 0.2
    assert body.material.membrane_stiffness == 1000.0


def test_attachments_tie_bodies(tmp_path: Path) -> None:
    half = """
[[body]]
name = "{name}"
nodes = [4, 4]
shape = {{ kind = "sheet", size = [0.3, 0.3] }}
material = "cotton"
position = [{x}, 0.0, 0.0]
"""
    ties = """
[[attachment]]
body = "right"
nodes = "edge:u,0"
to = "left"
at = "edge:u,1"
{more}
"""
    bodies = half.format(name="left", x=0.0) + half.format(name="right", x=0.3)
    file = tmp_path / "tied.toml"
    file.write_text(bodies + ties.format(more=""))
    scene = load_scene(file)
    assert scene.attachments == (Attachment("right", "edge:u,0", "left", "edge:u,1"),)
    file.write_text(bodies + ties.format(more="stiffness = -1.0") + ties.format(more="").replace("left", "middle"))
    with pytest.raises(InputError) as caught:
        load_scene(file)
    assert [mistake.key for mistake in caught.value.mistakes] == ["attachment.0.stiffness", "attachment.1.to"]
