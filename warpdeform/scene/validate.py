"""From the tables of a file to the models of the schema, with every mistake in words."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from warpdeform.errors import Mistake
from warpdeform.scene.keys import Path, closest, dotted, in_unit, known_keys, meaning, node_at, remedy, words
from warpdeform.scene.schema import SceneFile

_MOST_ROUNDS = 8


@dataclass
class Checked:
    """A file as far as it can be understood.

    Attributes:
        spec: The scene, in which good values stand in for those that were refused; None if nothing could be saved.
        mistakes: What is wrong, with paths in the file.
        removed: Indices that were left out of a list, one after the other, by the path of the list in the file.
    """

    spec: SceneFile | None = None
    mistakes: dict[Path, Mistake] = field(default_factory=dict)
    removed: dict[Path, list[int]] = field(default_factory=dict)

    def original(self, path: Path) -> Path:
        """The path in the file of a path in `spec`, whose lists may be shorter."""
        found: Path = ()
        for element in path:
            for gone in reversed(self.removed.get(found, [])):
                if isinstance(element, int) and gone <= element:
                    element += 1
            found = (*found, element)
        return found

    def refused(self, path: Path) -> bool:
        """Whether `path`, a path in the file, or something it lies in was refused."""
        return any(path[: len(wrong)] == wrong for wrong in self.mistakes)

    def touched(self, path: Path) -> bool:
        """Whether anything at, in or around `path` was refused."""
        return self.refused(path) or any(wrong[: len(path)] == path for wrong in self.mistakes)


def validate(raw: Mapping[str, Any], label: Callable[[Path], str]) -> Checked:
    """Check names and types of a whole file.

    What is refused is replaced by an example, or left out where it may be, so that the rest can be checked further.

    Args:
        raw: The tables of the file.
        label: Where a path was given: the file's name, or `--set`.
    """
    checked = Checked()
    tables = copy.deepcopy(dict(raw))
    for first in (True, *(False,) * _MOST_ROUNDS):
        try:
            checked.spec = SceneFile.model_validate(tables)
            return checked
        except ValidationError as error:
            wrong = _by_path(error, tables)
        if first:
            for path, details in wrong.items():
                checked.mistakes[path] = _mistake(path, details, tables, label(path))
        for path in sorted(wrong, key=_last_first, reverse=True):
            _replace(tables, path, checked)
    return checked


def _by_path(error: ValidationError, raw: Any) -> dict[Path, ErrorDetails]:
    """One error for each path; none below another, which is the same value seen as another member of a union.

    A table that could also be a number is meant as a table: what is wrong in it is said, not that it is no number.
    """
    found: dict[Path, ErrorDetails] = {}
    for details in error.errors(include_url=False):
        found.setdefault(_path(details, raw), details)
    tables = [path for path, details in found.items() if isinstance(details["input"], dict)]
    for path in tables:
        if found[path]["type"].endswith("_type") and any(path == other[: len(path)] != other for other in found):
            del found[path]
    topmost = {path: found[path] for path in found if not any(path[:n] in found for n in range(len(path)))}
    return {path: details for path, details in topmost.items() if not _misspelt(path, topmost)}


def _misspelt(path: Path, found: Mapping[Path, ErrorDetails]) -> bool:
    """Whether the key at `path` is only missing because it is misspelt, which is reported for itself."""
    if found[path]["type"] != "missing":
        return False
    unknown = [other for other in found if other[:-1] == path[:-1] and found[other]["type"] == "extra_forbidden"]
    return any(closest(str(other[-1]), [str(path[-1])]) for other in unknown)


def _last_first(path: Path) -> tuple[tuple[int, str | int], ...]:
    """Sorts so that, backwards, list items are removed from the end and parts come before the whole."""
    return tuple((isinstance(element, str), element) for element in path)


def _path(details: ErrorDetails, raw: Any) -> Path:
    """The path in the file: without the names of the union members that pydantic puts in between."""
    path: Path = ()
    for element in details["loc"]:
        in_list = isinstance(raw, list) and isinstance(element, int) and element < len(raw)
        if in_list or (isinstance(raw, dict) and element in raw):
            raw = raw[element]
        elif not (isinstance(raw, dict) and details["type"] == "missing" and element == details["loc"][-1]):
            continue
        path = (*path, element)
    if details["type"] == "union_tag_invalid":
        path = (*path, "kind")
    return path


def _mistake(path: Path, details: ErrorDetails, raw: Any, file: str) -> Mistake:
    """Say in words, with unit and remedy, what pydantic found at `path`."""
    node, parent = node_at(path, raw) or {}, node_at(path[:-1], raw) or {}
    value, kind = details["input"], details["type"]
    if kind == "extra_forbidden":
        place = f"[{dotted(path[:-1])}]" if path[:-1] else "a scene"
        better = closest(str(path[-1]), known_keys(parent)) or f"Its keys are {', '.join(known_keys(parent))}."
        return Mistake(dotted(path), value, f"is not a key of {place}", better, file)
    if kind == "missing":
        return Mistake(dotted(path), None, f"is missing ({meaning(node)}{in_unit(node)})", remedy(node), file)
    if kind == "union_tag_not_found":
        choices = f"Use one of {', '.join(node.get('kinds', ()))}."
        return Mistake(dotted((*path, "kind")), None, "is missing", choices, file)
    if kind == "union_tag_invalid":
        wrong, kinds = value.get("kind"), parent.get("kinds", ())
        choices = f"Use one of {', '.join(kinds)}."
        return Mistake(dotted(path), wrong, "is not a kind that exists", closest(str(wrong), kinds) or choices, file)
    if kind == "finite_number":
        return Mistake(dotted(path), value, f"must be finite{in_unit(node)}", remedy(node), file)
    return Mistake(dotted(path), value, f"must be {words(node)}{in_unit(node)}", remedy(node), file)


def _replace(raw: Any, path: Path, checked: Checked) -> None:
    """Put an example where a bad value stands, or take the value out if it may be left out."""
    table = node_at(path[:-1], raw) or {}
    if path[-1:] == ("kind",) and "kinds" in table:
        _replace(raw, path[:-1], checked)
        return
    if not path:
        raw.clear()
        return
    parent = raw
    for element in path[:-1]:
        parent = parent[element]
    last, node = path[-1], node_at(path, raw) or {}
    if isinstance(parent, list) and isinstance(last, int):
        checked.removed.setdefault(checked.original(path[:-1]), []).append(last)
        del parent[last]
    elif last in table.get("required", ()) and "examples" in node:
        parent[last] = copy.deepcopy(node["examples"][0])
    else:
        parent.pop(last, None)
