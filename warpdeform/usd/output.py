"""Where a run's frames go: the requested file, and what lies beside it while the run lasts."""

from __future__ import annotations

import itertools
import os
from dataclasses import dataclass
from pathlib import Path

from warpdeform.errors import InputError, Mistake

SUFFIXES = (".usdc", ".usda", ".usdz")
"""Kinds of output: binary, text, and a package (a zip file with the binary file inside)."""


_NUMBERS = itertools.count(1)


@dataclass(frozen=True)
class OutputFiles:
    """The files of one run. For `flag.usdc`: the partial root `flag.partial.usda` and the folder `flag.partial/`.

    The partial root is readable at any time and shows the frames so far; it and the folder exist only while the run
    lasts, or after it was killed.

    Attributes:
        target: The requested file.
    """

    target: Path

    @property
    def root(self) -> Path:
        """The root layer of the frames so far."""
        return self.target.with_name(f"{self.target.stem}.partial.usda")

    @property
    def folder(self) -> Path:
        """The folder that holds the chunks of frames."""
        return self.target.with_name(f"{self.target.stem}.partial")

    @property
    def static(self) -> Path:
        """Everything that does not change: topology, materials, obstacles at rest."""
        return self.folder / "static.usdc"

    @property
    def manifest(self) -> Path:
        """The list of the attributes that the chunks hold."""
        return self.folder / "manifest.usda"

    @property
    def lock(self) -> Path:
        """The file whose lock says that a process is writing."""
        return self.folder / "lock"

    def chunk(self, number: int) -> Path:
        """Chunk of frames, counted from 1."""
        return self.folder / f"chunk_{number:05d}.usdc"

    def temporary(self, suffix: str) -> Path:
        """A new name in the folder, under which a file is written before it is renamed."""
        return self.folder / f"tmp_{os.getpid()}_{next(_NUMBERS)}{suffix}"

    def remove_partial(self) -> None:
        """Remove the partial root first, so that no root is ever left without its chunks, then what the folder holds.

        Only files with the names of this class are removed; the lock file is left to its owner.
        """
        self.root.unlink(missing_ok=True)
        for pattern in ("chunk_*.usdc", "tmp_*", self.static.name, self.manifest.name):
            for path in self.folder.glob(pattern):
                path.unlink(missing_ok=True)


def check_output(path: str | Path) -> OutputFiles:
    """Check that frames can be written to `path`, without writing anything.

    Args:
        path: The requested file; missing folders above it will be made.

    Raises:
        InputError: Unknown suffix, a folder of that name, a file where a folder is needed, or no right to write.
    """
    target = Path(path).expanduser()

    def refuse(problem: str, remedy: str) -> InputError:
        return InputError(Mistake("output", str(path), problem, remedy))

    if target.suffix not in SUFFIXES:
        found = f"has the suffix {target.suffix}" if target.suffix else "has no suffix"
        raise refuse(f"{found}, which is no kind of USD file that can be written", f"Use {', '.join(SUFFIXES)}.")
    try:
        if target.is_dir():
            raise refuse("is a folder", f"Name a file in it, such as {target / ('frames' + target.suffix)}.")
        files = OutputFiles(target.absolute())
        for place, kind in ((files.folder, "folder"), (files.root, "file")):
            if place.exists() and place.is_dir() != (kind == "folder"):
                raise refuse(f"needs {place} as a {kind} while it is written", "Choose another name, or remove that.")
        folder = files.target.parent
        while not folder.exists():
            folder = folder.parent
        if not folder.is_dir():
            raise refuse(f"lies below {folder}, which is a file", "Choose another folder.")
        if not os.access(folder, os.W_OK | os.X_OK):
            raise refuse(f"cannot be written: no right to write in {folder}", "Choose a folder that you may write in.")
    except OSError as error:
        raise refuse(f"cannot be written: {error.strerror or error}", "Choose another file.") from error
    return files


def refusal(files: OutputFiles, error: Exception) -> InputError:
    """The InputError for an output that could not be opened for writing."""
    reason = error.strerror if isinstance(error, OSError) and error.strerror else " ".join(str(error).split())
    problem = f"cannot be written: {reason}"
    return InputError(Mistake("output", str(files.target), problem, "Choose a folder that you may write in."))
