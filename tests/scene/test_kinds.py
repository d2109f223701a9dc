"""Curves, closed surfaces and solids in scene files."""

from pathlib import Path

import numpy as np
import pytest

from warpdeform.body import Body
from warpdeform.errors import InputError
from warpdeform.scene import load_scene
from warpdeform.shape import helix, line, pipe, strands, torus, tube

MADE_OF = "areal_density = 1.0, linear_density = 1.0, density = 1.0, eta = 1.0"


def body_of(folder: Path, text: str, made_of: str = MADE_OF) -> Body:
    (folder / "scene.toml").write_text(f"[[body]]\nmaterial = {{ {made_of} }}\n{text}")
    return load_scene(folder / "scene.toml").bodies[0]


def refusal(folder: Path, text: str) -> str:
    with pytest.raises(InputError) as caught:
        body_of(folder, text)
    assert len(caught.value.mistakes) == 1, caught.value
    return str(caught.value).removeprefix(f"{folder / 'scene.toml'}: ")


def test_a_curve(tmp_path: Path) -> None:
    body = body_of(
        tmp_path,
        'kind = "curve"\nnodes = [41]\nshape = { kind = "helix", radius = 0.02, pitch = 0.01, turns = 10 }\n'
        'pins = ["end:0,2", [40]]\nsprings = [{ nodes = [[20, 0]], stiffness = 1.0 }]',
    )
    assert (body.kind, body.nodes) == ("curve", (41, 1))
    np.testing.assert_array_equal(body.shape.positions, helix((41,), 0.02, 0.01, 10.0).positions)
    assert [pin.nodes for pin in body.pins] == ["end:0,2", [40]]


@pytest.mark.parametrize(
    ("table", "roots", "normals"),
    [
        ("{ count = [3], size = [0.2] }", [[0, 0, 0], [0, 0.1, 0], [0, 0.2, 0]], None),
        (
            "{ count = [2, 2], size = [0.2, 0.1], normals = [[0, 0, 1]] }",
            [[0, 0, 0], [0, 0.1, 0], [0.2, 0, 0], [0.2, 0.1, 0]],
            [[0, 0, 1]],
        ),
        (
            "{ roots = [[0, 0, 0], [1, 2, 3]], normals = [[1, 0, 0], [0, 1, 0]] }",
            [[0, 0, 0], [1, 2, 3]],
            [[1, 0, 0], [0, 1, 0]],
        ),
        ('{ roots = "roots.npy" }', [[0, 0, 1], [0, 0, 2]], None),
    ],
)
def test_strands(tmp_path: Path, table: str, roots: list[list[float]], normals: list[list[float]] | None) -> None:
    np.save(tmp_path / "roots.npy", [[0, 0, 1], [0, 0, 2]])
    body = body_of(tmp_path, f'nodes = [6]\nshape = {{ kind = "line", length = 0.3 }}\nstrands = {table}')
    assert body.kind == "curve"
    np.testing.assert_array_equal(body.shape.positions, strands(line((6,), 0.3), roots, normals).positions)


def test_closed_surfaces_and_solids(tmp_path: Path) -> None:
    around = body_of(tmp_path, 'nodes = [12, 5]\nshape = { kind = "tube", radius = 0.2, length = 0.8 }')
    np.testing.assert_array_equal(around.shape.positions, tube((12, 5), 0.2, 0.8).positions)
    assert around.shape.periodic == (True, False)
    ring = body_of(tmp_path, 'nodes = [12, 9]\nshape = { kind = "torus" }')
    np.testing.assert_array_equal(ring.shape.positions, torus((12, 9)).positions)
    wall = body_of(tmp_path, 'nodes = [12, 3, 2]\nshape = { kind = "pipe", thickness = 0.05 }\npins = ["face:v,0"]')
    np.testing.assert_array_equal(wall.shape.positions, pipe((12, 3, 2), thickness=0.05).positions)
    assert wall.kind == "solid"


def test_files_say_what_closes(tmp_path: Path) -> None:
    np.save(tmp_path / "tube.npy", tube((12, 5)).positions.reshape(-1, 3))
    body = body_of(tmp_path, 'nodes = [12, 5]\nshape = { kind = "file", path = "tube.npy", periodic = [true, false] }')
    assert body.shape.grid.cells == (12, 4)
    np.save(tmp_path / "hair.npy", strands(line((6,)), [[0, 0, 0], [0, 1, 0]]).positions)
    hair = body_of(tmp_path, 'kind = "curve"\nnodes = [6, 2]\nshape = { kind = "file", path = "hair.npy" }')
    assert (hair.kind, hair.nodes) == ("curve", (6, 2))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            'kind = "curve"\nnodes = [12, 5]\nshape = { kind = "tube" }',
            'body.0.kind = "curve": does not go with the shape "tube", which is a surface. '
            "Use surface, or one of the shapes line, helix, ring.",
        ),
        ('nodes = [1]\nshape = { kind = "line" }', "body.0.nodes = [1]: must be at least 2: a strand of one node"),
        ('nodes = [8, 8]\nshape = { kind = "line" }', "body.0.nodes = [8, 8]: must be one whole number"),
        ('nodes = [8, 8]\nshape = { kind = "block" }', "body.0.nodes = [8, 8]: must be three whole numbers"),
        ('nodes = [2, 8]\nshape = { kind = "tube" }', "body.0.nodes = [2, 8]: must be at least 3 along u, which is"),
        ('nodes = [9]\nshape = { kind = "helix" }', "body.0.nodes = [9]: are too few for 5 turns"),
        (
            'nodes = [8, 8]\nshape = { kind = "torus", tube_radius = 0.6 }',
            "body.0.shape.tube_radius = 0.6: must be less than the radius 0.5 m",
        ),
        (
            'nodes = [8]\nshape = { kind = "line" }\nstrands = { count = [3] }',
            "body.0.strands.size: must be 1 positive numbers [m], as many as count",
        ),
        (
            'nodes = [8]\nshape = { kind = "line" }\nstrands = { count = [3], roots = [[0, 0, 0]] }',
            "body.0.strands: needs either count and size, or roots",
        ),
        (
            'nodes = [8]\nshape = { kind = "line" }\nstrands = { count = [3, 0], size = [1.0, 1.0] }',
            "body.0.strands.count = [3, 0]: must be one or two whole numbers of at least 1",
        ),
        (
            'nodes = [8]\nshape = { kind = "line" }\nstrands = { roots = "none.npy" }',
            "body.0.strands.roots",
        ),
        (
            'nodes = [8]\nshape = { kind = "line" }\nstrands = { roots = [[0, 0, 0]], normals = [[0, 0, 0]] }',
            "body.0.strands.normals = [0, 0, 0]: has length zero",
        ),
        (
            'nodes = [8]\nshape = { kind = "line" }\npins = ["corner:0,0"]',
            'body.0.pins.0.nodes = "corner:0,0": is not a node selector of a curve. Use "end:0"',
        ),
        (
            'nodes = [4, 4, 4]\nshape = { kind = "block" }\nsprings = [{ nodes = "edge:u,0", stiffness = 1.0 }]',
            'body.0.springs.0.nodes = "edge:u,0": is not a node selector of a solid. Use "corner:0,0,1"',
        ),
        (
            'nodes = [5, 5]\nshape = { kind = "sheet" }\nnatural = { kind = "line" }',
            'body.0.natural = "line": does not go with a surface. Leave it out, or use a curve.',
        ),
        (
            'nodes = [5]\nshape = { kind = "line" }\nnatural = { kind = "tube" }',
            'body.0.natural.kind = "tube": is a surface, which does not say how a curve bends. '
            "Use one of the shapes line, helix, ring.",
        ),
        (
            'nodes = [4, 5]\nshape = { kind = "sphere" }',
            "body.0.nodes = [4, 5]: must have an even number of at least 6 along u, so that every meridian goes on",
        ),
        (
            'nodes = [8000]\nshape = { kind = "line" }\nstrands = { count = [100, 100], size = [1.0, 1.0] }',
            "body.0.nodes = [8000]: is more than 16777216 nodes",
        ),
    ],
)
def test_mistakes_of_all_kinds(tmp_path: Path, text: str, message: str) -> None:
    assert refusal(tmp_path, text).startswith(message)


def test_rest_shapes_of_curves_and_solids_may_change(tmp_path: Path) -> None:
    np.save(tmp_path / "side.npy", np.linspace(0, 1, 4) * np.ones((4, 4, 4)))
    curve = body_of(
        tmp_path,
        'nodes = [9]\nshape = { kind = "line" }\n'
        "rest = { times = [0, 2], scale = [1, 1.5], curvature = [[0, 0, 0], [5, 0, 2]] }",
        MADE_OF + ", xi = 1.0",
    )
    assert curve.growth is not None
    assert [part.tolist() for part in curve.growth.at(1.0, 1, 3)] == [[1.25], [2.5, 0.0, 1.0]]
    solid = body_of(
        tmp_path,
        'nodes = [4, 4, 4]\nshape = { kind = "block" }\n'
        'rest = { times = [0, 2], scale = [[1, 1, 1], [1, 1, 1.2]], where = { array = "side.npy" } }',
    )
    assert solid.growth is not None
    np.testing.assert_allclose(solid.growth.at(1.0, 3, 0)[0], [1.0, 1.0, 1.1])
    assert solid.growth.shares(solid.shape.grid)[0][0, 0].tolist() == pytest.approx([1 / 6, 0.5, 5 / 6])
