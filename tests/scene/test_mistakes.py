"""Every way to write a scene wrong has its line: file, key, value and remedy."""

import re
from pathlib import Path

import numpy as np
import pytest

from warpdeform.errors import InputError
from warpdeform.scene import load_scene

GOOD = """
[scene]
name = "test"
duration = 1.0
fps = 60
[solver]
integrator = "bdf2"
[[body]]
name = "sheet"
kind = "surface"
nodes = [5, 4]
shape = { kind = "sheet", size = [1.0, 1.0] }
material = { areal_density = 0.2, membrane_stiffness = 1000.0, poisson_ratio = 0.3, bending_stiffness = 1e-5 }
pins = ["corner:0,0"]
[[obstacle]]
kind = "sphere"
radius = 0.3
"""

CONTACT = '[[contact]]\nbodies = ["sheet", "sheet"]\n'
BODY = 'nodes = [5, 4]\nshape = { kind = "sheet" }\nmaterial = "cotton"\n'

MISTAKES = [
    # (replace, by, key, words of the message)
    ("fps = 60", "fps = 0", "scene.fps", "must be a positive number"),
    ("fps = 60", "fps = nan", "scene.fps", "must be finite"),
    ("fps = 60", 'fps = "60"', "scene.fps", "must be a number [1/s]. Use for example 60"),
    ("fps = 60", "fsp = 60", "scene.fsp", 'Did you mean "fps"?'),
    ("duration = 1.0", "duration = -1.0", "scene.duration", "must not be negative [s]"),
    ("duration = 1.0", "duration = 1e9", "scene.duration", "asks for 6e+10 frames at 60 fps"),
    ("duration = 1.0", "gravity = [0, -9.81]", "scene.gravity", "must be 3 numbers [m/s2]"),
    ("duration = 1.0", "gravity = [0, 0, inf]", "scene.gravity.2", "must be finite"),
    ("duration = 1.0", 'up_axis = "X"', "scene.up_axis", "must be one of Z, Y"),
    ("duration = 1.0", "meters_per_unit = 0", "scene.meters_per_unit", "must be positive [m]"),
    (
        "[[obstacle]]",
        '[[contact]]\nbodies = ["shet", "sheet"]\n[[obstacle]]',
        "contact.0.bodies.0",
        "is not the name of",
    ),
    ("[[obstacle]]", '[[contact]]\nbodies = ["sheet"]\n[[obstacle]]', "contact.0.bodies", "must be two names"),
    ("[[obstacle]]", f"{2 * CONTACT}[[obstacle]]", "contact.1.bodies", "is another table's pair too"),
    ("[[obstacle]]", f"{CONTACT}friction = -0.1\n[[obstacle]]", "contact.0.friction", "must lie between 0 and 10"),
    ("[[obstacle]]", f"{CONTACT}gap = 0\n[[obstacle]]", "contact.0.gap", "must lie between 1e-6 and 1 m"),
    ("[[obstacle]]", f"{CONTACT}design_speed = 0\n[[obstacle]]", "contact.0.design_speed", "0 and 10000 m/s"),
    ("nodes = [5, 4]", "nodes = [5, 4]\ncontact_thickness = -1", "body.0.contact_thickness", "not negative [m]"),
    ("nodes = [5, 4]", 'nodes = [5, 4]\nself_contact = "yes"', "body.0.self_contact", "must be true or false"),
    ("[solver]", "[[solver]]", "solver", "must be a table [solver]"),
    ("[scene]", "title = 1\n[scene]", "title", "is not a key of a scene. Its keys are scene, solver, body"),
    ("[solver]", "[slover]", "slover", 'Did you mean "solver"?'),
    ('integrator = "bdf2"', 'integrator = "bdf3"', "solver.integrator", 'is no integrator. Did you mean "bdf2"?'),
    ('integrator = "bdf2"', 'preconditioner = "magic"', "solver.preconditioner", "Use auto or none or jacobi"),
    ('integrator = "bdf2"', 'precision = "double"', "solver.precision", "Use float32 or float64."),
    ('integrator = "bdf2"', 'time_step = "free"', "solver.time_step", "is no choice of steps. Use auto or fixed or"),
    ('integrator = "bdf2"', "time_tolerance = 0.0", "solver.time_tolerance", "must be positive [m]"),
    ('integrator = "bdf2"', "substeps = 0", "solver.substeps", "must be at least 1"),
    ('integrator = "bdf2"', "substeps = 1.5", "solver.substeps", "must be a whole number"),
    ('integrator = "bdf2"', "newton_iterations = -1", "solver.newton_iterations", "must not be negative"),
    ('integrator = "bdf2"', "newton_tolerance = 0", "solver.newton_tolerance", "must be positive"),
    ('integrator = "bdf2"', "cg_tolerance = 1", "solver.cg_tolerance", "must lie between 0 and 1"),
    ('integrator = "bdf2"', "cg_iterations = 0", "solver.cg_iterations", "must be at least 1"),
    ('integrator = "bdf2"', 'device = "cuda:77"', "solver.device", "is no device of this machine. Use auto or cpu"),
    ('kind = "surface"', 'kind = "solid"', "body.0.kind", 'the shape "sheet", which is a surface. Use surface, or'),
    ('kind = "surface"', 'kind = "sruface"', "body.0.kind", 'is no kind of body. Did you mean "surface"?'),
    ('kind = "surface"', 'kind = "cloth"', "body.0.kind", "is no kind of body. Use one of curve, surface, solid."),
    ("nodes = [5, 4]", "nodes = [1, 5]", "body.0.nodes", "at least 2"),
    ("nodes = [5, 4]", "nodes = [5]", "body.0.nodes", "must be two whole numbers"),
    ("nodes = [5, 4]", "nodes = []", "body.0.nodes", "must be 1 to 3 whole numbers"),
    ("nodes = [5, 4]", "nodes = [5, 4]\nstrands = { count = [3], size = [1] }", "body.0.strands", "with a surface"),
    ("nodes = [5, 4]", "nodes = [5, 4.0]", "body.0.nodes.1", "must be a whole number"),
    ("nodes = [5, 4]", "nodes = [50000, 50000]", "body.0.nodes", "is more than 16777216 nodes"),
    ("nodes = [5, 4]\n", "", "body.0.nodes", "is missing (nodes along u, of surfaces along"),
    ("size = [1.0, 1.0]", "size = [1.0, -1.0]", "body.0.shape.size", "must be positive"),
    ("size = [1.0, 1.0]", "size = 1.0", "body.0.shape.size", "must be 2 numbers [m]"),
    ("size = [1.0, 1.0]", "sizes = [1.0, 1.0]", "body.0.shape.sizes", 'Did you mean "size"?'),
    ('kind = "sheet", size', "size", "body.0.shape.kind", "is missing. Use one of arc, bent-block, block, file, helix"),
    ('kind = "sheet"', 'kind = "shet"', "body.0.shape.kind", 'Did you mean "sheet"?'),
    ('{ kind = "sheet", size = [1.0, 1.0] }', '"sheet"', "body.0.shape", "must be a table"),
    (
        '{ kind = "sheet", size = [1.0, 1.0] }',
        '{ kind = "file", path = "none.npy" }',
        "body.0.shape.path",
        "does not exist",
    ),
    (
        '{ kind = "sheet", size = [1.0, 1.0] }',
        '{ kind = "file", path = "coincident.npy" }',
        "body.0.shape",
        "coincides at nodes [0, 0] and [1, 0]",
    ),
    (
        '{ kind = "sheet", size = [1.0, 1.0] }',
        '{ kind = "file", path = "nonfinite.npy" }',
        "body.0.shape",
        "is not finite at node [2, 3]",
    ),
    ("poisson_ratio = 0.3", "poisson_ratio = 0.5", "body.0.material.poisson_ratio", "must be below 0.5"),
    ("poisson_ratio = 0.3, ", "", "body.0.material.poisson_ratio", "is missing beside membrane_stiffness"),
    ("areal_density = 0.2", "areal_density = 0.0", "body.0.material.areal_density", "Use kg/m2"),
    ("areal_density = 0.2", "areal_density = true", "body.0.material.areal_density", "must be a number. Use kg/m2"),
    ("areal_density = 0.2", "thickness = 0, areal_density = 0.2", "body.0.material.thickness", "Use m,"),
    (
        "areal_density = 0.2",
        'areal_density = { image = "none.pgm" }',
        "body.0.material.areal_density.image",
        "does not exist",
    ),
    (
        "areal_density = 0.2",
        'areal_density = { image = "hem.png" }',
        "body.0.material.areal_density.image",
        'has the unknown suffix ".png". Use a grey picture (.pgm) or an array (.npy, .npz, .csv).',
    ),
    (
        "areal_density = 0.2",
        'areal_density = { image = "millimetres.npy", range = [0.1, 0.3] }',
        "body.0.material.areal_density.image",
        "holds values from 0 to 3, which do not lie within 0 to 1",
    ),
    (
        "areal_density = 0.2",
        'areal_density = { image = "millimetres.npy", range = [0.1] }',
        "body.0.material.areal_density.range",
        "must be 2 numbers",
    ),
    (
        "areal_density = 0.2",
        'areal_density = { image = "hem.pgm", range = [0.0, 0.3] }',
        "body.0.material.areal_density",
        "must be positive, and goes from 0 to 0.3. Use kg/m2",
    ),
    (
        "areal_density = 0.2",
        'areal_density = { array = "small.npy" }',
        "body.0.material.areal_density",
        "has the shape 2 x 2, which is that of neither nodes nor cells. Give 5 x 4 values",
    ),
    (
        "areal_density = 0.2",
        'areal_density = { array = "millimetres.npy", range = [0.0, 1.0] }',
        "body.0.material.areal_density.range",
        "goes with an image",
    ),
    (
        "areal_density = 0.2",
        "areal_density = {}",
        "body.0.material.areal_density",
        "needs either an image or an array. Use for example",
    ),
    (
        "areal_density = 0.2",
        'areal_density = { imagge = "hem.pgm" }',
        "body.0.material.areal_density.imagge",
        'Did you mean "image"?',
    ),
    (
        "membrane_stiffness = 1000.0",
        'membrane_stiffness = [1000.0, { image = "none.npy" }], shear_stiffness = 50',
        "body.0.material.membrane_stiffness.1.image",
        "does not exist",
    ),
    (
        "poisson_ratio = 0.3",
        'poisson_ratio = { image = "hem.pgm" }',
        "body.0.material.poisson_ratio",
        "must be a number",
    ),
    ("membrane_stiffness = 1000.0", "eta = [1.0, 2.0]", "body.0.material.eta", "must be a number, or three"),
    (
        "membrane_stiffness = 1000.0, ",
        "",
        "body.0.material.youngs_modulus",
        "is missing, as are membrane_stiffness, axial_stiffness and eta",
    ),
    ("areal_density = 0.2", 'preset = "silkk"', "body.0.material", "is not a material preset. Use one of rubber"),
    ("areal_density = 0.2", "areal_densty = 0.2", "body.0.material.areal_densty", 'Did you mean "areal_density"?'),
    ('pins = ["corner:0,0"]', 'pins = "corner:0,0"', "body.0.pins", 'Use for example ["corner:0,0"].'),
    ('pins = ["corner:0,0"]', 'pins = ["cornr:0,0"]', "body.0.pins.0.nodes", "is not a node selector"),
    ('pins = ["corner:0,0"]', "pins = [[0, 0]]", "body.0.pins.0.nodes", "or index pairs [[i, j], ...]"),
    ('pins = ["corner:0,0"]', "pins = [0]", "body.0.pins.0", "or indices such as [[i, j], ...]"),
    ('pins = ["corner:0,0"]', 'pins = ["end:0"]', "body.0.pins.0.nodes", "is not a node selector of a surface"),
    ('pins = ["corner:0,0"]', "pins = [[[5, 0]]]", "body.0.pins.0.nodes", "Use indices from [0, 0] to [4, 3]."),
    ('pins = ["corner:0,0"]', "pins = [{ node = 'all' }]", "body.0.pins.0.node", 'Did you mean "nodes"?'),
    (
        'pins = ["corner:0,0"]',
        "pins = [{ nodes = 'all', path = { times = [0, 1], displacements = [[0, 0, 0]] } }]",
        "body.0.pins.0.path.displacements",
        "has 1 entries for 2 times",
    ),
    (
        'pins = ["corner:0,0"]',
        "pins = [{ nodes = 'all', path = { times = [1, 0] } }]",
        "body.0.pins.0.path.times",
        "must increase",
    ),
    (
        'pins = ["corner:0,0"]',
        "pins = [{ nodes = 'all', path = { times = [0, 1], rotations = [[0, 0, 0], [0, 0, 360]] } }]",
        "body.0.pins.0.path.rotations",
        "turns by 180 degrees or more",
    ),
    ('pins = ["corner:0,0"]', "springs = ['all']", "body.0.springs.0", "must be a table"),
    (
        'pins = ["corner:0,0"]',
        "springs = [{ nodes = 'all', stiffness = 0 }]",
        "body.0.springs.0.stiffness",
        "must be positive [N/m]",
    ),
    ('pins = ["corner:0,0"]', "springs = [{ nodes = 'all' }]", "body.0.springs.0.stiffness", "[N/m]"),
    ('pins = ["corner:0,0"]', "drag = -1", "body.0.drag", "not negative"),
    ('pins = ["corner:0,0"]', "wind_coefficient = -1", "body.0.wind_coefficient", "not negative"),
    ('pins = ["corner:0,0"]', "pressure = 5", "body.0.pressure", "needs a surface that encloses something"),
    ('pins = ["corner:0,0"]', "rest = 0.7", "body.0.rest", "must be a table"),
    (
        'pins = ["corner:0,0"]',
        "rest = { scale = [0.7] }",
        "body.0.rest.times",
        "is missing (times of the keyframes [s])",
    ),
    (
        'pins = ["corner:0,0"]',
        "rest = { times = [0, 1], scale = [0.7] }",
        "body.0.rest.scale",
        "has 1 entries for 2 times",
    ),
    (
        'pins = ["corner:0,0"]',
        "rest = { times = [1, 0], scale = [1, 0.7] }",
        "body.0.rest.times",
        "must increase from keyframe to keyframe",
    ),
    (
        'pins = ["corner:0,0"]',
        "rest = { times = [0, 1], scale = [1, 0] }",
        "body.0.rest.scale",
        "must lie between 0.05 and 20",
    ),
    (
        'pins = ["corner:0,0"]',
        "rest = { times = [0], scale = [[1, 1, 1]] }",
        "body.0.rest.scale",
        "has 3 factors for each time, where a surface has 2 axes",
    ),
    (
        'pins = ["corner:0,0"]',
        "rest = { times = [0], curvature = [[1.0]] }",
        "body.0.rest.curvature",
        "has 1 numbers for each time, where a surface has two curvatures and a twist",
    ),
    (
        'pins = ["corner:0,0"]',
        "rest = { times = [0], curvature = [1.0] }",
        "body.0.rest.curvature.0",
        "must be a list of numbers",
    ),
    (
        'pins = ["corner:0,0"]',
        'rest = { times = [0], where = { array = "small.npy" } }',
        "body.0.rest.where",
        "has the shape 2 x 2, which is that of neither nodes nor cells",
    ),
    (
        'pins = ["corner:0,0"]',
        'rest = { times = [0], where = { image = "millimetres.npy" } }',
        "body.0.rest.where",
        "must be shares from 0 to 1",
    ),
    (
        'pins = ["corner:0,0"]',
        'rest = { times = [0], where = { image = "none.pgm" } }',
        "body.0.rest.where.image",
        "does not exist",
    ),
    ('pins = ["corner:0,0"]', "pressure = inf", "body.0.pressure", "must be finite [Pa]. Use for example 50"),
    ('pins = ["corner:0,0"]', "color = [0, 0, -1]", "body.0.color", "must not be negative"),
    ('pins = ["corner:0,0"]', "roughness = 2", "body.0.roughness", "must lie between 0 and 1"),
    ('pins = ["corner:0,0"]', "rotation = [0, 90]", "body.0.rotation", "must be 3 numbers [degrees]"),
    ('pins = ["corner:0,0"]', "velocity = 3", "body.0.velocity", "must be 3 numbers [m/s]"),
    ("[[obstacle]]", f'[[body]]\nname = "sheet"\n{BODY}[[obstacle]]', "body.1.name", "is the name of another body"),
    ("[[body]]", "[body]", "body", "must be tables [[body]], at least one"),
    ('kind = "sphere"', 'kind = "shpere"', "obstacle.0.kind", 'Did you mean "sphere"?'),
    ('kind = "sphere"\n', "", "obstacle.0.kind", "is missing. Use one of"),
    ("radius = 0.3", "radius = 0", "obstacle.0.radius", "must be a positive length [m]"),
    ("radius = 0.3", "", "obstacle.0.radius", "is missing (radius [m])"),
    ("radius = 0.3", "radius = 0.3\nheight = 1", "obstacle.0.height", "is not a key of [obstacle.0]"),
    ("radius = 0.3", "radius = 0.3\nfriction = -0.1", "obstacle.0.friction", "must lie between 0 and 10"),
    ("radius = 0.3", "radius = 0.3\ngap = 0", "obstacle.0.gap", "must lie between 1e-6 and 1 m"),
    ("radius = 0.3", "radius = 0.3\ndesign_speed = 0", "obstacle.0.design_speed", "m/s"),
    ("radius = 0.3", "radius = 0.3\npath = { times = [] }", "obstacle.0.path.times", "is empty"),
    ('kind = "sphere"\nradius = 0.3', 'kind = "plane"\nnormal = [0, 0, 0]', "obstacle.0.normal", "is no direction"),
    ('kind = "sphere"\nradius = 0.3', 'kind = "mesh"\nmesh = "buny"', "obstacle.0.mesh", "There are: bear, bunny"),
    ('kind = "sphere"\nradius = 0.3', 'kind = "mesh"\nmesh = "none.usda"', "obstacle.0.mesh", "does not exist"),
    ('kind = "sphere"\nradius = 0.3', 'kind = "mesh"\nmesh = "broken.usda"', "obstacle.0.mesh", "broken.usda"),
    (
        'kind = "sphere"\nradius = 0.3',
        'kind = "mesh"\nmesh = "open.usda"',
        "obstacle.0.mesh",
        "has no inside",
    ),
    (
        'kind = "sphere"\nradius = 0.3',
        'kind = "mesh"\nmesh = "open.usda"\nprim = "/none"\nthickness = 0.01',
        "obstacle.0.mesh",
        "holds no Mesh prim at /none. Use /Sheet.",
    ),
    ('kind = "sphere"\nradius = 0.3', 'kind = "mesh"\nmesh = "bunny"\nscale = 0', "obstacle.0.scale", "be positive"),
    ("[[obstacle]]", "[wind]\nvelocity = [1, 2]\n[[obstacle]]", "wind.velocity", "must be 3 numbers [m/s]"),
    ("[[obstacle]]", "[wind]\ngust = 0.1\n[[obstacle]]", "wind.velocity", "is missing"),
    ("[[obstacle]]", "[wind]\nvelocity = [1, 2, 3]\ngust = -1\n[[obstacle]]", "wind.gust", "is not a share"),
    ("[[obstacle]]", "[wind]\nvelocity = [1, 2, 3]\nseed = -1\n[[obstacle]]", "wind.seed", "whole number"),
    ("[[obstacle]]", "[output]\nfile = 3\n[[obstacle]]", "output.file", "must be text"),
]


OPEN_MESH = """#usda 1.0
(
    metersPerUnit = 1
    upAxis = "Z"
)
def Mesh "Sheet"
{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scenes")
    u, v = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 4), indexing="ij")
    flat = np.stack([u, v, 0 * u], axis=-1)
    coincident, nonfinite = flat.copy(), flat.copy()
    coincident[1, 0] = coincident[0, 0]
    nonfinite[2, 3, 1] = np.nan
    np.save(folder / "coincident.npy", coincident)
    np.save(folder / "nonfinite.npy", nonfinite)
    np.save(folder / "millimetres.npy", [[0.0, 1.0], [2.0, 3.0]])
    np.save(folder / "small.npy", np.ones((2, 2)))
    (folder / "hem.pgm").write_bytes(b"P2 2 2 255 0 255 0 0")
    (folder / "hem.png").write_bytes(b"\x89PNG")
    (folder / "open.usda").write_text(OPEN_MESH)
    (folder / "broken.usda").write_text("#usda 1.0\ndef Mesh {")
    return folder


def mistakes_of(folder: Path, text: str, **overrides: object) -> InputError:
    path = folder / "scene.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_scene(path, overrides)
    return caught.value


def test_the_scene_that_the_mistakes_are_made_in_is_good(folder: Path) -> None:
    (folder / "scene.toml").write_text(GOOD)
    assert load_scene(folder / "scene.toml").frames == 61


@pytest.mark.parametrize(("good", "bad", "key", "words"), MISTAKES, ids=[f"{m[2]}-{m[1][:30]!r}" for m in MISTAKES])
def test_each_mistake_has_one_clear_line(folder: Path, good: str, bad: str, key: str, words: str) -> None:
    assert good in GOOD
    error = mistakes_of(folder, GOOD.replace(good, bad, 1))
    assert [mistake.key for mistake in error.mistakes] == [key], str(error)
    line = str(error)
    assert "\n" not in line
    assert line.startswith(f"{folder / 'scene.toml'}: {key}")
    assert words in line
    assert re.search(r"[.?] [A-Z].*[.?]$", line), f"no remedy: {line}"


def test_all_mistakes_of_a_file_come_at_once(folder: Path) -> None:
    text = """
[scene]
fps = 0
duration = "1"
[[body]]
nodes = [1, 5]
shape = { kind = "sheet", size = [1.0, -1.0] }
material = { areal_density = 0.2, membrane_stiffness = 1000.0, poisson_ratio = 0.7, thicknes = 1 }
[[body]]
nodes = [4, 4]
shape = { kind = "shet" }
material = "coton"
[[body]]
nodes = [4, 4]
shape = { kind = "sheet" }
material = "silk"
pins = [4, "corner:0,0", { nodes = [[9, 9]], path = { times = [0, 1], displacements = [[0, 0, 0]] } }]
drag = -1
springs = [{ nodes = "all", stiffness = -1 }]
[[obstacle]]
kind = "spere"
[[obstacle]]
kind = "mesh"
mesh = "buny"
gap = -1
[wind]
velocity = [1, 2]
gust = -1
"""
    error = mistakes_of(folder, text, **{"body.7.nodes": 3})
    assert {mistake.key for mistake in error.mistakes} == {
        "body.7.nodes",
        "scene.fps",
        "scene.duration",
        "body.0.nodes",
        "body.0.shape.size",
        "body.0.material.poisson_ratio",
        "body.0.material.thicknes",
        "body.1.shape.kind",
        "body.1.material",
        "body.2.pins.0",
        "body.2.pins.2.nodes",
        "body.2.pins.2.path.displacements",
        "body.2.drag",
        "body.2.springs.0.stiffness",
        "obstacle.0.kind",
        "obstacle.1.mesh",
        "obstacle.1.gap",
        "wind.velocity",
        "wind.gust",
    }


def test_an_empty_file_says_what_is_missing(folder: Path) -> None:
    error = mistakes_of(folder, "")
    assert [mistake.key for mistake in error.mistakes] == ["body"]
    assert "is missing (deformable bodies)" in str(error)


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("[scene\nname = 3", "line 1, column 7", "Expected ']'"),
        ('[scene]\nname = "x', "line 2, column 10", "Unterminated string"),
        ("[scene]\nfps = 1\nfps = 2\n", "line 3", "Cannot overwrite a value"),
        ("[scene]\nfps =\n", "line 2, column 6", "Invalid value"),
    ],
)
def test_a_syntax_error_has_line_and_column(folder: Path, text: str, place: str, words: str) -> None:
    error = mistakes_of(folder, text)
    assert str(error).startswith(f"{folder / 'scene.toml'}: {place}")
    assert words in str(error)
    assert len(error.mistakes) == 1


def test_a_file_that_is_not_text_is_refused(folder: Path) -> None:
    (folder / "latin.toml").write_bytes(b'[scene]\nname = "\xff"\n')
    with pytest.raises(InputError, match="line 2: is not text in UTF-8"):
        load_scene(folder / "latin.toml")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("fla", 'Did you mean "flag"?'),
        ("nothing-like-it", "The scenes are ball_on_solid, balloon, bunny"),
        ("folder/none.toml", "does not exist"),
        (".", "is a folder"),
    ],
)
def test_a_scene_that_is_not_there_is_refused(name: str, words: str) -> None:
    with pytest.raises(InputError, match=re.escape(words)):
        load_scene(name)
