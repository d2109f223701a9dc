"""Tables that follow from registries: materials, rest shapes, obstacles. A new entry there is a new entry here."""

from __future__ import annotations

import inspect
from functools import reduce
from operator import or_
from typing import Annotated, Any, Literal

from annotated_types import Len
from pydantic import Field, create_model

from warpdeform.material import QUANTITIES
from warpdeform.obstacle import SIZES
from warpdeform.scene.table import ROTATION, NumberOrTriple, Pair, Table, Vector, key
from warpdeform.shape import SHAPES


class PresetTable(Table):
    """A preset, or a material in one of its four forms; with a preset, the numbers beside it replace its own."""

    shorthand = "preset"
    preset: str | None = key(None, "Name of a preset", example="cotton", words="the name of a preset")


class VaryingTable(Table):
    """A number that varies over the body: an image, stretched over it, or one value for each node or cell."""

    image: str | None = key(
        None,
        "A grey picture (.pgm), u to the right and v upwards, or an array (.npy, .npz, .csv), u along its first axis; "
        "seen from the scene file",
        example="hem.pgm",
        words="a file",
    )
    range: Pair | None = key(
        None,
        "Values where the image is 0 (black) and 1 (white); left out: the image's own",
        example=[0.0002, 0.001],
        words="2 numbers",
    )
    array: str | None = key(
        None, "An array of one value for each node or cell (.npy, .npz, .csv)", example="thickness.npy", words="a file"
    )


class PathTable(Table):
    """A motion by keyframes, relative to where the thing starts; constant before the first and after the last."""

    times: list[float] = key([0.0], "Times of the keyframes", unit="s", example=[0.0, 1.0])
    displacements: list[Vector] | None = key(
        None,
        "Displacement at each of them",
        unit="m",
        example=[[0, 0, 0], [1, 0, 0]],
        words="one [x, y, z] for each time",
    )
    rotations: list[Vector] | None = key(
        None,
        f"{ROTATION}, at each of them; less than 180 between two",
        unit="degrees",
        example=[[0, 0, 0], [0, 0, 90]],
        words="one [x, y, z] for each time",
    )
    spin: Vector = key(
        [0.0, 0.0, 0.0],
        "Steady angular velocity about axes of the world, from the first keyframe on",
        unit="degrees/s",
        example=[0.0, 0.0, 90.0],
    )


class ObstacleTable(Table):
    """[[obstacle]]: a rigid thing in the way."""

    name: str = key("", "Name in the output; left out: its kind", example="ball")
    position: Vector = key([0.0, 0.0, 0.0], "Where it starts", unit="m", example=[0.0, 0.0, 0.5])
    rotation: Vector = key([0.0, 0.0, 0.0], ROTATION, unit="degrees", example=[90.0, 0.0, 0.0])
    path: PathTable | None = key(None, "How it moves; left out: it stays where it is", words="a table")
    friction: float = key(0.0, "Coulomb coefficient", example=0.4)
    design_speed: float | None = key(
        None, "Normal speed that its field alone stops; left out: estimated", unit="m/s", example=2.0, words="a number"
    )
    gap: float = key(0.002, "Distance at which a body comes to rest on it", unit="m", example=0.002)
    color: Vector | None = key(None, "Colour, linear RGB", example=[0.36, 0.38, 0.41], words="3 numbers")
    roughness: float | None = key(None, "Roughness, 0 (mirror) to 1 (matt)", example=0.6, words="a number")


_NUMBERS: dict[tuple[int, ...], str] = {
    (1,): "a number",
    (1, 2): "a number, or two: along u and v",
    (1, 3): "a number, or three: 11, 22, 12",
    (1, 3, 6): "a number, or three: 11, 22, 12, or six: 11, 22, 33, 12, 13, 23",
}
_VARIES = "; in place of a number a table with an image or an array, where it varies"

_SHAPE_KEYS: dict[str, tuple[str, str]] = {
    "size": ("Lengths along the axes", "m"),
    "radius": ("Radius", "m"),
    "tube_radius": ("Radius of the tube", "m"),
    "angle": ("Opening angle", "degrees"),
    "length": ("Length along the axis", "m"),
    "thickness": ("Thickness of the wall", "m"),
    "pitch": ("Way along the axis in one turn", "m"),
    "turns": ("Turns", ""),
    "path": ("A .npy, .npz or .csv file of positions, seen from the scene file", ""),
    "periodic": ("Axes that close, one true or false for each", ""),
    "poles": ("Whether the start and the end of a surface's open axis close at a pole", ""),
}
"""Description and unit of the arguments of rest shapes; their types and defaults are those of the functions."""

_OBSTACLE_KEYS: dict[str, tuple[Any, Any]] = {
    "radius": (float, key(..., "Radius", unit="m", example=0.3)),
    "height": (float, key(..., "Height along its z axis; a capsule's without its caps", unit="m", example=1.0)),
    "tube_radius": (float, key(..., "Radius of the tube", unit="m", example=0.05)),
    "size": (Vector, key(..., "Full lengths along x, y and z", unit="m", example=[1.0, 1.0, 0.1])),
}

_MORE_OBSTACLE_KEYS: dict[str, dict[str, tuple[Any, Any]]] = {
    "plane": {
        "normal": (
            Vector | None,
            key(None, "Direction out of the ground; left out: up", example=[0.0, 0.0, 1.0], words="3 numbers"),
        )
    },
    "mesh": {
        "mesh": (str, key(..., 'A USD file, seen from the scene file, or an asset of Warp: "bunny"', example="bunny")),
        "prim": (str | None, key(None, "Path of the mesh in it", example="/root/bunny", words="text")),
        "scale": (NumberOrTriple, key(1.0, "Factor of its lengths", example=1.0, words="a number, or three: x, y, z")),
        "thickness": (float, key(0.0, "Thickness of an open mesh; 0 for solids", unit="m", example=0.002)),
    },
}


def _table(name: str, base: type[Table], description: str, keys: dict[str, tuple[Any, Any]]) -> Any:
    return create_model(name, __base__=base, __doc__=description, __module__=__name__, **keys)  # type: ignore[call-overload]


def _kinds(what: str, base: type[Table], tables: dict[str, tuple[str, dict[str, tuple[Any, Any]]]]) -> Any:
    """One of several tables, told apart by `kind`.

    Args:
        what: What they are kinds of.
        base: What they have in common.
        tables: Description and own keys of each kind.
    """
    models = []
    for kind, (description, keys) in tables.items():
        own = {"kind": (Literal[kind], key(..., f"Kind of {what}", example=kind)), **keys}
        name = "".join(word.capitalize() for word in f"{kind}-{what}".split("-"))
        models.append(_table(name, base, description, own))
    return Annotated[reduce(or_, models), Field(discriminator="kind")]


def material_table() -> Any:
    """The table of a material: one key for each of its quantities."""
    keys = {}
    for name, quantity in QUANTITIES.items():
        number: Any = float | VaryingTable if quantity.varies else float
        choices = number
        for count in quantity.counts:
            if count > 1:
                choices = choices | Annotated[list[number], Len(count, count)]
        description = name.replace("_", " ").capitalize() + (_VARIES if quantity.varies else "")
        words = _NUMBERS[quantity.counts]
        keys[name] = (choices | None, key(None, description, words=words, remedy=quantity.remedy))
    return _table("Material", PresetTable, PresetTable.__doc__ or "", keys)


def shape_table() -> Any:
    """The tables of the rest shapes: one for each function of `SHAPES`, one key for each argument.

    Nodes and kind of the body stand beside the shape.
    """
    tables = {}
    for kind, function in SHAPES.items():
        arguments = inspect.signature(function).parameters.values()
        description = (inspect.getdoc(function) or "").split("\n")[0]
        tables[kind] = (description, {a.name: _shape_key(a) for a in arguments if a.name not in ("nodes", "kind")})
    return _kinds("shape", Table, tables)


def _shape_key(argument: inspect.Parameter) -> tuple[Any, Any]:
    """Type and key of an argument of a rest shape."""
    (description, unit), default = _SHAPE_KEYS[argument.name], argument.default
    if default is inspect.Parameter.empty:
        return str, key(..., description, example="rest.npy")
    if isinstance(default, tuple):
        kind = {0: list[bool], 2: Pair, 3: Vector}[len(default)]
        return kind, key(list(default), description, unit=unit, example=list(default) or [True, False])
    return float, key(default, description, unit=unit, example=default)


def obstacle_table() -> Any:
    """The tables of the obstacles: one for each kind of `SIZES`, one key for each size."""
    return _kinds(
        "obstacle",
        ObstacleTable,
        {
            kind: (
                f'[[obstacle]] with kind = "{kind}".',
                {**{size: _OBSTACLE_KEYS[size] for size in sizes}, **_MORE_OBSTACLE_KEYS.get(kind, {})},
            )
            for kind, sizes in SIZES.items()
        },
    )
