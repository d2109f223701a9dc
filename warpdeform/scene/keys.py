"""The keys of a scene file by their path: what each one means, which ones exist, which one was meant.

Everything is read off the published JSON schema, so that messages, `--set` and the schema cannot disagree.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from functools import cache
from typing import Any

from warpdeform.scene.schema import json_schema

Path = tuple[str | int, ...]
"""Keys and list indices from the top of the file: ("body", 0, "nodes")."""

Node = Mapping[str, Any]
"""A place in the JSON schema."""

_TYPES = {"number": "a number", "integer": "a whole number", "string": "text", "boolean": "true or false"}


def dotted(path: Iterable[str | int]) -> str:
    """The path as a user writes it: `body.0.nodes`."""
    return ".".join(str(element) for element in path)


@cache
def _schema() -> Node:
    return json_schema()


def _resolved(node: Node, value: Any) -> Node:
    """The node that fits `value`: references followed, a choice made; keys beside a reference are kept."""
    own = {name: node[name] for name in node if name not in ("$ref", "oneOf", "anyOf")}
    if "$ref" in node:
        target = _schema()["$defs"][node["$ref"].rpartition("/")[2]]
        return {**_resolved(target, value), **own}
    if "oneOf" in node:
        kinds = node["discriminator"]["mapping"]
        kind = value.get("kind") if isinstance(value, Mapping) else None
        if isinstance(kind, str) and kind in kinds:
            return {**_resolved({"$ref": kinds[kind]}, value), "kinds": list(kinds)}
        tables = [_resolved(choice, value) for choice in node["oneOf"]]
        properties = {name: item for table in tables for name, item in table["properties"].items()}
        return {**own, "type": "object", "properties": properties, "required": ["kind"], "kinds": list(kinds)}
    if "anyOf" in node:
        choices = [_resolved(choice, value) for choice in node["anyOf"] if choice != {"type": "null"}]
        wanted = "array" if isinstance(value, list) else "object"
        fitting = [choice for choice in choices if choice.get("type") == wanted]
        return {**(fitting or choices)[0], **own}
    return node


def node_at(path: Path, raw: Any, as_table: bool = False) -> Node | None:
    """The schema's node of a path.

    Args:
        path: Where.
        raw: The file's tables, which decide between kinds.
        as_table: Take the node of a table even if the file has a value there that stands for one.

    Returns:
        The node; None if there is no such key.
    """
    node: Node = _resolved(_schema(), raw)
    for depth, element in enumerate(path, start=1):
        if isinstance(element, int):
            child = node.get("items")
            raw = raw[element] if isinstance(raw, list) and element < len(raw) else None
        else:
            child = node.get("properties", {}).get(element)
            raw = raw.get(element) if isinstance(raw, Mapping) else None
        if child is None:
            return None
        node = _resolved(child, {} if as_table and depth == len(path) else raw)
    return node


def words(node: Node) -> str:
    """What a value must be, as the end of "must be"."""
    if "words" in node:
        return str(node["words"])
    if node.get("type") == "array":
        item, count = node.get("items", {}).get("type"), node.get("minItems")
        plural = "whole numbers" if item == "integer" else "numbers" if item == "number" else "values"
        return f"{count} {plural}" if count and count == node.get("maxItems") else f"a list of {plural}"
    if "enum" in node:
        return f"one of {', '.join(node['enum'])}"
    return _TYPES.get(str(node.get("type")), "a table")


def in_unit(node: Node) -> str:
    """The unit in brackets with a space before it, or nothing."""
    return f" [{node['unit']}]" if "unit" in node else ""


def remedy(node: Node) -> str:
    """What to write instead, as a sentence."""
    if "remedy" in node:
        return str(node["remedy"])
    if node.get("examples"):
        return f"Use for example {toml(node['examples'][0])}."
    if "description" in node:
        return f"{str(node['description']).rstrip('.')}."
    return "See `warpdeform scenes --schema`."


def known_keys(node: Node) -> list[str]:
    """The keys of a table."""
    return list(node.get("properties", {}))


def meaning(node: Node) -> str:
    """The description, to go on within a sentence."""
    text = str(node.get("description", "it is needed"))
    return text[0].lower() + text[1:]


def closest(wrong: str, known: Iterable[str]) -> str:
    """A sentence that names what was probably meant; empty if nothing comes near."""
    close = get_close_matches(wrong.lower(), list(known), n=1, cutoff=0.6)
    return f'Did you mean "{close[0]}"?' if close else ""


def toml(value: Any) -> str:
    """A value as it stands in a scene file, in one line."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{name} = {toml(item)}" for name, item in value.items()) + " }" if value else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(toml(item) for item in value)}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    return str(value)
