"""What goes wrong, said in one line each: mistakes in the input, and simulations that fail.

Everything the engine raises on purpose descends from `WarpdeformError`. Input is refused with `InputError`, which
carries every `Mistake` found, so that a scene file is corrected in one go and not one message at a time.
"""

from collections.abc import Sequence
from dataclasses import dataclass


class WarpdeformError(Exception):
    """Base of every error that the engine raises on purpose."""


@dataclass(frozen=True)
class Mistake:
    """One thing that is wrong with the input.

    Attributes:
        key: The key as the user wrote it, with dots for nesting: `"body.0.material.poisson_ratio"`.
        value: The value found there; `None` when the key is missing.
        problem: What is wrong, as the end of a sentence that begins with the key: `"must be below 0.5"`.
        remedy: What to do, as a full sentence with units: `"Use 0 to 0.49."`.
        file: The file it stands in; empty for objects made in Python.
    """

    key: str
    value: object
    problem: str
    remedy: str
    file: str = ""

    def __str__(self) -> str:
        place = f"{self.file}: " if self.file else ""
        found = "" if self.value is None else f" = {shown(self.value)}"
        return f"{place}{self.key}{found}: {self.problem}. {self.remedy}"


class InputError(WarpdeformError):
    """The input was refused; `mistakes` says everything that is wrong with it, and `str` gives one line for each."""

    def __init__(self, mistakes: Mistake | Sequence[Mistake]) -> None:
        self.mistakes: tuple[Mistake, ...] = (mistakes,) if isinstance(mistakes, Mistake) else tuple(mistakes)
        if not self.mistakes:
            raise ValueError("an InputError needs at least one mistake")
        super().__init__(self.mistakes)

    def __str__(self) -> str:
        return "\n".join(str(mistake) for mistake in self.mistakes)


class SimulationFailure(WarpdeformError):
    """A step that could not be completed.

    Attributes:
        body: Name of the body it happened in.
        time: Simulated time of the last good state, s.
        node: Grid index of the node that shows it, `()` where no single node does.
        cause: What happened, as a clause: `"positions are no longer finite"`.
        remedy: What to change, as a full sentence.
    """

    def __init__(self, body: str, time: float, node: tuple[int, ...], cause: str, remedy: str) -> None:
        super().__init__(body, time, node, cause, remedy)
        self.body = body
        self.time = time
        self.node = node
        self.cause = cause
        self.remedy = remedy

    def __str__(self) -> str:
        where = f", node {list(self.node)}" if self.node else ""
        return f'body "{self.body}"{where}, t = {self.time:.6g} s: {self.cause}. {self.remedy}'


def shown(value: object, limit: int = 80) -> str:
    """Return `value` as a user would write it, in one line of at most `limit` characters."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, str):
        text = f'"{value}"'
    elif isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, tuple):
        text = str(list(value))
    else:
        text = str(value)
    text = " ".join(text.split())
    return text if len(text) <= limit else text[: limit - 3] + "..."
