"""From a checked scene file to the objects that are simulated; everything they refuse is collected."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from warpdeform.attachment import Attachment, find_all_ties, find_ties
from warpdeform.body import Body
from warpdeform.contact import Contact
from warpdeform.errors import InputError, Mistake
from warpdeform.obstacle import Obstacle
from warpdeform.scene.bodies import make_body
from warpdeform.scene.collect import Collector
from warpdeform.scene.keys import closest
from warpdeform.scene.names import check_solver_names
from warpdeform.scene.obstacles import make_obstacle
from warpdeform.scene.schema import SceneFile
from warpdeform.settings import Settings
from warpdeform.wind import Wind

MOST_FRAMES = 1_000_000
_DOWN = {"Z": (0.0, 0.0, -9.81), "Y": (0.0, -9.81, 0.0)}


@dataclass(frozen=True)
class BuiltScene:
    """A scene that can be simulated.

    Attributes:
        name: Its name.
        file: The file it comes from.
        spec: What the file says, overrides included.
        raw: The same as plain tables.
        bodies: Deformable bodies.
        obstacles: Obstacles.
        contacts: Pairs of bodies that feel each other.
        attachments: What ties bodies to each other.
        wind: Stream of air; None if the air is at rest.
        settings: How it is solved.
        frames: Samples that are written, the initial state included.
    """

    name: str
    file: Path
    spec: SceneFile
    raw: Mapping[str, Any]
    bodies: tuple[Body, ...]
    obstacles: tuple[Obstacle, ...]
    contacts: tuple[Contact, ...]
    attachments: tuple[Attachment, ...]
    wind: Wind | None
    settings: Settings
    frames: int

    @property
    def description(self) -> str:
        """One line that says what it shows."""
        return self.spec.scene.description

    @property
    def duration(self) -> float:
        """Simulated time from the first sample to the last [s]."""
        return (self.frames - 1) / self.settings.fps

    def with_frames(self, frames: int) -> BuiltScene:
        """The same scene with that many samples.

        Raises:
            InputError: Fewer than 1, or too many.
        """
        if not 1 <= frames <= MOST_FRAMES:
            remedy = f"Use 1 to {MOST_FRAMES}; the first is the initial state."
            raise InputError(Mistake("--frames", frames, "is no number of samples", remedy))
        return replace(self, frames=frames)


def build(spec: SceneFile, raw: Mapping[str, Any], collector: Collector) -> BuiltScene:
    """Make everything that a scene file describes.

    Args:
        spec: The checked file.
        raw: Its tables, for the record.
        collector: Where mistakes are collected; it may hold some already.

    Raises:
        InputError: All mistakes of the file.
    """
    settings = _settings(spec, collector)
    frames = _frames(spec, collector)
    bodies = [make_body(table, index, collector) for index, table in enumerate(spec.body)]
    up = spec.scene.up_axis
    obstacles = [make_obstacle(table, index, up, collector) for index, table in enumerate(spec.obstacle)]
    contacts = _contacts(spec, collector)
    wind = None
    if spec.wind:
        with collector.at(("wind",)):
            wind = Wind(**{**spec.wind.model_dump(), "velocity": tuple(spec.wind.velocity)})
    _check_names(spec, collector)
    attachments = _attachments(spec, bodies, collector)
    if collector.mistakes or settings is None:
        raise InputError(collector.mistakes)
    return BuiltScene(
        name=spec.scene.name or collector.file.stem,
        file=collector.file,
        spec=spec,
        raw=raw,
        bodies=tuple(body for body in bodies if body),
        obstacles=tuple(obstacle for obstacle in obstacles if obstacle),
        contacts=contacts,
        attachments=attachments,
        wind=wind,
        settings=settings,
        frames=frames,
    )


def _attachments(spec: SceneFile, bodies: Sequence[Body | None], collector: Collector) -> tuple[Attachment, ...]:
    named = {body.name: body for body in bodies if body}
    made: list[Attachment] = []
    for index, table in enumerate(spec.attachment):
        with collector.at(("attachment", index)):
            attachment = Attachment(**table.model_dump())
            if len(named) == len(spec.body):
                find_ties(attachment, named)
                made.append(attachment)
    if len(made) == len(spec.attachment):
        with collector.at(()):
            find_all_ties(made, named)
    return tuple(made)


def _settings(spec: SceneFile, collector: Collector) -> Settings | None:
    check_solver_names(spec.solver, collector)
    gravity = spec.scene.gravity or _DOWN[spec.scene.up_axis]
    with collector.at(("solver",), {key: ("scene", key) for key in ("fps", "gravity")}):
        return Settings(**spec.solver.model_dump(), fps=spec.scene.fps, gravity=(gravity[0], gravity[1], gravity[2]))
    return None


def _frames(spec: SceneFile, collector: Collector) -> int:
    scene = spec.scene
    if scene.duration < 0:
        collector.refuse(("scene", "duration"), scene.duration, "must not be negative [s]", "Use for example 1.0.")
    if scene.meters_per_unit <= 0:
        remedy = "Use 1.0 for metres, 0.01 for centimetres."
        collector.refuse(("scene", "meters_per_unit"), scene.meters_per_unit, "must be positive [m]", remedy)
    intervals = scene.duration * scene.fps
    if intervals >= MOST_FRAMES:
        problem = f"asks for {intervals:.3g} frames at {scene.fps:g} fps"
        collector.refuse(("scene", "duration"), scene.duration, problem, f"Stay below {MOST_FRAMES} frames.")
        return 1
    return max(round(intervals), 0) + 1


def _contacts(spec: SceneFile, collector: Collector) -> tuple[Contact, ...]:
    """Pairs that are named, each once and of bodies that exist."""
    names = [table.name or f"body{index}" for index, table in enumerate(spec.body)]
    contacts: list[Contact] = []
    for index, table in enumerate(spec.contact):
        at = ("contact", index)
        fitting = [fnmatch.filter(names, name) for name in table.bodies]
        for place, (name, found) in enumerate(zip(table.bodies, fitting, strict=True)):
            if not found:
                remedy = closest(name, names) or f"Use one of {', '.join(names)}."
                collector.refuse((*at, "bodies", place), name, "is not the name of a body", remedy)
        alone = not any("*" in name for name in table.bodies)
        pairs = {frozenset((a, b)): (a, b) for a in fitting[0] for b in fitting[1] if alone or a != b}
        known = {frozenset(contact.bodies) for contact in contacts}
        if known & pairs.keys():
            collector.refuse((*at, "bodies"), table.bodies, "is another table's pair too", "Name every pair once.")
        for bodies in pairs.values():
            with collector.at(at):
                contacts.append(Contact(**{**table.model_dump(), "bodies": bodies}))
    return tuple(contacts)


def _check_names(spec: SceneFile, collector: Collector) -> None:
    """Refuse bodies, and obstacles, that share a name."""
    for which, tables in (("body", spec.body), ("obstacle", spec.obstacle)):
        seen: set[str] = set()
        for index, table in enumerate(tables):
            name = table.name or (f"body{index}" if which == "body" else "")
            if name and name in seen:
                problem = f"is the name of another {which} too"
                collector.refuse((which, index, "name"), name, problem, "Give each a name of its own.")
            seen.add(name)
