"""What a scene file may say: one model per table, and nothing else (design 4.1).

The models check names and types. Whether a number makes sense is checked where it is used, by the classes that
`warpdeform.scene.build` makes of it; both kinds of mistakes are reported together. Every key carries its unit and an
example, from which messages and the published JSON schema are made.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from annotated_types import Len

from warpdeform.contact import Contact
from warpdeform.scene.kinds import PathTable, VaryingTable, material_table, obstacle_table, shape_table
from warpdeform.scene.table import ROTATION, Selector, Table, Vector, key
from warpdeform.settings import Settings
from warpdeform.wind import Wind

if TYPE_CHECKING:
    MaterialTable: TypeAlias = Any
    ShapeTable: TypeAlias = Any
    AnyObstacleTable: TypeAlias = Any
else:
    MaterialTable, ShapeTable, AnyObstacleTable = material_table(), shape_table(), obstacle_table()

_SELECTOR = 'a selector such as "corner:0,1", "edge:u,0" or "all", or indices such as [[i, j], ...]'


class SceneTable(Table):
    """[scene]: what it is and how long it takes."""

    name: str = key("", "Name in the output; left out: the file's name", example="hanging")
    description: str = key("", "One line that says what the scene shows", example="A sheet hangs by two corners")
    duration: float = key(1.0, "Simulated time; samples = round(duration * fps) + 1", unit="s", example=1.0)
    fps: float = key(Settings.fps, "Frames per second", unit="1/s", example=60)
    gravity: Vector | None = key(
        None, "Acceleration of gravity; left out: 9.81 down", unit="m/s2", example=[0.0, 0.0, -9.81], words="3 numbers"
    )
    up_axis: Literal["Z", "Y"] = key("Z", "The axis that points up, here and in the output", example="Z")
    meters_per_unit: float = key(
        1.0, "Length of a unit of the USD output; the scene itself is in metres", unit="m", example=1.0
    )


class SolverTable(Table):
    """[solver]: how it is solved; see `warpdeform.settings.Settings`."""

    integrator: str = key(Settings.integrator, "Time integrator, told in docs/accuracy.md", example="tr-bdf2")
    substeps: int = key(Settings.substeps, "Steps per frame; dt = 1 / (fps * substeps)", example=1)
    time_step: str = key(
        Settings.time_step, "fixed, auto (as many more as explicit methods need), or adaptive", example="adaptive"
    )
    time_tolerance: float = key(
        Settings.time_tolerance, "Largest error of a step that is adaptive", unit="m", example=1e-4
    )
    newton_iterations: int = key(
        Settings.newton_iterations, "Newton iterations per step; 0 = to newton_tolerance", example=1
    )
    newton_tolerance: float = key(Settings.newton_tolerance, "Largest update, of the node spacing", example=1e-4)
    cg_tolerance: float = key(Settings.cg_tolerance, "Drop of the residual in each linear solve", example=1e-2)
    cg_iterations: int = key(Settings.cg_iterations, "Cap on the iterations of one linear solve", example=200)
    preconditioner: str = key(Settings.preconditioner, "Preconditioner", example="auto")
    precision: str = key(Settings.precision, "float32 or float64", example="float32")
    device: str = key(Settings.device, "Device: auto, cpu, cuda:0, ...", example="auto")
    threads: int = key(Settings.threads, "Threads that share a step on the CPU; 0 = as many as pay", example=2)


class HeldPathTable(PathTable):
    """A motion of held nodes by keyframes, relative to where they start."""

    pivot: Vector | None = key(
        None, "Point that they turn about; left out: their middle", unit="m", example=[0.0, 0.0, 0.0], words="3 numbers"
    )


class PinTable(Table):
    """Nodes that are held or led; `"corner:0,0"` is short for `{ nodes = "corner:0,0" }`."""

    shorthand = "nodes"
    nodes: Selector = key(..., "Which nodes", example="corner:0,0", words=_SELECTOR)
    path: HeldPathTable | None = key(None, "How they are led; left out: they stay where they are", words="a table")
    until: float | None = key(None, "When they are let go; left out: never", unit="s", example=1.0, words="a number")


class SpringTable(Table):
    """Springs of length zero from nodes to a point."""

    nodes: Selector = key(..., "Which nodes", example="corner:0,0", words=_SELECTOR)
    stiffness: float = key(..., "Stiffness of the spring of each node", unit="N/m", example=100.0)
    point: Vector | None = key(
        None, "Where they pull to; left out: each node to its start", unit="m", example=[0, 0, 1], words="3 numbers"
    )
    path: HeldPathTable | None = key(None, "How that point moves; left out: it stays where it is", words="a table")
    until: float | None = key(None, "When they let go; left out: never", unit="s", example=1.0, words="a number")


class StrandsTable(Table):
    """Copies of a curve as one body: a fringe, hair over a rectangle, or roots wherever they are."""

    count: list[int] | None = key(
        None,
        "Copies in a row along y, or over a rectangle in the xy plane, along x and y",
        example=[20, 10],
        words="one or two whole numbers",
    )
    size: list[float] | None = key(
        None, "Length of that row, or of the rectangle's sides", unit="m", example=[0.2, 0.1], words="1 or 2 numbers"
    )
    roots: list[Vector] | str | None = key(
        None,
        "Where the curve's origin lies in each copy; or a .npy file, seen from the scene file",
        unit="m",
        example=[[0, 0, 0], [0, 0.1, 0]],
        words="a list of [x, y, z], or a file",
    )
    normals: list[Vector] | None = key(
        None,
        "Directions that the curve's x axis is turned to: one, or one for each root; left out: it stays",
        example=[[0, 0, 1]],
        words="a list of [x, y, z]",
    )


class SectionTable(Table):
    """The cross-section of a curve: a disc, or a rectangle."""

    radius: float | None = key(None, "Radius of a disc", unit="m", example=0.002, words="a number")
    width: float | None = key(None, "Width of a rectangle, along director 1", unit="m", example=0.01, words="a number")
    height: float | None = key(None, "Height of a rectangle", unit="m", example=0.002, words="a number")


class RestTable(Table):
    """How the rest shape changes: growth, shrinking, curling; linear between keyframes, constant outside them."""

    times: list[float] = key(..., "Times of the keyframes", unit="s", example=[0.0, 2.0])
    scale: list[float] | list[list[float]] | None = key(
        None,
        "Factors of the rest lengths at each of them: one, or one along each axis",
        example=[1.0, 0.7],
        words="a list of numbers, or of lists with one for each axis",
    )
    curvature: list[list[float]] | None = key(
        None,
        "Natural curvatures at each of them, on top of the rest shape's own: of a surface along u and v, of a curve "
        "about directors 1 and 2, and the twist",
        unit="1/m",
        example=[[0.0, 0.0], [5.0, 0.0]],
        words="a list of two or three numbers each",
    )
    where: VaryingTable | None = key(
        None, "Share that a place takes in it, 0 to 1; left out: all", words="a table with an image or array"
    )


class BodyTable(Table):
    """[[body]]: a deformable curve, surface or solid, where it starts and what holds it."""

    name: str = key("", "Name in the output; left out: body0, body1, ...", example="sheet")
    kind: str = key("", "Kind of body: curve, surface or solid; left out: what its shape is", example="surface")
    nodes: Annotated[list[int], Len(1, 3)] = key(
        ...,
        "Nodes along u, of surfaces along u and v, of solids along u, v and w",
        example=[64, 64],
        words="1 to 3 whole numbers",
    )
    shape: ShapeTable = key(..., "Rest shape", example={"kind": "sheet"}, words="a table")
    strands: StrandsTable | None = key(None, "Copies of a curve; left out: one", words="a table")
    section: SectionTable | None = key(
        None, "Cross-section of a curve, for materials in physical units", example={"radius": 0.002}, words="a table"
    )
    natural: ShapeTable | None = key(
        None, "Shape of a curve whose curvature and twist need no force; left out: the rest shape", words="a table"
    )
    director: Vector | None = key(
        None,
        "Where director 1 of a curve's section (its width) points, at the first segment; left out: anywhere",
        example=[0.0, 0.0, 1.0],
        words="3 numbers",
    )
    material: MaterialTable = key(..., "Preset, or numbers", example="cotton", words="a preset or a table of numbers")
    position: Vector = key([0.0, 0.0, 0.0], "Where the rest shape's origin starts", unit="m", example=[0.0, 0.0, 1.0])
    rotation: Vector = key([0.0, 0.0, 0.0], ROTATION, unit="degrees", example=[90.0, 0.0, 0.0])
    velocity: Vector = key([0.0, 0.0, 0.0], "Velocity at the start", unit="m/s", example=[0.0, 0.0, -1.0])
    pins: list[PinTable] = key([], "Held or led nodes", example=["corner:0,0"])
    rest: RestTable | None = key(None, "How the rest shape changes; left out: it stays", words="a table")
    springs: list[SpringTable] = key([], "Springs from nodes to points")
    drag: float = key(0.0, "Damping by mass, beside the material's own", unit="1/s", example=0.1)
    wind_coefficient: float = key(2.0, "c of the wind's force c (n . v) n", unit="kg/(m2 s)", example=2.0)
    pressure: float = key(0.0, "Pressure inside of a tube, torus or sphere over that outside", unit="Pa", example=50.0)
    self_contact: bool = key(False, "Whether the body feels itself; [[contact]] has more words", example=True)
    contact_thickness: float | None = key(
        None,
        "Thickness for contact with bodies; left out: that of the material or the section",
        unit="m",
        example=0.001,
        words="a number",
    )
    color: Vector | None = key(None, "Colour, linear RGB", example=[0.55, 0.13, 0.11], words="3 numbers")
    roughness: float | None = key(None, "Roughness, 0 (mirror) to 1 (matt)", example=0.7, words="a number")


class ContactTable(Table):
    """[[contact]]: two bodies that feel each other, or one that feels itself; see `warpdeform.contact.Contact`."""

    bodies: Annotated[list[str], Len(2, 2)] = key(
        ...,
        "Their names, twice the same for self-contact; a name with * stands for all others that it fits",
        example=["cloth", "rod"],
        words="two names",
    )
    friction: float = key(Contact.friction, "Coefficient of friction", example=0.3)
    gap: float | None = key(
        None,
        "Distance of the skins at rest; left out: 0.002, or a quarter of the node spacing where that is less",
        unit="m",
        example=0.002,
        words="a number",
    )
    design_speed: float | None = key(
        None, "Fastest normal speed to stop; left out: estimated", unit="m/s", example=5.0, words="a number"
    )
    relax: bool = key(
        Contact.relax, "Whether nodes are moved before the start where skins are nearer than the gap", example=True
    )


class AttachmentTable(Table):
    """[[attachment]]: nodes of a body that hang on points of another; see `warpdeform.attachment.Attachment`."""

    body: str = key(..., "Body whose nodes are attached; rigid ones follow the other body", example="curtain")
    nodes: Selector = key(..., "Which of its nodes", example="edge:v,1", words=_SELECTOR)
    to: str = key(..., "Body that they are attached to", example="rod")
    at: Selector | list[list[float]] = key(
        "nearest",
        "Where on it: as many nodes, nodes of an edge, the nearest points, or parameters from 0 to 1",
        example="nearest",
        words='a selector, "nearest", or a list of parameters [[u, v], ...]',
    )
    stiffness: float | None = key(
        None, "Stiffness of each node's tie; left out: rigid", unit="N/m", example=100.0, words="a number"
    )


class WindTable(Table):
    """[wind]: the stream of air; see `warpdeform.wind.Wind`."""

    velocity: Vector = key(..., "Mean velocity", unit="m/s", example=[5.0, 0.0, 0.0])
    gust: float = key(Wind.gust, "Strength of the gusts, as a share of the mean speed", example=0.3)
    gust_length: float = key(Wind.gust_length, "Length of the longest gusts", unit="m", example=2.0)
    gust_period: float = key(Wind.gust_period, "Time in which they renew themselves", unit="s", example=1.0)
    seed: int = key(Wind.seed, "Which gusts: the same seed, the same wind", example=0)


class OutputTable(Table):
    """[output]: what is written when the command line does not say it."""

    file: str = key("", "Where to; left out: the scene's name with .usdc", example="flag.usdc")


class SceneFile(Table):
    """A scene of warpdeform: SI units."""

    scene: SceneTable = key(SceneTable(), "What it is and how long it takes", words="a table [scene]")
    solver: SolverTable = key(SolverTable(), "How it is solved", words="a table [solver]")
    body: Annotated[list[BodyTable], Len(1)] = key(
        ...,
        "Deformable bodies",
        example=[{"nodes": [2, 2], "shape": {"kind": "sheet"}, "material": "cotton"}],
        words="tables [[body]], at least one",
    )
    obstacle: list[AnyObstacleTable] = key([], "Obstacles", words="tables [[obstacle]]")
    contact: list[ContactTable] = key([], "Pairs of bodies that feel each other", words="tables [[contact]]")
    attachment: list[AttachmentTable] = key([], "What ties bodies to each other", words="tables [[attachment]]")
    wind: WindTable | None = key(None, "Stream of air; left out: the air is at rest", words="a table [wind]")
    output: OutputTable = key(OutputTable(), "What is written", words="a table [output]")


def json_schema() -> dict[str, Any]:
    """The JSON schema of a scene file, with the units of its keys."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **SceneFile.model_json_schema()}
