"""Values from outside the file: `--set body.0.nodes=[33,33]` and its kin."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from warpdeform.errors import InputError, Mistake
from warpdeform.scene.keys import Path, closest, dotted, known_keys, node_at


@dataclass(frozen=True)
class Override:
    """A value that replaces one of the file.

    Attributes:
        key: Its key, with dots: `"body.0.nodes"`.
        value: The value.
        source: Where it comes from, for messages.
    """

    key: str
    value: Any
    source: str = "override"


def parse_override(text: str) -> Override:
    """Read the argument of `--set`: `KEY=VALUE`, the value in TOML, or else taken as text.

    Raises:
        InputError: There is no `=`, or no key before it.
    """
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        remedy = "Use KEY=VALUE, for example body.0.nodes=[33,33]."
        raise InputError(Mistake("--set", text, "is no assignment", remedy))
    return Override(key.strip(), _toml_or_text(value.strip()), "--set")


def _toml_or_text(text: str) -> Any:
    try:
        table = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return text
    return table["value"] if len(table) == 1 else text


def apply_overrides(raw: dict[str, Any], overrides: Iterable[Override]) -> tuple[dict[Path, str], list[Mistake]]:
    """Put values into the tables of a file.

    Args:
        raw: The tables; changed in place.
        overrides: What to change, in order.

    Returns:
        Where each path that was set comes from, and the mistakes: keys that do not exist, indices out of range.
    """
    sources: dict[Path, str] = {}
    mistakes: list[Mistake] = []
    for override in overrides:
        try:
            sources[_set(raw, override)] = override.source
        except InputError as error:
            mistakes += error.mistakes
    return sources, mistakes


def _set(raw: dict[str, Any], override: Override) -> Path:
    """Set one value; return its path."""
    elements = override.key.split(".")
    table: Any = raw
    path: Path = ()
    for depth, text in enumerate(elements):
        element = _element(raw, table, path, text, override)
        path = (*path, element)
        if depth == len(elements) - 1:
            table[element] = deepcopy(override.value)
        else:
            table = _opened(raw, table, path, elements[depth + 1])
    return path


def _element(raw: dict[str, Any], table: Any, path: Path, text: str, override: Override) -> str | int:
    """The key or index that `text` is in `table`, which stands at `path`."""

    def refuse(problem: str, remedy: str) -> InputError:
        return InputError(Mistake(override.key, override.value, problem, remedy, override.source))

    where = dotted(path) or "the scene"
    if isinstance(table, list):
        if text.isdecimal() and int(text) < len(table):
            return int(text)
        if not table:
            raise refuse(f"{where} is empty", "Add it to the scene file first.")
        indices = "0" if len(table) == 1 else f"0 to {len(table) - 1}"
        raise refuse(f"{text} is not an index of {where}", f"Use {indices}.")
    node = node_at(path, raw) or {}
    if not isinstance(table, Mapping) or not known_keys(node):
        raise refuse(f"{where} is a single value without keys", f"Set {where} itself.")
    if text not in known_keys(node):
        keys = ", ".join(known_keys(node))
        raise refuse(f'{where} has no key "{text}"', closest(text, known_keys(node)) or f"Its keys are {keys}.")
    return text


def _opened(raw: dict[str, Any], table: Any, path: Path, following: str) -> Any:
    """The container at `path`, an element of `table`: made where it is missing, or where a value stands for one."""
    element: Any = path[-1]
    present = table[element] if isinstance(table, list) else table.get(element)
    shorthand = (node_at(path, raw, as_table=True) or {}).get("shorthand")
    if present is None:
        node = node_at(path, raw) or {}
        table[element] = [] if node.get("type") == "array" else {}
    elif shorthand and (isinstance(present, str) or (isinstance(present, list) and not following.isdecimal())):
        table[element] = {shorthand: present}
    return table[element]
