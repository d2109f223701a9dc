"""Scene files: found by name or path, read, changed by overrides, checked and built."""

from __future__ import annotations

import copy
import re
import tomllib
from collections.abc import Iterable, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from warpdeform.errors import InputError, Mistake
from warpdeform.scene.build import BuiltScene, build
from warpdeform.scene.collect import Collector
from warpdeform.scene.keys import Path as KeyPath
from warpdeform.scene.keys import closest
from warpdeform.scene.overrides import Override, apply_overrides
from warpdeform.scene.validate import validate

_PLACE = re.compile(r"\s*\(at (?:line (?P<line>\d+), column (?P<column>\d+)|end of document)\)$")


def scene_folder() -> Path:
    """The folder of the packaged scenes."""
    return Path(str(files("warpdeform").joinpath("scenes")))


def scene_names() -> list[str]:
    """Names of the packaged scenes."""
    return sorted(path.stem for path in scene_folder().glob("*.toml"))


def scene_description(name: str) -> str:
    """The line of a packaged scene that says what it shows; empty if it has none.

    Raises:
        InputError: The file cannot be read.
    """
    table = read_toml(find_scene(name)).get("scene")
    return str(table.get("description", "")) if isinstance(table, Mapping) else ""


def find_scene(name_or_path: str | Path) -> Path:
    """The file of a packaged scene, or a path as it is.

    Raises:
        InputError: There is neither such a scene nor such a file.
    """
    given = str(name_or_path)
    path = Path(name_or_path).expanduser()
    is_name = path.name == given and path.suffix != ".toml"
    if is_name and given in scene_names():
        return scene_folder() / f"{given}.toml"
    if path.is_file():
        return path
    scenes = f"The scenes are {', '.join(scene_names())}; a file is given by its path."
    if is_name and not path.exists():
        remedy = f"{closest(given, scene_names())} {scenes}".strip()
        raise InputError(Mistake("scene", given, "is neither a packaged scene nor a file", remedy))
    problem = "is a folder" if path.is_dir() else "does not exist"
    raise InputError(Mistake("scene", given, problem, f"Give the path of a .toml file. {scenes}"))


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises:
        InputError: It cannot be read, or its syntax is wrong; with line and column.
    """
    try:
        text = path.read_bytes().decode("utf-8")
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(Mistake("scene", str(path), f"cannot be read ({reason})", "Check the file.")) from None
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        problem = "is not text in UTF-8, which TOML is written in"
        raise InputError(Mistake(f"line {line}", None, problem, "Save the file as UTF-8.", str(path))) from None
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        message = str(error)
        place = _PLACE.search(message)
        lines = text.splitlines() or [""]
        line, column = len(lines), len(lines[-1]) + 1
        if place and place["line"]:
            line, column = int(place["line"]), int(place["column"])
        problem = _PLACE.sub("", message)
        where = f"line {line}, column {column}"
        mistake = Mistake(where, None, f"is not TOML: {problem}", "Correct the syntax.", str(path))
        raise InputError(mistake) from None


def load_scene(
    name_or_path: str | Path, overrides: Mapping[str, Any] | Iterable[Override] = (), *, frames: int | None = None
) -> BuiltScene:
    """Read a scene and build what it describes.

    Args:
        name_or_path: The name of a packaged scene, or a path.
        overrides: Values by key that replace those of the file: `{"body.0.nodes": [33, 33]}`.
        frames: Number of samples; `None`: as many as the scene's duration asks for.

    Raises:
        InputError: Everything that is wrong with the file and the overrides, at once.
    """
    path = find_scene(name_or_path)
    raw = read_toml(path)
    if isinstance(overrides, Mapping):
        overrides = [Override(key, value) for key, value in overrides.items()]
    sources, mistakes = apply_overrides(raw, overrides)

    def label(place: KeyPath) -> str:
        """Where the value at a path was given."""
        return next((source for key, source in reversed(sources.items()) if place[: len(key)] == key), str(path))

    try:
        scene = _built(path, raw, label)
    except InputError as error:
        raise InputError([*mistakes, *error.mistakes]) from None
    if mistakes:
        raise InputError(mistakes)
    return scene if frames is None else scene.with_frames(frames)


def _built(path: Path, raw: dict[str, Any], label: Any) -> BuiltScene:
    checked = validate(raw, label)
    collector = Collector(checked, path, label)
    if checked.spec is None:
        raise InputError(collector.mistakes)
    return build(checked.spec, copy.deepcopy(raw), collector)
