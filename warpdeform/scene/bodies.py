"""From the table of a body to the body."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from warpdeform.body import Body, Pin, Spring, rotate, select_nodes
from warpdeform.material import Material
from warpdeform.scene.collect import Collector, look
from warpdeform.scene.keys import Path
from warpdeform.scene.schema import BodyTable, PinTable, SpringTable
from warpdeform.scene.tracks import held_track, quaternion
from warpdeform.shape import SHAPES, RestShape, checked_nodes, sheet

MOST_NODES = 4096 * 4096
_LATER_KINDS = ("curve", "solid")

Held = TypeVar("Held", PinTable, SpringTable)


def make_body(table: BodyTable, index: int, collector: Collector) -> Body | None:
    """Make a body; None, and mistakes in the collector, if something of it was refused."""
    at: Path = ("body", index)
    if table.kind in _LATER_KINDS:
        problem = "cannot be simulated yet: this version knows surfaces only"
        collector.refuse((*at, "kind"), table.kind, problem, 'Use "surface".')
    elif table.kind != "surface":
        collector.refuse((*at, "kind"), table.kind, "is no kind of body", 'Use "surface".')
    material = _material(table, at, collector)
    shape = _shape(table, at, collector)
    arguments: dict[str, Any] = {
        "name": table.name or f"body{index}",
        "position": tuple(table.position),
        "rotation": tuple(float(x) for x in quaternion(table.rotation)),
        "velocity": tuple(table.velocity),
        "drag": table.drag,
        "wind_coefficient": table.wind_coefficient,
        **look(table, at, collector),
    }
    if shape is not None:
        start = rotate(arguments["rotation"], shape.positions) + np.asarray(table.position)
        arguments["pins"] = _held(table.pins, (*at, "pins"), start, _pin, collector)
        arguments["springs"] = _held(table.springs, (*at, "springs"), start, _spring, collector)
    with collector.at(at):
        body = Body(shape=shape or sheet((2, 2)), material=material or Material.preset("cotton"), **arguments)
        return body if shape and material else None
    return None


def _material(table: BodyTable, at: Path, collector: Collector) -> Material | None:
    at = (*at, "material")
    given = {key: _tuple(value) for key, value in table.material.given().items() if value is not None}
    preset = given.pop("preset", None)
    with collector.at(at, {"material": at}):
        return Material(**given) if preset is None else replace(Material.preset(preset), **given)
    return None


def _shape(table: BodyTable, at: Path, collector: Collector) -> RestShape | None:
    """The rest shape; None also where examples stand in for what was refused."""
    nodes = (2, 2)
    with collector.at(at):
        nodes = checked_nodes(table.nodes)
    if nodes[0] * nodes[1] > MOST_NODES:
        collector.refuse((*at, "nodes"), table.nodes, f"is more than {MOST_NODES} nodes", "Use for example [64, 64].")
        nodes = (2, 2)
    given = {key: _tuple(value) for key, value in table.shape.model_dump().items() if key != "kind"}
    if "path" in given:
        given["path"] = collector.file.parent / given["path"]
    with collector.at((*at, "shape"), {"positions": (*at, "shape")}):
        shape = SHAPES[table.shape.kind](nodes=nodes, **given)
        return shape if collector.sound((*at, "nodes"), (*at, "shape")) else None
    return None


def _held(
    tables: Sequence[Held],
    at: Path,
    start: NDArray[np.float64],
    make: Callable[[Held, NDArray[np.float64], Path, Collector], Any],
    collector: Collector,
) -> tuple[Any, ...]:
    """Pins or springs of a body whose nodes start at `start` [m], shape (nu, nv, 3)."""
    made = []
    for index, table in enumerate(tables):
        here = (*at, index)
        points = None
        with collector.at(here):
            nodes = select_nodes(table.nodes, (start.shape[0], start.shape[1]))
            points = start[nodes[:, 0], nodes[:, 1]]
        with collector.at(here):
            held = make(table, start.reshape(-1, 3) if points is None else points, here, collector)
            if points is not None:
                made.append(held)
    return tuple(made)


def _pin(table: PinTable, held: NDArray[np.float64], at: Path, collector: Collector) -> Pin:
    """Pin nodes that start at `held` [m], shape (k, 3)."""
    track = None
    with collector.at((*at, "path")):
        track = held_track(table.path, held) if table.path else None
    return Pin(table.nodes, track)


def _spring(table: SpringTable, held: NDArray[np.float64], at: Path, collector: Collector) -> Spring:
    """Springs to nodes that start at `held` [m], shape (k, 3)."""
    point = (table.point[0], table.point[1], table.point[2]) if table.point else None
    track = None
    with collector.at((*at, "path")):
        track = held_track(table.path, np.array([point]) if point else held) if table.path else None
    return Spring(table.nodes, table.stiffness, point, track)


def _tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
