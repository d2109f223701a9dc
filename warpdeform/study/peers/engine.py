"""What the benchmark asks of an engine."""

import inspect
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

from warpdeform.study.peers.sheet import Array, Sheet


@dataclass(frozen=True)
class Setting:
    """How an engine solves.

    Attributes:
        name: As people read it.
        values: What the engine is asked for, as plain numbers and words.
        example: Whether it is what the engine's own cloth example uses.
    """

    name: str
    values: dict[str, Any] = field(default_factory=dict)
    example: bool = False


class Session(ABC):
    """A sheet in an engine, everything compiled and recorded."""

    @abstractmethod
    def advance_frame(self) -> None:
        """Simulate one frame, 1/60 s."""

    @abstractmethod
    def positions(self) -> Array:
        """Positions [m], shape (n, n, 3), a copy."""


class Engine(ABC):
    """An engine on the hanging sheet.

    Attributes:
        name: Its name on the command line.
        package: Distribution and module it comes from.
        law: What it takes the material for.
    """

    name: ClassVar[str]
    package: ClassVar[str]
    law: ClassVar[str]

    @property
    def install(self) -> str:
        """The command that installs it."""
        return f"pip install {self.package}"

    @property
    def missing(self) -> bool:
        """Whether it cannot be imported."""
        return find_spec(self.package) is None

    @abstractmethod
    def settings(self, nodes: int) -> tuple[Setting, ...]:
        """What is timed: the example's settings and those that lie on the front of time against error.

        Args:
            nodes: Nodes along each side.
        """

    @abstractmethod
    def references(self, nodes: int) -> tuple[Setting, Setting]:
        """What the law itself does, converged: a setting, and one with twice its step that tells how far.

        Args:
            nodes: Nodes along each side.
        """

    @abstractmethod
    def prepare(self, sheet: Sheet, setting: Setting) -> Session:
        """Build the sheet, compile, record.

        Args:
            sheet: The sheet.
            setting: One of `settings` or `references`.
        """

    def sources(self) -> tuple[Path, ...]:
        """Files that a reference depends on: the sheet's and the engine's own, and what its law is made of."""
        return Path(inspect.getfile(Sheet)), Path(inspect.getfile(type(self)))
