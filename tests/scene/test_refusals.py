"""What bodies of all kinds cannot be, said once, with file, key, value and remedy."""

from pathlib import Path

import numpy as np
import pytest

from warpdeform.errors import InputError
from warpdeform.scene import load_scene

SHELL = "material = { density = 1000.0, youngs_modulus = 1e6, poisson_ratio = 0.3, thickness = 0.01 }\n"
ROD = 'nodes = [9]\nshape = { kind = "line" }\nmaterial = { linear_density = 1.0, axial_stiffness = 50.0 }\n'
SHEET = 'nodes = [5, 5]\nshape = { kind = "sheet" }\n'
TIE = f'name = "a"\n{SHEET}{SHELL}[[body]]\nname = "rod"\n{ROD}[[attachment]]\nbody = "a"\nstiffness = 1.0\n'
BLOCK = 'nodes = [4, 4, 4]\nshape = { kind = "block" }\nmaterial = { density = 1.0, youngs_modulus = 1.0, '
FILE = 'nodes = [12, 6]\nshape = { kind = "file", path = "rest.npy", periodic = [true, false]'

AROUND, ALONG = np.meshgrid(2 * np.pi * np.arange(12) / 12, np.arange(6) / 5.0, indexing="ij")
EIGHT = np.stack([np.sin(AROUND), np.sin(AROUND) * np.cos(AROUND), ALONG], axis=-1)
"""A tube whose section is an eight."""
NEEDLE = np.stack([0 * AROUND, 0 * AROUND, ALONG], axis=-1)


def pgm(values: bytes, width: int, height: int) -> bytes:
    return f"P5 {width} {height} 255\n".encode() + values


@pytest.mark.parametrize(
    ("text", "message", "remedy"),
    [
        (TIE + 'nodes = "edge:u,0"\nto = "rood"', 'attachment.0.to = "rood": is no body of the scene', "a, rod"),
        (TIE + 'nodes = [[9, 9]]\nto = "rod"', "attachment.0.nodes = [9, 9]: lies outside the grid", "to [4, 4]"),
        (TIE + 'nodes = [[0, 0]]\nat = [[20, 0]]\nto = "rod"', "attachment.0.nodes = [20, 0]: lies", "to [8, 0]"),
        (TIE + 'nodes = [[0, 0]]\nat = [[1.5]]\nto = "rod"', "attachment.0.at = [[1.5]]: must be 2 param", "[[0.5"),
        ('nodes = [5, 2]\nshape = { kind = "torus" }\n' + SHELL, "body.0.nodes = [5, 2]: must be at least 3 al", "[64"),
        (FILE + ", poles = [true, true] }\n" + SHELL, "body.0.shape = [0.0, 0.0, 0.0]: does not close", "leave poles"),
        (FILE + " }\n" + SHELL, "body.0.shape = [0.0, 0.0, 0.8]: touches itself: nodes [0, 4] and [6, 4]", "apart"),
        (ROD + 'natural = { kind = "helix", turns = 5.0 }', "body.0.nodes = [9]: are too few for 5 turns", "[61]"),
        (ROD + 'natural = { kind = "file", path = "line.npy" }', 'body.0.natural.path = "line.npy": holds', "9 points"),
        (SHEET + SHELL + "rest = { times = [0.0], scale = [[1.0, 1.0, 1.0]] }", "body.0.rest.scale = [[1.0", "or 2"),
        (SHEET + SHELL + "rest = { times = [0.0], curvature = [[1.0]] }", "body.0.rest.curvature = [[1.0]]", "three"),
        (ROD + "rest = { times = [0.0], scale = [[1.0, 1.0]] }", "body.0.rest.scale = [[1.0", "one factor for each"),
        (ROD + "rest = { times = [0.0], curvature = [[1.0]] }", "body.0.rest.curvature = [[1.0]]", "three"),
        (
            BLOCK + "poisson_ratio = 0.3 }\nrest = { times = [0.0], curvature = [[1.0, 0.0]] }",
            "body.0.rest.curvature = [[1.0, 0.0]]: has 2 numbers for each time, where a solid has no",
            "Leave it out",
        ),
        (
            SHEET + SHELL.replace("0.01", '{ array = "wide.npy" }'),
            'body.0.material.thickness = "wide.npy": has',
            "5 x 5",
        ),
        (SHEET + SHELL.replace("0.01", '{ image = "short.pgm" }'), "body.0.material.thickness.image", ".pgm"),
        (
            SHEET + SHELL.replace("0.01", '{ image = "grey.pgm", range = [-0.1, 0.01] }'),
            'body.0.material.thickness = "grey.pgm": must be positive, and goes from -0.1 to',
            "Use m",
        ),
        (BLOCK + "poisson_ratio = 0.5 }", "body.0.material.poisson_ratio = 0.5: must be below 0.5", "0.49"),
        (ROD.replace("[9]", "[1]"), "body.0.nodes = [1]: must be at least 2: a strand of one node has no", "[32]"),
    ],
)
def test_one_mistake_with_its_place_and_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, message: str, remedy: str
) -> None:
    monkeypatch.chdir(tmp_path)
    np.save(tmp_path / "rest.npy", EIGHT)
    np.save(tmp_path / "line.npy", np.arange(15.0).reshape(5, 3))
    np.save(tmp_path / "wide.npy", np.ones((7, 6)))
    (tmp_path / "short.pgm").write_bytes(pgm(b"abc", 3, 3))
    (tmp_path / "grey.pgm").write_bytes(pgm(bytes(range(9)), 3, 3))
    (tmp_path / "scene.toml").write_text("[[body]]\n" + text)
    with pytest.raises(InputError) as caught:
        load_scene("scene.toml")
    said = str(caught.value)
    assert len(caught.value.mistakes) == 1, said
    assert said.startswith(f"scene.toml: {message}")
    assert remedy in caught.value.mistakes[0].remedy


def test_a_needle_is_no_closed_surface(tmp_path: Path) -> None:
    np.save(tmp_path / "rest.npy", NEEDLE)
    (tmp_path / "scene.toml").write_text(f"[[body]]\n{FILE}, poles = [true, true] }}\n{SHELL}")
    with pytest.raises(InputError, match="no edge along u has a length at the start of v"):
        load_scene(tmp_path / "scene.toml")
