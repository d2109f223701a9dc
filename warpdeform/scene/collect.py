"""Collecting what the makers of bodies and obstacles refuse, so that a whole file's mistakes are reported at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

from warpdeform.errors import InputError, Mistake
from warpdeform.scene.keys import Path, dotted
from warpdeform.scene.validate import Checked


@dataclass
class Collector:
    """The mistakes of one file.

    Attributes:
        checked: The checked file; mistakes are added to it.
        file: The scene file; paths in it are seen from its folder.
        label: Where a path was given: the file's name, or `--set`.
    """

    checked: Checked
    file: FilePath
    label: Callable[[Path], str]

    @property
    def mistakes(self) -> list[Mistake]:
        """Everything so far."""
        return list(self.checked.mistakes.values())

    def refuse(self, path: Path, value: object, problem: str, remedy: str) -> None:
        """Note a mistake at a path of the spec, unless it follows from one before.

        That is so where the value was refused, and where a key is missing in a table that lost some.
        """
        original = self.checked.original(path)
        missing = problem.startswith("is missing")
        if not (self.checked.touched(original[:-1]) if missing else self.checked.refused(original)):
            mistake = Mistake(dotted(original), value, problem, remedy, self.label(original))
            self.checked.mistakes[original] = mistake

    def sound(self, *paths: Path) -> bool:
        """Whether nothing at, in or around these paths of the spec was refused."""
        return not any(self.checked.touched(self.checked.original(path)) for path in paths)

    @contextmanager
    def at(self, path: Path, moved: Mapping[str, Path] | None = None) -> Iterator[None]:
        """Take what is refused inside for mistakes of `path`, and go on.

        Args:
            path: The table that the objects made inside come from.
            moved: The places of keys of those objects that stand elsewhere, or have another name there.
        """
        try:
            yield
        except InputError as error:
            for mistake in error.mistakes:
                head, *rest = mistake.key.split(".")
                elements = [int(part) if part.isdecimal() else part for part in rest]
                place = (moved or {}).get(head, (*path, head))
                self.refuse((*place, *elements), mistake.value, mistake.problem, mistake.remedy)


def look(table: Any, at: Path, collector: Collector) -> dict[str, Any]:
    """Colour and roughness of a body or an obstacle, as arguments, where they are given and make sense."""
    arguments: dict[str, Any] = {}
    for key, highest in (("color", math.inf), ("roughness", 1.0)):
        value = getattr(table, key)
        if value is None:
            continue
        numbers = value if isinstance(value, list) else [value]
        if all(0.0 <= number <= highest for number in numbers):
            arguments[key] = tuple(value) if isinstance(value, list) else value
        else:
            problem = "must not be negative" if highest == math.inf else f"must lie between 0 and {highest:g}"
            collector.refuse((*at, key), value, problem, "Leave it out for the usual look.")
    return arguments
