"""From the table of a body to the body."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from warpdeform.body import Body, Pin, Spring, rotate
from warpdeform.growth import Growth
from warpdeform.material import Material
from warpdeform.scene.collect import Collector, look
from warpdeform.scene.keys import Path, closest
from warpdeform.scene.kinds import VaryingTable
from warpdeform.scene.schema import BodyTable, PinTable, RestTable, SectionTable, SpringTable, StrandsTable
from warpdeform.scene.tracks import held_track, quaternion
from warpdeform.section import Section
from warpdeform.selectors import select_nodes
from warpdeform.shape import (
    KINDS,
    SHAPES,
    SHAPES_BY_KIND,
    RestShape,
    block,
    checked_nodes,
    kind_of_shape,
    line,
    read_positions,
    root_grid,
    root_line,
    sheet,
    strands,
)  # fmt: skip
from warpdeform.varying import Varying

MOST_NODES = 4096 * 4096
_STAND_INS: dict[str, RestShape] = {"curve": line((2,)), "surface": sheet((2, 2)), "solid": block((2, 2, 2))}

Held = TypeVar("Held", PinTable, SpringTable)


def make_body(table: BodyTable, index: int, collector: Collector) -> Body | None:
    """Make a body; None, and mistakes in the collector, if something of it was refused."""
    at: Path = ("body", index)
    kind = _kind(table, at, collector)
    material = _material(table, at, collector)
    shape = _shape(table, kind, at, collector)
    arguments: dict[str, Any] = {
        "name": table.name or f"body{index}",
        "position": tuple(table.position),
        "rotation": tuple(float(x) for x in quaternion(table.rotation)),
        "velocity": tuple(table.velocity),
        "drag": table.drag,
        "wind_coefficient": table.wind_coefficient,
        "pressure": table.pressure,
        "self_contact": table.self_contact,
        "contact_thickness": table.contact_thickness,
        "growth": _growth(table.rest, (*at, "rest"), collector) if table.rest else None,
        **look(table, at, collector),
    }
    if table.section is not None:
        arguments["section"] = _section(table.section, (*at, "section"), collector)
    if table.natural is not None:
        arguments["natural"] = _natural(table, kind, at, collector)
    if table.director is not None:
        arguments["director"] = tuple(table.director)
    if shape is not None:
        start = rotate(arguments["rotation"], shape.positions) + np.asarray(table.position)
        arguments["pins"] = _held(table.pins, (*at, "pins"), shape.kind, start, _pin, collector)
        arguments["springs"] = _held(table.springs, (*at, "springs"), shape.kind, start, _spring, collector)
    if material is None and kind != "surface":
        return None
    with collector.at(at, {"growth": (*at, "rest")}):
        body = Body(shape=shape or _STAND_INS[kind], material=material or Material.preset("cotton"), **arguments)
        return body if shape and material else None
    return None


def _kind(table: BodyTable, at: Path, collector: Collector) -> str:
    """The kind of a body: what the table says, or else what its shape is."""
    of_shape = kind_of_shape(table.shape.kind)
    kind = table.kind or of_shape or KINDS[len(table.nodes) - 1]
    if kind not in KINDS:
        better = closest(kind, KINDS) or f"Use one of {', '.join(KINDS)}."
        collector.refuse((*at, "kind"), kind, "is no kind of body", better)
        return of_shape or "surface"
    if of_shape and of_shape != kind:
        problem = f'does not go with the shape "{table.shape.kind}", which is a {of_shape}'
        remedy = f"Use {of_shape}, or one of the shapes {', '.join(SHAPES_BY_KIND[kind])}."
        collector.refuse((*at, "kind"), kind, problem, remedy)
        return of_shape
    return kind


def _material(table: BodyTable, at: Path, collector: Collector) -> Material | None:
    at = (*at, "material")
    given = {
        key: local
        for key, value in table.material.given().items()
        if value is not None and (local := _local(value, (*at, key), collector)) is not None
    }
    preset = given.pop("preset", None)
    with collector.at(at, {"material": at}):
        return Material(**given) if preset is None else replace(Material.preset(preset), **given)
    return None


def _section(table: SectionTable, at: Path, collector: Collector) -> Section | None:
    given = {key: value for key, value in table.model_dump().items() if value is not None}
    with collector.at(at):
        if given.keys() == {"radius"}:
            return Section.circular(**given)
        if given.keys() == {"width", "height"}:
            return Section.rectangular(**given)
        remedy = "Use for example { radius = 0.002 } or { width = 0.01, height = 0.002 }."
        collector.refuse(at, dict(given), "must be a radius, or width and height", remedy)
    return None


def _local(value: Any, at: Path, collector: Collector) -> Any:
    """A number, or what varies in its place, or several of them; None where a file was refused."""
    if isinstance(value, list):
        items = [_local(item, (*at, index), collector) for index, item in enumerate(value)]
        return None if None in items else tuple(items)
    return varying(value, at, collector) if isinstance(value, VaryingTable) else value


def varying(table: VaryingTable, at: Path, collector: Collector) -> Varying | None:
    """What a table says that varies over a body; None, and a mistake in the collector, if it cannot be read."""
    if not collector.sound(at):
        return None
    if (table.image is None) == (table.array is None):
        example = 'Use for example { image = "hem.pgm", range = [0.0002, 0.001] }.'
        collector.refuse(at, None, "needs either an image or an array", example)
        return None
    if table.array is not None and table.range is not None:
        remedy = "Leave it out; the values of an array are taken as they are."
        collector.refuse((*at, "range"), table.range, "goes with an image", remedy)
        return None
    with collector.at(at, {"values": (*at, "image" if table.array is None else "array")}):
        folder = collector.file.parent
        if table.array is not None:
            return Varying.file(folder / table.array)
        return Varying.image(folder / str(table.image), table.range)
    return None


def _growth(table: RestTable, at: Path, collector: Collector) -> Growth | None:
    where = varying(table.where, (*at, "where"), collector) if table.where else None
    if not collector.sound(at):
        return None
    with collector.at(at):
        return Growth(table.times, table.scale, table.curvature, where)
    return None


def _shape(table: BodyTable, kind: str, at: Path, collector: Collector, which: str = "shape") -> RestShape | None:
    """The rest shape, or another one of the same nodes; None also where examples stand in for what was refused."""
    wanted = getattr(table, which)
    nodes: Sequence[int] = _STAND_INS[kind].nodes[: KINDS.index(kind) + 1]
    if collector.sound((*at, "nodes")):
        with collector.at(at):
            # A file may hold many strands.
            nodes = table.nodes if wanted.kind == "file" else checked_nodes(table.nodes, kind)
    given = {key: _tuple(value) for key, value in wanted.model_dump().items() if key != "kind"}
    if "path" in given:
        given["path"], given["kind"] = collector.file.parent / given["path"], kind
    copies: dict[str, Any] = {}
    if table.strands is not None:
        if kind == "curve":
            copies = _strands(table.strands, (*at, "strands"), collector)
        else:
            collector.refuse((*at, "strands"), None, f"do not go with a {kind}", "Leave them out, or use a curve.")
    if math.prod(nodes) * len(copies.get("roots", [0])) > MOST_NODES:
        collector.refuse((*at, "nodes"), table.nodes, f"is more than {MOST_NODES} nodes", "Use for example [64, 64].")
        return None
    with collector.at((*at, which), {"positions": (*at, which), "nodes": (*at, "nodes")}):
        shape = SHAPES[wanted.kind](nodes=nodes, **given)
        if copies:
            with collector.at((*at, "strands"), {"curve": (*at, which), "positions": (*at, which)}):
                shape = strands(shape, **copies)
        return shape if collector.sound((*at, "nodes"), (*at, which), (*at, "strands")) else None
    return None


def _natural(table: BodyTable, kind: str, at: Path, collector: Collector) -> RestShape | None:
    """The shape of a curve whose curvature and twist need no force; None, and a mistake, for what has no such shape."""
    assert table.natural is not None
    of_shape = kind_of_shape(table.natural.kind)
    if kind != "curve":
        problem, remedy = f"does not go with a {kind}", "Leave it out, or use a curve."
        collector.refuse((*at, "natural"), table.natural.kind, problem, remedy)
    elif of_shape not in ("", "curve"):
        problem = f"is a {of_shape}, which does not say how a curve bends"
        remedy = f"Use one of the shapes {', '.join(SHAPES_BY_KIND[kind])}."
        collector.refuse((*at, "natural", "kind"), table.natural.kind, problem, remedy)
    else:
        return _shape(table, kind, at, collector, "natural")
    return None


def _strands(table: StrandsTable, at: Path, collector: Collector) -> dict[str, Any]:
    """Roots and normals of the copies of a curve, as arguments; none where they were refused."""
    if (table.count is None) == (table.roots is None):
        problem, remedy = "needs either count and size, or roots", "Use for example { count = [20], size = [0.2] }."
        collector.refuse(at, None, problem, remedy)
        return {}
    if table.roots is not None:
        roots: Any = table.roots
        if isinstance(roots, str):
            with collector.at(at, {"path": (*at, "roots")}):
                roots = read_positions(collector.file.parent / roots)
        if isinstance(roots, str):
            return {}
        return {"roots": roots, "normals": table.normals}
    count, size = table.count or [], table.size or []
    if len(count) not in (1, 2) or min(count) < 1:
        collector.refuse(
            (*at, "count"), count, "must be one or two whole numbers of at least 1", "Use [20] or [20, 10]."
        )
        return {}
    if len(size) != len(count) or min(size) <= 0.0:
        problem = f"must be {len(count)} positive numbers [m], as many as count"
        collector.refuse((*at, "size"), table.size, problem, f"Use for example {[0.2, 0.1][: len(count)]}.")
        return {}
    roots = root_line(count[0], size[0]) if len(count) == 1 else root_grid(count, size)
    return {"roots": roots, "normals": table.normals}


def _held(
    tables: Sequence[Held],
    at: Path,
    kind: str,
    start: NDArray[np.float64],
    make: Callable[[Held, NDArray[np.float64], Path, Collector], Any],
    collector: Collector,
) -> tuple[Any, ...]:
    """Pins or springs of a body whose nodes start at `start` [m], shape (*nodes, 3)."""
    made = []
    for index, table in enumerate(tables):
        here = (*at, index)
        points = None
        with collector.at(here):
            points = start[tuple(select_nodes(table.nodes, start.shape[:-1], kind).T)]
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
    return Pin(table.nodes, track, table.until)


def _spring(table: SpringTable, held: NDArray[np.float64], at: Path, collector: Collector) -> Spring:
    """Springs to nodes that start at `held` [m], shape (k, 3)."""
    point = (table.point[0], table.point[1], table.point[2]) if table.point else None
    track = None
    with collector.at((*at, "path")):
        track = held_track(table.path, np.array([point]) if point else held) if table.path else None
    return Spring(table.nodes, table.stiffness, point, track, table.until)


def _tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
